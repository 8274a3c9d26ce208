"""Derivatives by reverse-mode differentiation, of signals on a tape and of functions of a regressor.

They are recorded as further signals of the same tape.

Backwards from a result y, the adjoint x̄ = ∂y/∂x of every operand is increased by ȳ times the operation's derivative
(Griewank and Walther, *Evaluating Derivatives*, 2008, doi:10.1137/1.9780898717761). A function of a regressor needs one
sweep over the recorded equations,

    f(Y(q, q̇, q̈)),  Ȳ = ∂f/∂Y   ->   ∂f/∂(q, q̇, q̈) = Σ Ȳ · ∂Y/∂(q, q̇, q̈)

with Ȳ among the inputs: it takes a few times as long as Y, whatever the number of joints.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from heapq import heappop, heappush

import numpy as np

from ident.errors import InputError
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.model.regressor import chunk, one_sample, program_inputs
from ident.model.tape import Number, Program, Signal, Tape

Value = Signal | Number

_DERIVATIVES: dict[np.ufunc, Callable[..., tuple[Value, ...]]] = {
    np.negative: lambda y, a, x: (-a,),
    np.add: lambda y, a, x, z: (a, a),
    np.subtract: lambda y, a, x, z: (a, -a),
    np.multiply: lambda y, a, x, z: (a * z, a * x),
    np.divide: lambda y, a, x, z: (a / z, -(a * y / z)),
    np.sin: lambda y, a, x: (a * x.cos(),),
    np.cos: lambda y, a, x: (-(a * x.sin()),),
    np.tanh: lambda y, a, x: (a - a * (y * y),),
}
"""Adjoints of the operands, from the result y, its adjoint a, and the operands."""


def gradient(result: Value, inputs: Sequence[Signal]) -> list[Value]:
    """Derivatives of a result with respect to inputs of its tape.

    Args:
        result: A signal, or a number, whose derivatives are zero.
        inputs: Inputs of the tape.

    Returns:
        For each input a signal, or a number if the derivative is constant.
    """
    if not isinstance(result, Signal):
        return [0.0] * len(inputs)
    tape = result.tape
    adjoints: dict[int, Value] = {result.index: 1.0}
    # Steps that the result depends on, the latest first.
    ahead = [-result.index]
    while ahead:
        index = -heappop(ahead)
        step = tape.steps[index]
        operation, operands = step
        if operation is None:
            continue
        parts = _DERIVATIVES[operation](tape.results[step], adjoints[index], *operands)
        for operand, part in zip(operands, parts, strict=True):
            if isinstance(operand, Signal):
                if operand.index in adjoints:
                    adjoints[operand.index] += part
                else:
                    adjoints[operand.index] = part
                    heappush(ahead, -operand.index)
    return [adjoints.get(signal.index, 0.0) for signal in inputs]


def pulled_back(
    mechanism: Mechanism, motion: Motion, columns: Sequence[int], adjoints: np.ndarray, *, torques: bool = False
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives of a function of a regressor with respect to the motion, for a base at rest.

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
    program = _recorded(tree, gravity, tuple(columns), torques)
    out = np.zeros((len(states), len(motion)))
    program.fill(out)
    at_once = chunk(program)
    for start in range(0, len(motion), at_once):
        part = slice(start, start + at_once)
        seeds = adjoints[part].transpose(2, 1, 0).reshape(-1, len(motion[part]))
        program.run(np.concatenate([states[:, part], seeds]), out[:, part])
    q, _, dq, ddq = np.split(out.T, np.cumsum([tree.size, len(tree.dependent), len(tree.freedoms)]), axis=1)
    return q, dq, ddq


@lru_cache(maxsize=16)
def _recorded(tree: Tree, gravity: tuple[float, ...], columns: tuple[int, ...], torques: bool) -> Program:
    """Program from joint states and adjoints (columns, rows), flattened, to the derivatives with respect to states."""
    states = tree.size + len(tree.dependent) + 2 * len(tree.freedoms)
    tape = Tape(states + len(columns) * (len(tree.freedoms) if torques else 6))
    inputs = np.array(tape.inputs)
    Y = one_sample(tree, np.array(gravity), columns, inputs[:states], torques)
    return Program.of(tape, gradient(Y @ inputs[states:], tape.inputs[:states]))
