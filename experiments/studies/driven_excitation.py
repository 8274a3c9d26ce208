"""Columns of drives in a designed excitation: which a motion can determine, their derivatives, and what is known."""

from collections.abc import Sequence

import numpy as np

from experiments.data.paper import ACCELERATION, VELOCITY
from ident.estimation.equations import Equations
from ident.estimation.excitation import separable
from ident.estimation.loads import usual_drives
from ident.estimation.samples import Samples
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.model import regressor
from ident.model.axes import Axes, column_place, stated_values
from ident.model.regressor import drive_names, joint_torque_regressor
from ident.parameters.base_parameters import BaseParameters
from ident.parameters.prior import DRIVE_KNOWN
from ident.tolerances import STRIBECK

SLIP = 0.03
"""Velocity over which Coulomb friction changes its sign in a design, rad/s or m/s: a motion slower than that says
little of it on a real joint, and its derivatives exist."""

INSTANTS = 200
"""Number of random states at which columns are compared."""

USUAL = 0.1
"""Friction, rotor and spring torques of a joint for which the model states none, over the torques of its links."""


def determined(mechanism: Mechanism, parameters: BaseParameters, drive: Sequence[str] | None) -> tuple[str, ...]:
    """Names of the drives' columns that some motion separates from the base parameters.

    Args:
        mechanism: The mechanism of the joints that move.
        parameters: Its base parameters by torques.
        drive: Kinds of drives; None for `usual_drives`.
    """
    felt = tuple(range(len(mechanism.tree.freedoms)))
    names = usual_drives(mechanism, felt) if drive is None else drive_names(mechanism.tree, drive)
    channels = mechanism.tree.freedoms
    # Motions are not designed for drives of joints that loops move.
    names = tuple(name for name in names if column_place(name)[1] in channels)
    equations = Equations(mechanism, parameters, torques=felt, channels=channels, drives=names)
    motion = _random_motion(mechanism)
    return separable(equations, Samples(motion, np.zeros((INSTANTS, len(channels))))).drives


def drive_signals(mechanism: Mechanism, drives: Sequence[str], motion: Motion) -> np.ndarray:
    """Columns of drives (N, n, d)."""
    signals = regressor.drive_signals(
        mechanism.tree, Axes.of(mechanism.tree), motion.states, SLIP, mechanism.springrefs
    )
    out = np.zeros((*motion.dq.shape, len(drives)))
    for column, (kind, k) in enumerate(_places(mechanism, drives)):
        out[:, k, column] = signals[kind][:, k]
    return out


def drives_pulled_back(
    mechanism: Mechanism, drives: Sequence[str], motion: Motion, adjoints: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives by a motion, from derivatives by the columns of drives (N, n, d)."""
    q, dq, ddq = (np.zeros_like(x) for x in motion.states)
    sign, relative = np.tanh(motion.dq / SLIP), motion.dq / STRIBECK
    steep, low, one = (1 - sign**2) / SLIP, 1 / (1 + relative**2), np.ones_like(dq)
    slopes = {
        "rotor": (ddq, one),
        "viscous": (dq, one),
        "coulomb": (dq, steep),
        "stribeck": (dq, steep * low - sign * 2 * relative / STRIBECK * low**2),
        "spring": (q, one),
    }
    for column, (kind, k) in enumerate(_places(mechanism, drives)):
        by, slope = slopes[kind]
        by[:, k] += adjoints[:, k, column] * slope[:, k]
    return q, dq, ddq


def drive_deviations(mechanism: Mechanism, drives: Sequence[str]) -> np.ndarray:
    """Prior standard deviations of drives: those of the model's values, else of usual ones (d,)."""
    motion = _random_motion(mechanism)
    torques = joint_torque_regressor(mechanism.tree, *motion.states, gravity=mechanism.gravity) @ mechanism.known
    size, per = USUAL * np.sqrt((torques**2).mean(axis=0)), {"rotor": ACCELERATION, "viscous": VELOCITY}
    usual = np.array([size[k] / per.get(kind, 1.0) for kind, k in _places(mechanism, drives)])
    stated = DRIVE_KNOWN * stated_values(mechanism, drives)
    return np.where(stated > 0, stated, usual)


def _places(mechanism: Mechanism, drives: Sequence[str]) -> list[tuple[str, int]]:
    """Kind, and index of the freedom, of each column."""
    freedoms = mechanism.tree.freedoms
    return [(kind, freedoms.index(freedom)) for kind, freedom in map(column_place, drives)]


def _random_motion(mechanism: Mechanism) -> Motion:
    rng, tree = np.random.default_rng(0), mechanism.tree
    q, dq, ddq = rng.uniform(-1, 1, size=(3, INSTANTS, len(tree.freedoms)))
    closed = tree.closure.drawn(rng, INSTANTS) if tree.closure else {}
    for joint, x in closed.items():
        q[:, [tree.joints.index(joint)]] = x
    return Motion(q, dq, ddq)
