"""Recording of arithmetic for one sample, and its execution for thousands of samples at a time.

Formulas are evaluated with `Signal`s in place of numbers, in arrays of dtype object, and every operation is recorded on
a `Tape`. Zeros and ones are folded, repeated operations are recorded once, and a `Program` keeps only the operations
that its results need. Terms that are zero or constant for a mechanism's geometry therefore cost nothing.

Derivatives are further signals of the same tape, by reverse-mode differentiation: backwards from a result y, the
adjoint x̄ = ∂y/∂x of every operand is increased by ȳ times the operation's derivative (Griewank and Walther,
*Evaluating Derivatives*, 2008, doi:10.1137/1.9780898717761).
"""

import gc
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import cast

import numpy as np

from ident.model import compiled
from ident.model.compiled import Instruction

Number = int | float


class Tape:
    """A record of operations, each on earlier results, inputs or numbers.

    Attributes:
        signals: The inputs, and then the result of every operation, in the order in which they were recorded.
        inputs: The inputs.
        results: Result of every operation on its operands.
    """

    def __init__(self, inputs: int) -> None:
        self.signals = [Signal(self, k) for k in range(inputs)]
        self.inputs = self.signals.copy()
        self.results: dict[tuple[np.ufunc, tuple[Signal | Number, ...]], Signal] = {}

    def record(self, operation: np.ufunc, *operands: "Signal | Number") -> "Signal":
        """Records an operation, unless it is on the tape already, and returns its result."""
        step = operation, operands
        known = self.results.get(step)
        if known is None:
            known = self.results[step] = Signal(self, len(self.signals), operation, operands)
            self.signals.append(known)
        return known


class Signal:
    """A quantity with a value for each sample: an input, or the result of a recorded operation.

    Attributes:
        tape: The tape on which it is recorded.
        index: Its index there.
        operation: The operation, None of an input.
        operands: Its operands.
        opposite: The signal of which it is the negative, if it was recorded as one.
    """

    __slots__ = ("index", "operands", "operation", "opposite", "tape")

    def __init__(
        self, tape: Tape, index: int, operation: np.ufunc | None = None, operands: tuple["Signal | Number", ...] = ()
    ) -> None:
        self.tape, self.index, self.operation, self.operands = tape, index, operation, operands
        self.opposite: Signal | None = None

    def __neg__(self) -> "Signal":
        if self.opposite is not None:
            return self.opposite
        negative = self.tape.record(np.negative, self)
        negative.opposite = self
        return negative

    def __add__(self, other: "Signal | Number") -> "Signal | Number":
        if not isinstance(other, Signal):
            if not isinstance(other, Number):
                return NotImplemented
            return self if other == 0 else self.tape.record(np.add, self, other)
        if other.opposite is not None:
            return self - other.opposite
        if self.opposite is not None:
            return other - self.opposite
        return self.tape.record(np.add, *_by_age(self, other))

    __radd__ = __add__

    def __sub__(self, other: "Signal | Number") -> "Signal | Number":
        if not isinstance(other, Signal):
            if not isinstance(other, Number):
                return NotImplemented
            return self if other == 0 else self.tape.record(np.subtract, self, other)
        if other is self:
            return 0.0
        if other.opposite is not None:
            return self + other.opposite
        return self.tape.record(np.subtract, self, other)

    def __rsub__(self, other: Number) -> "Signal":
        return -self if other == 0 else self.tape.record(np.subtract, other, self)

    def __mul__(self, other: "Signal | Number") -> "Signal | Number":
        if not isinstance(other, Signal):
            if not isinstance(other, Number):
                return NotImplemented
            if other in (0, 1):
                return self if other else 0.0
            if other == -1:
                return -self
            return self.tape.record(np.multiply, self, other) if self.opposite is None else -(self.opposite * other)
        if self.opposite is not None:
            return -(self.opposite * other)
        if other.opposite is not None:
            return -(self * other.opposite)
        return self.tape.record(np.multiply, *_by_age(self, other))

    __rmul__ = __mul__

    def __truediv__(self, other: "Signal | Number") -> "Signal":
        return self.tape.record(np.divide, self, other)

    def __rtruediv__(self, other: Number) -> "Signal":
        return self.tape.record(np.divide, other, self)

    def tanh(self) -> "Signal":
        """Hyperbolic tangent; `np.tanh` of an array of signals calls it."""
        return self.tape.record(np.tanh, self)

    def sin(self) -> "Signal":
        """Sine; `np.sin` of an array of signals calls it."""
        return self.tape.record(np.sin, self)

    def cos(self) -> "Signal":
        """Cosine; `np.cos` of an array of signals calls it."""
        return self.tape.record(np.cos, self)


