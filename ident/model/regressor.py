"""Regressors of the base wrench (Eq. 14) and joint torques (Eq. 11), their derivatives, and inverse dynamics.

`ident.model.closed_form` has the equations for one sample. They are recorded once for a mechanism, and the operations
that the requested columns need are run on a few thousand samples at a time, with samples along the last axis for the
cache. `ident.model.dim` computes the same matrices equation by equation.
"""

import operator
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache

import numpy as np

from ident.annotations import typed
from ident.arguments import checked_names
from ident.errors import InputError
from ident.geometry.se3 import pose
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import BaseMotion, Motion
from ident.mechanism.tree import Tree
from ident.model import closed_form
from ident.model.axes import Axes
from ident.model.tape import Program, gradient, recording
from ident.tolerances import DRIVE, STRIBECK

CHUNK = 2048
"""Number of samples that are processed at once: enough to amortize numpy's calls where there is no compiled code, which
takes half as long again with 1024; torques of a humanoid are then 60 MB."""

FEW = 5
"""Number of samples below which the equations are not recorded but evaluated sample by sample."""


@typed("gravity", "columns")
def base_wrench_regressor(
    tree: Tree,
    q: np.ndarray,
    dq: np.ndarray,
    ddq: np.ndarray,
    *,
    gravity: np.ndarray,
    base: BaseMotion | None = None,
    columns: Sequence[int] | None = None,
    out: np.ndarray | None = None,
) -> np.ndarray:
    """Regressor of the total external wrench on a mechanism: `Γ_0 = Y φ` (Eq. 14).

    On a fixed base without contacts that is the wrench of the ground. On a moving base it is the sum of all contact
    wrenches (Eq. 3).

    Args:
        tree: The mechanism of b bodies with φ, its joints with n velocities.
        q: Joint coordinates in rad, m or quaternions (N, n_q).
        dq: Joint velocities in rad/s or m/s (N, n); `ddq` their rates (N, n).
        gravity: Acceleration of gravity in the base frame, m/s² (3,); in the inertial frame of `base.T` if given.
        base: Motion of the base frame (N samples), by default at rest.
        columns: Indices of the requested columns, by default all; only these are computed.
        out: Result of an earlier call with as many samples and columns, to be overwritten: allocating new memory costs
            more than computing its content.

    Returns:
        Y (N, 6, 10 b), rows `[F; τ]` in the base frame, columns in the order of `geometry.inertia.PARAMETERS`, or the
        requested columns in their order. The array is a view of a C-contiguous (10 b, 6, N) block.

    Raises:
        InputError: The joint arrays or `out` have other shapes, a quaternion is zero, or a column does not exist.
    """
    return _regressor(False, Mechanism(tree, gravity), Motion(q, dq, ddq, base), columns, out)


@typed("gravity", "columns", "drive")
def joint_torque_regressor(
    tree: Tree,
    q: np.ndarray,
    dq: np.ndarray,
    ddq: np.ndarray,
    *,
    gravity: np.ndarray,
    base: BaseMotion | None = None,
    columns: Sequence[int] | None = None,
    drive: Sequence[str] = (),
) -> np.ndarray:
    """Regressor of the joint torques, `τ_J = Y φ`, by the projection `τ_Ji = ξ_iᵀ Γ_i` of a link's wrench (Eq. 11).

    Args:
        tree: The mechanism; arguments as for `base_wrench_regressor`.
        q: Joint coordinates (N, n_q).
        dq: Joint velocities (N, n); `ddq` their rates (N, n).
        gravity: Acceleration of gravity, m/s² (3,).
        base: Motion of the base frame, by default at rest.
        columns: Indices of the requested φ columns, by default all.
        drive: Additional torques at every joint, out of `DRIVE`; each kind adds n columns.

    Returns:
        Y (N, n, 10 b + n len(drive)), rows in N m, or N for a prismatic joint.

    Raises:
        InputError: As for `base_wrench_regressor`, or an entry of `drive` is unknown.
    """
    drive, motion = drive_kinds(drive), Motion(q, dq, ddq, base).checked(tree)
    Y, own = _regressor(True, Mechanism(tree, gravity), motion, columns), drive_columns(tree, motion, drive)
    return np.concatenate([Y, *own], axis=2) if own else Y


