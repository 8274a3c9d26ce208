"""Derivatives of functions of a regressor with respect to the motion, by one reverse sweep over the recorded equations.

    f(Y(q, q̇, q̈)),  Ȳ = ∂f/∂Y   ->   ∂f/∂(q, q̇, q̈) = Σ Ȳ · ∂Y/∂(q, q̇, q̈)

takes a few times as long as Y, whatever the number of joints. The sum is recorded with Ȳ among the inputs, and its
gradient on the same tape (`ident.model.adjoint`).
"""

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from ident.errors import InputError
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.model.adjoint import gradient
from ident.model.regressor import chunk, one_sample, program_inputs
from ident.model.tape import Program, Tape


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