@contextmanager
def recording(inputs: int) -> Iterator[Tape]:
    """Gives a tape for a block, without garbage collection: searches of a tape for garbage took half of its recording.

    Signals and their tape refer to each other; it is cleared in the end, so that nothing of it waits to be collected.
    """
    enabled, tape = gc.isenabled(), Tape(inputs)
    gc.disable()
    try:
        yield tape
    finally:
        for record in (tape.signals, tape.inputs, tape.results):
            record.clear()
        if enabled:
            gc.enable()


def _by_age(one: Signal, other: Signal) -> tuple[Signal, Signal]:
    """Two signals in the order in which they were recorded, so that `a + b` and `b + a` are one step."""
    return (one, other) if one.index < other.index else (other, one)


Value = Signal | Number

_DERIVATIVES: dict[np.ufunc, tuple[Callable[..., Value], ...]] = {
    np.negative: (lambda y, a, x: -a,),
    np.add: (lambda y, a, x, z: a, lambda y, a, x, z: a),
    np.subtract: (lambda y, a, x, z: a, lambda y, a, x, z: -a),
    np.multiply: (lambda y, a, x, z: a * z, lambda y, a, x, z: a * x),
    np.divide: (lambda y, a, x, z: a / z, lambda y, a, x, z: -(a * y / z)),
    np.sin: (lambda y, a, x: a * x.cos(),),
    np.cos: (lambda y, a, x: -(a * x.sin()),),
    np.tanh: (lambda y, a, x: a - a * (y * y),),
}
"""Adjoint of each operand, from the result y, its adjoint a, and the operands."""


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
    # Adjoints of the signals that the result depends on, None of others.
    adjoints: list[Value | None] = [None] * len(result.tape.signals)
    adjoints[result.index] = 1.0
    for signal in reversed(result.tape.signals[len(result.tape.inputs) : result.index + 1]):
        adjoint, operands = adjoints[signal.index], signal.operands
        if adjoint is None or signal.operation is None:
            continue
        for operand, derivative in zip(operands, _DERIVATIVES[signal.operation], strict=True):
            if isinstance(operand, Signal):
                part, before = derivative(signal, adjoint, *operands), adjoints[operand.index]
                adjoints[operand.index] = part if before is None else before + part
    return [adjoints[signal.index] or 0.0 for signal in inputs]