def drive_names(tree: Tree, drive: Sequence[str]) -> tuple[str, ...]:
    """Names of the columns of `drive_columns`: `Ia(elbow)`, `Fv(elbow)`."""
    return tuple(f"{DRIVE[kind]}({name})" for kind in drive_kinds(drive) for name in tree.freedoms)


def drive_columns(tree: Tree, motion: Motion, drive: Sequence[str]) -> list[np.ndarray]:
    """Columns of rotor inertia, friction and springs of the freedoms, one diagonal block (N, n, n) for each kind."""
    signals = drive_signals(tree, Axes.of(tree), motion.states, None, 0.0)
    n = len(tree.freedoms)
    return [signals[kind][:, None, :n] * np.eye(n) for kind in drive_kinds(drive)]


def drive_signals(
    tree: Tree, axes: Axes, states: Sequence[np.ndarray], slips: np.ndarray | float | None, rests: np.ndarray | float
) -> dict[str, np.ndarray]:
    """Torque of each kind of drive for a coefficient of one, at the m axes (…, m), from numbers or signals of a tape.

    Args:
        tree: The mechanism's tree.
        axes: Axes on which drives act.
        states: Joint coordinates (…, n_q), velocities and accelerations (…, n).
        slips: Velocity scales of the smoothed sign of friction (m,), None for a jump.
        rests: Coordinates at which springs of freedoms and dependent joints are at rest (n + d,).
    """
    y, dy, ddy = tree.dependent_states(*states)
    dq, ddq = axes.moved(states[1], dy), axes.moved(states[2], ddy)
    sign, relative = np.sign(dq) if slips is None else np.tanh(dq / slips), dq / (STRIBECK * axes.gears)
    signals = {"rotor": ddq, "viscous": dq, "coulomb": sign, "stribeck": sign / (1 + relative * relative)}
    stretched = (
        spring_lengths(tree, states[0], rests),
        y - np.broadcast_to(rests, (m := len(tree.freedoms)) + y.shape[-1])[m:],
    )
    return signals | {"spring": axes.moved(*stretched)}


def spring_lengths(tree: Tree, q: np.ndarray, references: np.ndarray | float) -> np.ndarray:
    """Coordinates of the n freedoms less their springs' references (…, n); zero for balls, whose springs have none."""
    has_one = np.concatenate([np.zeros(0, bool), *(np.full(body.freedoms, not body.is_ball) for body in tree.bodies)])
    references = references if np.ndim(references) == 0 else np.asarray(references)[: len(has_one)]
    return tree.freedom_coordinates(q) - references * has_one


def drive_kinds(drive: Sequence[str]) -> tuple[str, ...]:
    """Kinds of drive columns, checked.

    Raises:
        InputError: They are no list, or one is not in `DRIVE`.
    """
    return checked_names("drive", drive, DRIVE)


def _regressor(
    torques: bool, mechanism: Mechanism, motion: Motion, columns: Sequence[int] | None, out: np.ndarray | None = None
) -> np.ndarray:
    """Rows of the base wrench or of the joint torques (N, rows, columns)."""
    tree, gravity = mechanism.tree, mechanism.gravity.astype(float)
    motion, indices = motion.checked(tree), _checked_columns(tree, columns)
    samples, rows = len(motion), len(tree.freedoms) if torques else 6
    shape = len(indices), rows, samples
    memory = np.zeros(shape) if out is None else _checked_memory(out, shape)
    flat = memory.reshape(len(indices) * rows, samples)
    if samples < FEW:
        for k, x in enumerate(program_inputs(tree, motion, gravity).T):
            flat[:, k] = one_sample(tree, gravity, indices, x, torques)
        return memory.transpose(2, 1, 0)
    program = regressor_program(mechanism, indices, moving=motion.base is not None, torques=torques)
    if out is not None:
        flat[~program.written] = 0
    program.fill(flat)
    for start in range(0, samples, CHUNK):
        part = slice(start, start + CHUNK)
        program.run(program_inputs(tree, motion[part], gravity), flat[:, part])
    return memory.transpose(2, 1, 0)


