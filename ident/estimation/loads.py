"""Wrenches on the bodies of a mechanism and drives, for numbers or for signals of a tape.

Γ_i = Y_i φ_i            Ia q̈ + Fv q̇ + Fc tanh(q̇ / SLIP) + K (q - q_0) + …

Drives of motors that move several joints together have their angles, R q, in place of q, and add Rᵀ τ_motor.
"""

from collections.abc import Sequence

import numpy as np
from scipy.spatial.transform import Rotation

from ident.estimation.equations import COMPONENTS, Equations
from ident.geometry.se3 import coAd, inverse
from ident.mechanism.drives import NO_DRIVE
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.model.axes import Axes, stated_values
from ident.model.closed_form import BodyMotion, body_wrenches
from ident.model.regressor import drive_signals, inverse_dynamics
from ident.parameters.prior import known_covariance, known_roots, known_rows
from ident.tolerances import DRIVE, USUAL_DRIVE

SLIP = 0.003
"""Default velocity over which Coulomb friction changes sign, rad/s or m/s."""


def inertial_wrenches(
    equations: Equations, motions: list[BodyMotion], theta: np.ndarray, unseen: np.ndarray
) -> list[np.ndarray]:
    """Inertial and gravitational wrench of each body.

    Args:
        equations: The mechanism and its base parameters.
        motions: Motion of every body.
        theta: Base parameters ψ first (≥ r,).
        unseen: Dependent entries of φ (d,), as `unseen`.

    Returns:
        Wrench in the base frame of every body (6,), zeros for massless ones.
    """
    phi = beside(equations, unseen)
    phi[list(equations.parameters.kept)] += theta[: equations.parameters.rank]
    return body_wrenches(equations.mechanism.tree, motions, phi)


def beside(equations: Equations, unseen: np.ndarray) -> np.ndarray:
    """φ with dependent entries (d,) and base parameters of zero: no channel shows it at the model's joints (10 b,)."""
    parameters = equations.parameters
    phi = np.zeros(len(parameters.parameters), unseen.dtype)
    phi[list(parameters.dependent)] = unseen
    for row, beta in zip(parameters.kept, parameters.beta, strict=True):
        for k in np.flatnonzero(beta):
            phi[row] = phi[row] - beta[k] * unseen[k]
    return phi


def unseen(equations: Equations) -> tuple[np.ndarray, np.ndarray]:
    """Dependent entries of φ by the model (d,), and their likeliest changes by those of ψ (d, r).

        φ_d(ψ) = φ_d + D (ψ - ψ_model),        D = (S Bᵀ)_d (B S Bᵀ)⁻¹

    with ψ = B φ and S the prior covariance of φ. No channel shows them at the joints of the model, but where these are
    displaced or tilted, ψ alone is no body: it may have -1700 kg where two joints are 10 mm apart.
    """
    mechanism, parameters = equations.mechanism, equations.parameters
    dependent, shape = list(parameters.dependent), (len(parameters.dependent), parameters.rank)
    prior = np.zeros(len(parameters.parameters)) if mechanism.prior is None else mechanism.prior
    if not (prior[::10] > 0).any():
        return prior[dependent], np.zeros(shape)
    covariance = known_covariance(mechanism, parameters, absorbed=equations.absorbed)
    of_bodies = known_roots(mechanism).reshape(-1, 10, 10)
    across = np.einsum("bkp,bkr->bpr", of_bodies, known_rows(mechanism, parameters).reshape(-1, 10, parameters.rank))
    scale = np.sqrt(np.diag(covariance))
    changes = np.linalg.solve(
        covariance / np.outer(scale, scale), across.reshape(-1, len(scale))[dependent].T / scale[:, None]
    )
    return prior[dependent], changes.T / scale


def drive_torques(
    equations: Equations, states: tuple[np.ndarray, np.ndarray, np.ndarray], theta: np.ndarray, slips: np.ndarray
) -> np.ndarray:
    """Torques of rotor inertia, friction and springs of the n freedoms, zero without a column for them (n,).

    Args:
        equations: Equations with the drives' columns.
        states: Joint coordinates (n_q,), velocities and accelerations (n,).
        theta: Parameters, those of the drives after ψ.
        slips: Velocities of the m axes over which Coulomb friction changes sign (m,).
    """
    axes, at = equations.axes, dict(zip(equations.drives, theta[equations.parameters.rank :], strict=False))
    signals = drive_signals(equations.mechanism.tree, axes, states, slips, equations.mechanism.springrefs)
    each = [[at.get(f"{DRIVE[kind]}({name})", 0.0) for name in axes.names] * own for kind, own in signals.items()]
    return axes.felt(equations.mechanism.tree, states[0], np.sum(each, axis=0))


