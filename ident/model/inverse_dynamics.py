"""Wrench and joint torques of bodies with given parameters, for many samples at once.

Γ_i = Y_i φ_i            Γ_0 = Σ_i Γ_i            τ_J = ξ_Jᵀ Σ_carried Γ_i

These take a fraction of the regressor's operations, and φ, gravity and lengths are inputs of the recorded equations.
"""

from dataclasses import replace
from functools import lru_cache

import numpy as np

from ident.geometry.se3 import Ad, pose
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.model import closed_form
from ident.model.regressor import CHUNK, freedoms, program_inputs
from ident.model.tape import Program, Tape, uncollected


def inverse_dynamics(
    tree: Tree, motion: Motion, phi: np.ndarray, gravity: np.ndarray, longer: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Wrench on the mechanism in the base frame (N, 6), and joint torques (N, n).

    Args:
        tree: The mechanism of b bodies with φ.
        motion: Its motion (N samples).
        phi: Parameters of the bodies (10 b,).
        gravity: Acceleration of gravity, in the inertial frame if the base moves, else in the base frame (3,).
        longer: Relative increase of every body's distance from its parent's frame, None for none (bodies,).

    Raises:
        InputError: The motion does not fit the mechanism.
    """
    motion, moving = motion.checked(tree), motion.base is not None
    program = _program(tree, moving, longer is not None)
    lengths = np.zeros(0) if longer is None else 1 + longer
    constants = np.concatenate([np.zeros(0) if moving else -np.asarray(gravity, float), phi, lengths])
    out = np.zeros((program.results, len(motion)))
    program.fill(out)
    for first in range(0, len(motion), CHUNK):
        part = slice(first, first + CHUNK)
        program.run(program_inputs(tree, motion[part], gravity), out[:, part], constants)
    return out[:6].T, out[6:].T


@lru_cache(maxsize=64)
@uncollected()
def _program(tree: Tree, moving: bool, stretched: bool) -> Program:
    """Program that computes wrench and torques from `program_inputs`, acceleration at rest, φ, and relative lengths."""
    ends = freedoms(tree)
    ends = np.append(ends, ends[-1] + np.cumsum([9 if moving else 3, 10 * len(tree.inertial)]))
    tape = Tape(int(ends[-1]) + stretched * len(tree.bodies))
    q, dq, ddq, root, phi, lengths = np.split(np.array(tape.inputs), ends)
    if stretched:
        pairs = zip(tree.bodies, lengths, strict=True)
        bodies = (replace(body, home=pose(body.home[:3, :3], body.home[:3, 3] * length)) for body, length in pairs)
        tree = replace(tree, bodies=tuple(bodies))
    w, dw, a = root.reshape(3, 3) if moving else (np.zeros(3), np.zeros(3), root)
    motions = closed_form.body_motions(tree, closed_form.base_motion(w, dw, a), q, dq, ddq)
    wrenches = body_wrenches(tree, motions, phi)
    return Program.of(tape, [*np.sum(wrenches, axis=0), *joint_torques(tree, motions, q, wrenches)])


def body_wrenches(tree: Tree, motions: list[closed_form.BodyMotion], phi: np.ndarray) -> list[np.ndarray]:
    """Inertial and gravitational wrench of every body in the base frame (6,), zeros for massless ones."""
    wrenches = [np.zeros(6)] * len(tree.bodies)
    for i, own in zip(tree.inertial, phi.reshape(-1, 10), strict=True):
        wrenches[i] = closed_form.body_wrench(motions[i], own)
    return wrenches


def joint_torques(
    tree: Tree, motions: list[closed_form.BodyMotion], q: np.ndarray, wrenches: list[np.ndarray]
) -> np.ndarray:
    """Torques of the n freedoms that balance wrenches on the bodies (6,), in the base frame (Eq. 11)."""
    carried, felt = list(wrenches), list[np.ndarray]()
    for i in reversed(range(len(tree.bodies))):
        parent = tree.bodies[i].parent
        if parent >= 0:
            carried[parent] = carried[parent] + carried[i]
    for i, body in enumerate(tree.bodies):
        screws = Ad(pose(motions[i].R, motions[i].p)) @ body.motions
        felt.append(screws.T @ carried[i])
    return tree.joint_sums(q, felt)
