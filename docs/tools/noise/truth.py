"""True values of identified quantities: base parameters, with the effects of rotors that they absorb, and drives."""

from collections.abc import Mapping

import mujoco
import numpy as np

from ident.estimation.equations import Equations
from ident.estimation.samples import Samples
from ident.geometry.inertia import com_from_parameters, parameters_from_com
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.model.regressor import drive_names
from ident.parameters.prior import KNOWN
from sim.models.names import joint_name

INSTANTS = 200
"""Random states for the columns, several for each column."""

STRIBECK_SHARE = 0.5
"""True Stribeck friction over Coulomb friction: dry joints break loose at one and a half times their friction."""

TAKEN_UP = 1e-8
"""Largest part of a unit column outside the span of base parameters that absorb it."""


def drawn_bodies(mechanism: Mechanism, rng: np.random.Generator) -> np.ndarray:
    """φ of bodies drawn from the prior around a mechanism's, as in `ident.parameters.prior` (10 b,)."""
    return np.concatenate([_drawn(phi, rng) for phi in mechanism.known.reshape(-1, 10)])


def _drawn(phi: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """φ of a body with independent random errors of mass, centre of mass and central inertia (10,)."""
    mass, center, inertia = com_from_parameters(phi)
    values, axes = np.linalg.eigh(inertia)
    root = (axes * np.sqrt(np.maximum(values, 0))) @ axes.T
    entries = rng.normal(size=(3, 3))
    return parameters_from_com(
        mass * (1 + KNOWN["mass"] * rng.normal()),
        center + KNOWN["center"] * rng.normal(size=3),
        inertia + KNOWN["inertia"] * root @ (entries + entries.T) @ root / 2,
    )


def drives(mechanism: Mechanism, model: mujoco.MjModel, *, stribeck: bool = False) -> dict[str, float]:
    """Rotor inertia, viscous, Coulomb and perhaps Stribeck friction of each joint in a model, by column name."""
    addresses = {joint_name(model, j): int(model.jnt_dofadr[j]) for j in range(model.njnt)}
    stated = {"rotor": model.dof_armature, "viscous": model.dof_damping, "coulomb": model.dof_frictionloss}
    stated |= {"stribeck": STRIBECK_SHARE * model.dof_frictionloss} if stribeck else {}
    return {
        name: float(values[addresses[joint]])
        for kind, values in stated.items()
        for name, joint in zip(drive_names(mechanism.tree, [kind]), mechanism.tree.joints, strict=True)
    }


def truth(equations: Equations, phi: np.ndarray, stated: Mapping[str, float]) -> np.ndarray:
    """True values of base parameters and drives (r + d,).

    A drive without a column of its own, such as the rotor of a joint that turns a link about a fixed axis, is absorbed
    by base parameters: its column is a combination of theirs.

    Args:
        equations: Equations with the identified columns.
        phi: φ of the bodies (10 b,).
        stated: Values of all drives by name; empty without drives.
    """
    own = np.r_[equations.parameters.regroup(phi), [stated[name] for name in equations.drives]]
    others = [name for name in stated if name not in equations.drives]
    if not others or not equations.torques:
        return own
    columns = _columns(equations.with_drives((*equations.drives, *others)).with_offsets(()))
    kept, taken = columns[:, : len(own)], columns[:, len(own) :]
    sizes = np.linalg.norm(kept, axis=0)
    combined = np.linalg.lstsq(kept / sizes, taken, rcond=None)[0] / sizes[:, None]
    left = np.linalg.norm(taken - kept @ combined, axis=0)
    # Friction that is not identified is not absorbed, and is not part of the parameters' truth.
    is_taken = left < TAKEN_UP * np.linalg.norm(taken, axis=0)
    return own + combined[:, is_taken] @ np.array([stated[name] for name in others])[is_taken]


def _columns(equations: Equations) -> np.ndarray:
    """Columns at random states, channel by channel (C N, columns)."""
    rng, tree = np.random.default_rng(0), equations.mechanism.tree
    motion = Motion(*rng.uniform(-1, 1, size=(3, INSTANTS, len(tree.freedoms))))
    samples = Samples(motion, np.zeros((INSTANTS, len(equations.channels))))
    blocks = [block[:-1].reshape(len(block) - 1, -1).T.copy() for block in equations.rows(samples)]
    return np.concatenate(blocks)