def _checked_memory(out: np.ndarray, shape: tuple[int, int, int]) -> np.ndarray:
    """The block behind an earlier result (columns, rows, N)."""
    block, needed = out.T, "`out` needs to be what an earlier call returned"
    if block.shape != shape or block.dtype != float:
        raise InputError(f"{needed}, float64 {shape[::-1]}, got {out.dtype} {out.shape}.")
    if not block.flags.c_contiguous:
        strides = np.empty(shape).T.strides
        raise InputError(
            f"{needed}, whose samples lie next to each other in memory, strides {strides}; it has strides "
            f"{out.strides}. np.empty({shape}).T has the right ones."
        )
    if not block.flags.writeable:
        raise InputError(f"{needed}, to be overwritten, but it is read-only.")
    return block


def _checked_columns(tree: Tree, columns: Sequence[int] | None) -> tuple[int, ...]:
    number = 10 * len(tree.inertial)
    indices = tuple(range(number)) if columns is None else tuple(map(operator.index, columns))
    missing = [k for k in indices if not 0 <= k < number]
    if missing:
        raise InputError(f"This mechanism has columns 0 to {number - 1}, not {missing[0]}.")
    return indices


def regressor_program(mechanism: Mechanism, columns: Sequence[int], *, moving: bool, torques: bool) -> Program:
    """Program that computes the requested columns from `program_inputs`: results (columns, rows), flattened.

    Args:
        mechanism: The mechanism of b bodies.
        columns: Indices of the requested columns.
        moving: True if the base moves.
        torques: True if the rows are the joints' torques instead of the base wrench.
    """
    gravity = tuple(mechanism.gravity.astype(float).tolist())
    return _recorded(mechanism.tree, gravity, tuple(columns), moving, torques)


@lru_cache(maxsize=64)
def _recorded(tree: Tree, gravity: tuple[float, ...], columns: tuple[int, ...], moving: bool, torques: bool) -> Program:
    with recording(freedoms(tree)[-1] + (9 if moving else 0)) as tape:
        return Program.of(tape, one_sample(tree, np.array(gravity), columns, np.array(tape.inputs), torques).tolist())


def one_sample(
    tree: Tree, gravity: np.ndarray, columns: tuple[int, ...], inputs: np.ndarray, torques: bool
) -> np.ndarray:
    """The requested columns, flattened, from one sample of `program_inputs`, as numbers or signals."""
    q, dq, ddq, root = np.split(inputs, freedoms(tree))
    w, dw, a = root.reshape(3, 3) if len(root) else (np.zeros(3), np.zeros(3), -gravity)
    motions = closed_form.body_motions(tree, closed_form.base_motion(w, dw, a), q, dq, ddq)
    Y = closed_form.base_wrench_rows(tree, motions)
    if torques:
        Y = closed_form.joint_torque_rows(tree, motions, q, Y)
    return Y.T[list(columns)].ravel()


def freedoms(tree: Tree) -> np.ndarray:
    """Ends of joint coordinates, velocities and accelerations among the inputs."""
    return np.cumsum([tree.size + len(tree.dependent), len(tree.freedoms), len(tree.freedoms)])


def program_inputs(tree: Tree, motion: Motion, gravity: np.ndarray) -> np.ndarray:
    """Inputs of a `regressor_program` for a tree's motion: joint states, and the base's motion if it moves (n, N).

    The samples of an input are contiguous in memory.
    """
    rows = [x.T for x in (tree.started(motion.q), motion.dq, motion.ddq)]
    if (base := motion.base) is not None:
        w, v = base.V[:, 3:], base.V[:, :3]
        down = np.asarray(gravity, float) @ base.T[:, :3, :3]
        rows += [w.T, base.dV[:, 3:].T, (base.dV[:, :3] + np.cross(w, v) - down).T]
    out = np.empty((sum(map(len, rows)), len(motion)))
    return np.concatenate(rows, out=out)


