"""Regressors of the base wrench (Eq. 14) and of the joint torques (Eq. 11), for many samples at once.

`ident.model.closed_form` writes the equations for one sample. They are recorded once for a mechanism, and what the
requested columns need of them is carried out on a few thousand samples at a time, laid out samples-last, so that every
operation streams through the cache. `ident.model.dim` computes the same matrices term by term.
"""

import operator
from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from ident.arguments import checked_names
from ident.errors import InputError
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import BaseMotion, Motion
from ident.mechanism.tree import Tree
from ident.model import closed_form, compiled
from ident.model.tape import Program, Tape
from ident.tolerances import DRIVE, STRIBECK

CHUNK, LEAST_CHUNK = 4096, 1024
"""Samples worked on together, at most and at least: enough to make the calls that work on them worth their while."""

MEMORY, MEMORY_COMPILED = 2**24, 2**21
"""Bytes that results and registers of a program take then: few enough to stay in a cache. Large programs would take
less, but without compiled code the calls of numpy for fewer samples take longer than their memory does."""

FEW = 5
"""Samples below which the equations are not recorded but evaluated one by one."""


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
    """Regressor of the wrench that everything outside exerts on a mechanism: `Γ_0 = Y φ` (Eq. 14).

    On a fixed base that is the wrench of the ground, where nothing else touches the mechanism. On a moving base it is
    the sum of all contact wrenches (Eq. 3).

    Args:
        tree: The mechanism of b bodies with φ, its joints with n velocities.
        q: Joint coordinates in rad, m or quaternions (N, n_q).
        dq: Joint velocities in rad/s or m/s (N, n); `ddq` their rates (N, n).
        gravity: Acceleration of gravity in the base frame, m/s² (3,); in the frame of `base.T` where that is given.
        base: Motion of the base frame (N samples), without it at rest.
        columns: Indices of the columns wanted, by default all; only these are computed.
        out: What an earlier call with as many samples and columns has returned, to be overwritten: memory that is
            touched for the first time costs more than the numbers that go there.

    Returns:
        Y (N, 6, 10 b), rows `[F; τ]` in the base frame, columns in the order of `geometry.inertia.PARAMETERS`, or those
        wanted in their order. The array is a view of a C-contiguous (10 b, 6, N) block.

    Raises:
        InputError: The joint arrays or `out` do not have these shapes, a quaternion is zero, or a column is not there.
    """
    return _regressor(False, Mechanism(tree, gravity), Motion(q, dq, ddq, base), columns, out)


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
    """Regressor of the joint torques, `τ_J = Y φ`: Eq. 11's projection `τ_Ji = ξ_iᵀ Γ_i` of the wrench on a link.

    Args:
        tree: The mechanism; arguments as for `base_wrench_regressor`.
        q: Joint coordinates (N, n_q).
        dq: Joint velocities (N, n); `ddq` their rates (N, n).
        gravity: Acceleration of gravity, m/s² (3,).
        base: Motion of the base frame, without it at rest.
        columns: Indices of the φ columns wanted, by default all.
        drive: What else takes torque at every joint, out of `DRIVE`, each n columns more, once.

    Returns:
        Y (N, n, 10 b + n len(drive)), rows in N m, or N for a prismatic joint.

    Raises:
        InputError: As for `base_wrench_regressor`, or an entry of `drive` is unknown.
    """
    drive, motion = drive_kinds(drive), Motion(q, dq, ddq, base).checked(tree)
    Y, own = _regressor(True, Mechanism(tree, gravity), motion, columns), drive_columns(motion, drive)
    return np.concatenate([Y, *own], axis=2) if own else Y


def drive_names(tree: Tree, drive: Sequence[str]) -> tuple[str, ...]:
    """Names of the columns that `joint_torque_regressor` adds: `Ia(elbow)`, `Fv(elbow)`, `Fc(elbow)`."""
    return tuple(f"{DRIVE[kind]}({freedom})" for kind in drive_kinds(drive) for freedom in tree.freedoms)


def drive_columns(motion: Motion, drive: Sequence[str], slips: np.ndarray | None = None) -> list[np.ndarray]:
    """Columns of rotor inertia and friction, one diagonal block (N, n, n) a kind.

    Args:
        motion: The motion.
        drive: Kinds of columns.
        slips: Velocities over which friction changes its sign (n,), by default none: it jumps.
    """
    kinds = drive_kinds(drive)
    sign = np.sign(motion.dq) if slips is None else np.tanh(motion.dq / slips)
    low = sign / (1 + (motion.dq / STRIBECK) ** 2)
    signal = {"rotor": motion.ddq, "viscous": motion.dq, "coulomb": sign, "stribeck": low}
    return [signal[kind][:, :, None] * np.eye(signal[kind].shape[1]) for kind in kinds]


