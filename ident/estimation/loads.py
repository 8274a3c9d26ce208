"""Wrenches on the bodies of a mechanism and joint torques, for numbers or for signals of a tape.

Γ_i = Y_i φ_i            τ_J = ξ_Jᵀ Σ_carried Γ_i            Ia q̈ + Fv q̇ + Fc tanh(q̇ / SLIP) + K (q - q_0) + …

Drives of motors that move several joints together have their angles, R q, in place of q, and add Rᵀ τ_motor.
"""

import numpy as np

from ident.estimation.equations import Equations
from ident.geometry.se3 import Ad, pose
from ident.mechanism.tree import Tree
from ident.model.adjoint import Value
from ident.model.closed_form import BodyMotion, body_wrench
from ident.model.regressor import drive_signals
from ident.tolerances import DRIVE

SLIP = 0.003
"""Default velocity over which Coulomb friction changes sign, rad/s or m/s."""


def inertial_wrenches(equations: Equations, motions: list[BodyMotion], theta: np.ndarray) -> list[np.ndarray]:
    """Inertial and gravitational wrench of each body.

    Args:
        equations: The mechanism and its base parameters.
        motions: Motion of every body.
        theta: Base parameters ψ first (≥ r,). They set the standard parameters of the same names; the others keep
            the model's values.

    Returns:
        Wrench in the base frame of every body (6,), zeros for massless ones.
    """
    tree, parameters, known = equations.mechanism.tree, equations.parameters, equations.mechanism.prior
    prior = np.zeros(10 * len(tree.inertial)) if known is None else known
    kept, phi = list(parameters.kept), prior.astype(object)
    phi[kept] = theta[: parameters.rank] - (parameters.regroup(prior) - prior[kept])
    wrenches = [np.zeros(6)] * len(tree.bodies)
    for i, own in zip(tree.inertial, phi.reshape(-1, 10), strict=True):
        wrenches[i] = body_wrench(motions[i], own)
    return wrenches


def joint_torques(tree: Tree, motions: list[BodyMotion], q: np.ndarray, wrenches: list[np.ndarray]) -> list[Value]:
    """Torques of the n freedoms that balance wrenches on the bodies (6,), in the base frame (Eq. 11)."""
    carried, felt = list(wrenches), list[np.ndarray]()
    for i in reversed(range(len(tree.bodies))):
        parent = tree.bodies[i].parent
        if parent >= 0:
            carried[parent] = carried[parent] + carried[i]
    for i, body in enumerate(tree.bodies):
        screws = Ad(pose(motions[i].R, motions[i].p)) @ body.motions
        felt.append(screws.T @ carried[i])
    return list(tree.joint_sums(q, felt))


def drive_torques(
    equations: Equations, q: np.ndarray, dq: np.ndarray, ddq: np.ndarray, theta: np.ndarray, slips: np.ndarray
) -> list[Value]:
    """Torques of rotor inertia, friction and springs of the n freedoms, zero without a column for them.

    Args:
        equations: Equations with the drives' columns.
        q: Joint coordinates (n_q,).
        dq: Joint velocities (n,); `ddq` accelerations.
        theta: Parameters, those of the drives after ψ.
        slips: Velocities of the m axes over which Coulomb friction changes sign (m,).
    """
    tree, axes = equations.mechanism.tree, equations.axes
    signals = drive_signals(tree, axes, q, dq, ddq, slips, equations.mechanism.springrefs)
    at = dict(zip(equations.drives, theta[equations.parameters.rank :], strict=False))
    torques: list[Value] = [0.0] * len(tree.freedoms)
    for kind, signal in signals.items():
        for a, (name, own) in enumerate(zip(axes.names, signal, strict=True)):
            if (column := f"{DRIVE[kind]}({name})") in at:
                for k, torque in axes.shared(a, at[column] * own).items():
                    torques[k] = torques[k] + torque
    return torques
