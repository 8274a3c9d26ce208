"""Derivatives of signals on a tape by reverse-mode differentiation, recorded as further signals of the same tape.

Backwards from a result y, the adjoint x̄ = ∂y/∂x of every operand is increased by ȳ times the operation's derivative
(Griewank and Walther, *Evaluating Derivatives*, 2008, doi:10.1137/1.9780898717761).
"""

from collections.abc import Callable, Sequence
from heapq import heappop, heappush

import numpy as np

from ident.model.tape import Number, Signal

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