def drive_kinds(drive: Sequence[str]) -> tuple[str, ...]:
    """Kinds of drive columns, each once.

    Raises:
        InputError: They are no list, or one is not in `DRIVE`.
    """
    return checked_names("drive", drive, DRIVE)


def _regressor(
    torques: bool,
    mechanism: Mechanism,
    motion: Motion,
    columns: Sequence[int] | None,
    out: np.ndarray | None = None,
) -> np.ndarray:
    """Rows of the base wrench or of the joint torques (N, rows, columns)."""
    tree, gravity = mechanism.tree, mechanism.gravity.astype(float)
    motion, wanted = motion.checked(tree), _checked_columns(tree, columns)
    samples, rows = len(motion), len(tree.freedoms) if torques else 6
    shape = len(wanted), rows, samples
    memory = np.zeros(shape) if out is None else _checked_memory(out, shape)
    flat = memory.reshape(len(wanted) * rows, samples)
    if samples < FEW:
        for k, x in enumerate(program_inputs(motion, gravity).T):
            flat[:, k] = one_sample(tree, gravity, wanted, x, torques)
        return memory.transpose(2, 1, 0)
    program = regressor_program(mechanism, wanted, moving=motion.base is not None, torques=torques)
    if out is not None:
        flat[~program.written] = 0
    program.fill(flat)
    for start in range(0, samples, CHUNK):
        part = slice(start, start + CHUNK)
        program.run(program_inputs(motion[part], gravity), flat[:, part])
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
    wanted = tuple(range(number)) if columns is None else tuple(map(operator.index, columns))
    missing = [k for k in wanted if not 0 <= k < number]
    if missing:
        raise InputError(f"This mechanism has columns 0 to {number - 1}, not {missing[0]}.")
    return wanted


def regressor_program(mechanism: Mechanism, columns: Sequence[int], *, moving: bool, torques: bool) -> Program:
    """What computes the requested columns from `program_inputs`: results (columns, rows), flat.

    Args:
        mechanism: The mechanism of b bodies.
        columns: Indices of the columns wanted.
        moving: Whether the base moves.
        torques: Whether the rows are the joints' torques rather than the base wrench.
    """
    gravity = tuple(mechanism.gravity.astype(float).tolist())
    return _recorded(mechanism.tree, gravity, tuple(columns), moving, torques)


@lru_cache(maxsize=64)
def _recorded(tree: Tree, gravity: tuple[float, ...], columns: tuple[int, ...], moving: bool, torques: bool) -> Program:
    tape = Tape(_freedoms(tree)[-1] + (9 if moving else 0))
    return Program.of(tape, one_sample(tree, np.array(gravity), columns, np.array(tape.inputs), torques).tolist())


def one_sample(
    tree: Tree, gravity: np.ndarray, columns: tuple[int, ...], inputs: np.ndarray, torques: bool
) -> np.ndarray:
    """The requested columns, one after the other, from one sample of `program_inputs`: numbers or signals."""
    q, dq, ddq, root = np.split(inputs, _freedoms(tree))
    w, dw, a = root.reshape(3, 3) if len(root) else (np.zeros(3), np.zeros(3), -gravity)
    motions = closed_form.body_motions(tree, closed_form.base_motion(w, dw, a), q, dq, ddq)
    Y = closed_form.base_wrench_rows(tree, motions)
    if torques:
        Y = closed_form.joint_torque_rows(tree, motions, q, Y)
    return Y.T[list(columns)].ravel()


def chunk(program: Program) -> int:
    """How many samples to work on together."""
    compiled_too = compiled.available()
    rows = program.results if compiled_too else program.results + program.registers
    most = (MEMORY_COMPILED if compiled_too else MEMORY) // (8 * max(rows, 1))
    return min(max(most, LEAST_CHUNK), CHUNK)


def _freedoms(tree: Tree) -> np.ndarray:
    """Where joint coordinates, velocities and accelerations end among the inputs."""
    return np.cumsum([sum(body.coordinates for body in tree.bodies), len(tree.freedoms), len(tree.freedoms)])


def program_inputs(motion: Motion, gravity: np.ndarray) -> np.ndarray:
    """Inputs of a `regressor_program` for a motion: joint states, and the base's motion if it moves (n, N).

    The samples of an input are next to each other in memory.
    """
    rows = [x.T for x in motion.states]
    if (base := motion.base) is not None:
        w, v = base.V[:, 3:], base.V[:, :3]
        down = np.asarray(gravity, float) @ base.T[:, :3, :3]
        rows += [w.T, base.dV[:, 3:].T, (base.dV[:, :3] + np.cross(w, v) - down).T]
    out = np.empty((sum(map(len, rows)), len(motion)))
    return np.concatenate(rows, out=out)