def pulled_back(
    mechanism: Mechanism, motion: Motion, columns: Sequence[int], adjoints: np.ndarray, *, torques: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives of a function f of a regressor with respect to the motion, for a base at rest.

        Ȳ = ∂f/∂Y   ->   ∂f/∂(q, q̇, q̈) = Σ Ȳ · ∂Y/∂(q, q̇, q̈)

    With Ȳ among the inputs, one sweep over the recorded equations takes a few times as long as Y, whatever the number
    of joints.

    Args:
        mechanism: The mechanism, of n velocities.
        motion: Joint states of N samples.
        columns: Indices of the regressor's columns in the function (k,).
        adjoints: Derivatives Ȳ with respect to the regressor's entries (N, rows, k).
        torques: True if the rows are the joints' torques instead of the base wrench.

    Returns:
        Derivatives with respect to q (N, n_q), q̇ and q̈ (N, n).

    Raises:
        InputError: The motion does not fit the mechanism, its base moves, or the adjoints do not fit both.
    """
    motion, tree = motion.checked(mechanism.tree), mechanism.tree
    shape = len(motion), len(tree.freedoms) if torques else 6, len(columns)
    if motion.base is not None or adjoints.shape != shape:
        raise InputError(f"A base at rest and adjoints of shape {shape} are needed, got {adjoints.shape}.")
    states = program_inputs(tree, motion, mechanism.gravity)
    gravity = tuple(mechanism.gravity.astype(float).tolist())
    program = _derivatives(tree, gravity, tuple(columns), torques)
    out = np.zeros((len(states), len(motion)))
    program.fill(out)
    for start in range(0, len(motion), CHUNK):
        part = slice(start, start + CHUNK)
        seeds = adjoints[part].transpose(2, 1, 0).reshape(-1, len(motion[part]))
        program.run(np.concatenate([states[:, part], seeds]), out[:, part])
    q, _, dq, ddq = np.split(out.T, np.cumsum([tree.size, len(tree.dependent), len(tree.freedoms)]), axis=1)
    return q, dq, ddq


@lru_cache(maxsize=16)
def _derivatives(tree: Tree, gravity: tuple[float, ...], columns: tuple[int, ...], torques: bool) -> Program:
    """Program from joint states and adjoints (columns, rows), flattened, to the derivatives with respect to states."""
    states = tree.size + len(tree.dependent) + 2 * len(tree.freedoms)
    with recording(states + len(columns) * (len(tree.freedoms) if torques else 6)) as tape:
        inputs = np.array(tape.inputs)
        Y = one_sample(tree, np.array(gravity), columns, inputs[:states], torques)
        return Program.of(tape, gradient(Y @ inputs[states:], tape.inputs[:states]))


def inverse_dynamics(
    tree: Tree, motion: Motion, phi: np.ndarray, gravity: np.ndarray, longer: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Wrench on the mechanism in the base frame (N, 6), and joint torques (N, n), for given parameters.

    It takes a fraction of the regressor's operations; φ, gravity and lengths are inputs of the recorded equations.

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
    program = _dynamics(tree, moving, longer is not None)
    lengths = np.zeros(0) if longer is None else 1 + longer
    constants = np.concatenate([np.zeros(0) if moving else -np.asarray(gravity, float), phi, lengths])
    out = np.zeros((program.results, len(motion)))
    program.fill(out)
    for first in range(0, len(motion), CHUNK):
        part = slice(first, first + CHUNK)
        program.run(program_inputs(tree, motion[part], gravity), out[:, part], constants)
    return out[:6].T, out[6:].T


@lru_cache(maxsize=64)
def _dynamics(tree: Tree, moving: bool, stretched: bool) -> Program:
    """Program that computes wrench and torques from `program_inputs`, acceleration at rest, φ, and relative lengths."""
    ends = freedoms(tree)
    ends = np.append(ends, ends[-1] + np.cumsum([9 if moving else 3, 10 * len(tree.inertial)]))
    with recording(int(ends[-1]) + stretched * len(tree.bodies)) as tape:
        q, dq, ddq, root, phi, lengths = np.split(np.array(tape.inputs), ends)
        if stretched:
            pairs = zip(tree.bodies, lengths, strict=True)
            bodies = (replace(body, home=pose(body.home[:3, :3], body.home[:3, 3] * length)) for body, length in pairs)
            tree = replace(tree, bodies=tuple(bodies))
        w, dw, a = root.reshape(3, 3) if moving else (np.zeros(3), np.zeros(3), root)
        motions = closed_form.body_motions(tree, closed_form.base_motion(w, dw, a), q, dq, ddq)
        wrenches = closed_form.body_wrenches(tree, motions, phi)
        return Program.of(tape, [*np.sum(wrenches, axis=0), *closed_form.joint_torques(tree, motions, q, wrenches)])