def stated_drive_torques(mechanism: Mechanism, motion: Motion) -> np.ndarray:
    """Torques of rotors, friction and springs as the model states them, N m or N (N, n).

    Coulomb friction changes its sign as `tanh(q̇ / SLIP)`, so that noise of a resting joint's velocity is no friction.

    Args:
        mechanism: The mechanism, with its drives.
        motion: Motion of its joints, checked (N samples).
    """
    tree = mechanism.tree
    axes, names = Axes.of(tree), (*tree.freedoms, *tree.dependent)
    drives = [mechanism.drives.get(name, NO_DRIVE) for name in names]
    signals = drive_signals(tree, axes, motion.states, SLIP, mechanism.springrefs)
    values, at = {kind: np.array([each.value(kind) for each in drives], float) for kind in signals}, 0
    for body, own in zip(tree.bodies, tree.body_coordinates(motion.q), strict=True):
        part = slice(at, at := at + body.freedoms)
        if body.is_ball and values["spring"][part].any():
            reference = Rotation.from_rotvec(mechanism.springrefs[part])
            turned = reference.inv() * Rotation.from_quat(own, scalar_first=True)
            signals["spring"][:, part] = turned.as_rotvec()
    return axes.felt(tree, motion.q, np.sum([values[kind] * signal for kind, signal in signals.items()], axis=0))


def stated_drive_channels(equations: Equations, motion: Motion) -> np.ndarray:
    """Part of the drives, as the model states them, in the channels of equations: zero in a wrench (N, C)."""
    out = np.zeros((len(motion), len(equations.channels)))
    if equations.torques and equations.mechanism.drives:
        torques = stated_drive_torques(equations.mechanism, motion)
        out[:, -len(equations.torques) :] = torques[:, list(equations.torques)]
    return out


def predicted_channels(
    mechanism: Mechanism, motion: Motion, frame: np.ndarray, *, torques: bool = False
) -> dict[str, np.ndarray]:
    """Components of the total wrench in a frame, and joint torques if requested, as the model predicts them (N,) each.

    It predicts with its prior and with the drives that it states.
    """
    total, felt = inverse_dynamics(mechanism.tree, motion, mechanism.known, mechanism.gravity)
    predicted = dict(zip(COMPONENTS, coAd(inverse(frame)) @ total.T, strict=True))
    if torques and mechanism.drives:
        felt = felt + stated_drive_torques(mechanism, motion)
    return predicted | (dict(zip(mechanism.tree.freedoms, felt.T, strict=True)) if torques else {})


def drives_of(axes: Axes, kinds: Sequence[str], torques: Sequence[int]) -> tuple[str, ...]:
    """Names of the columns of some kinds of drives that act on the freedoms whose torques are measured.

    Args:
        axes: Axes on which drives act.
        kinds: The kinds, out of `DRIVE`.
        torques: Indices of those freedoms.
    """
    each = (f"{DRIVE[kind]}({name})" for kind in kinds for k in torques for name in axes.acting(kind, k))
    return tuple(dict.fromkeys(each))


def usual_drives(mechanism: Mechanism, torques: Sequence[int], axes: Axes | None = None) -> tuple[str, ...]:
    """Names of the columns that are fitted by default: rotor inertia and friction, and springs that the model has.

    Args:
        mechanism: The mechanism.
        torques: Indices of the freedoms whose torques are measured.
        axes: Axes on which drives act, by default the freedoms alone.
    """
    axes = Axes.of(mechanism.tree) if axes is None else axes
    freedoms = [mechanism.tree.freedoms[k] for k in torques]
    hinges = [name for name in freedoms if name in mechanism.tree.joints and name in mechanism.drives]
    springs = [name for name in hinges if mechanism.drives[name].stiffness]
    usual = (*drives_of(axes, USUAL_DRIVE, torques), *(f"{DRIVE['spring']}({name})" for name in springs))
    return (*usual, *passive_drives(mechanism, axes, (*USUAL_DRIVE, "spring"), torques))


def passive_drives(mechanism: Mechanism, axes: Axes, kinds: Sequence[str], torques: Sequence[int]) -> tuple[str, ...]:
    """Names of the columns of drives that the model states of dependent joints, arguments as above."""
    moved = [name for name in axes.dependent if torques and name in mechanism.drives]
    pairs = [(kind, name) for kind in kinds for name in moved if mechanism.drives[name].value(kind)]
    return tuple(f"{DRIVE[kind]}({name})" for kind, name in pairs)


def absorbed_note(mechanism: Mechanism, lost: Sequence[str], mixed: Sequence[str] = ()) -> str:
    """Note on drives whose columns depend on those of the links, and of the mixed drives of other motors."""
    beside = f" and from {', '.join(mixed)}" if mixed else ""
    note = f"{', '.join(lost)} cannot be told from the links' inertias{beside}, which take them up"
    if not (stated := [name for name, value in zip(lost, stated_values(mechanism, lost), strict=True) if value]):
        return f"{note}."
    return f"{note}; bodies are computed with the model's {', '.join(stated)}."