@dataclass(frozen=True)
class Program:
    """Instructions that compute chosen results, with reused memory for intermediate ones.

    Operands and targets are places in one sequence of arrays: inputs, numbers, results, registers.

    Attributes:
        inputs: Number of inputs n.
        numbers: Numbers among the operands.
        results: Number of results K.
        registers: Number of intermediate results that are alive at once.
        constants: Indices and values of the results that are nonzero numbers.
        code: Operation, places of its one or two operands (else None), and place of its result.
    """

    inputs: int
    numbers: tuple[float, ...]
    results: int
    registers: int
    constants: tuple[tuple[int, float], ...]
    code: tuple[Instruction, ...]

    @classmethod
    def of(cls, tape: Tape, results: Sequence[Signal | Number]) -> "Program":
        """Program for given results (K,), signals of a tape or numbers."""
        outputs = {k: x.index for k, x in enumerate(results) if isinstance(x, Signal)}
        last_use, inputs = _last_uses(tape, outputs.values()), len(tape.inputs)
        needed = [signal for signal in tape.signals[inputs:] if last_use[signal.index] >= 0]
        operands = [x for signal in needed for x in signal.operands if not isinstance(x, Signal)]
        numbers = {x: k for k, x in enumerate(dict.fromkeys(map(float, operands)), inputs)}
        first_result = inputs + len(numbers)
        place = [*range(inputs), *[-1] * (len(tape.signals) - inputs)]
        for k, i in outputs.items():
            place[i] = first_result + k if place[i] < 0 else place[i]
        registers, spare = 0, list[int]()
        code = list[Instruction]()
        for signal in needed:
            used, i = list[int](), signal.index
            for x in signal.operands:
                if isinstance(x, Signal):
                    used.append(place[x.index])
                    if last_use[x.index] == i:
                        spare.append(place[x.index])
                        last_use[x.index] = len(last_use)
                else:
                    used.append(numbers[x])
            if place[i] < 0:
                if not spare:
                    spare.append(first_result + len(results) + registers)
                    registers += 1
                place[i] = spare.pop()
            code.append((cast(np.ufunc, signal.operation), used[0], used[1] if len(used) > 1 else None, place[i]))
        # Results that are inputs, or are requested twice, are copied from another place.
        elsewhere = {first_result + k: place[i] for k, i in outputs.items() if place[i] != first_result + k}
        code += [(np.positive, source, None, target) for target, source in elsewhere.items()]
        constants = tuple((k, float(x)) for k, x in enumerate(results) if not isinstance(x, Signal) and x != 0)
        return cls(inputs, tuple(numbers), len(results), registers, constants, tuple(code))

    def fill(self, out: np.ndarray) -> None:
        """Writes the constant results into zeros (K, N); needed once for any number of runs."""
        for k, value in self.constants:
            out[k] = value

    @cached_property
    def written(self) -> np.ndarray:
        """Mask of the results that are written, those that are not identically zero (K,)."""
        out = np.zeros(self.results, bool)
        first = self.inputs + len(self.numbers)
        out[[k for k, _ in self.constants]] = True
        out[[target - first for *_, target in self.code if first <= target < first + self.results]] = True
        return out

    @cached_property
    def encoded(self) -> compiled.Encoded:
        """The program encoded for compiled code."""
        operands = self.inputs + len(self.numbers)
        return compiled.Encoded((operands, self.results, self.registers), self.code)

    def run(self, inputs: np.ndarray, out: np.ndarray, constants: Sequence[float] | np.ndarray = ()) -> None:
        """Writes the results that depend on the inputs into `out` (K, C), and leaves the others unchanged.

        Args:
            inputs: All inputs but the last k, samples contiguous in memory (n - k, C).
            out: Array for the results, likewise.
            constants: The last k inputs, if they are the same for all samples (k,).
        """
        numbers = np.array([*constants, *self.numbers])
        if out.shape[1] and compiled.available():
            self.encoded.run(numbers, inputs, out)
            return
        registers = np.empty((self.registers, out.shape[1]))
        row = [*inputs, *numbers, *out, *registers]
        for operation, a, b, target in self.code:
            if b is None:
                operation(row[a], row[target])
            else:
                operation(row[a], row[b], row[target])


def _last_uses(tape: Tape, outputs: Iterable[int]) -> list[int]:
    """Last use of every signal, beyond the tape for inputs and results; -1 where no result depends on it."""
    never = len(tape.signals)
    last = [-1] * never
    for i in outputs:
        last[i] = never
    for signal in reversed(tape.signals):
        if last[signal.index] >= 0:
            for x in signal.operands:
                if isinstance(x, Signal) and last[x.index] < 0:
                    last[x.index] = signal.index
    last[: len(tape.inputs)] = [never] * len(tape.inputs)
    return last
