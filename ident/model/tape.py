"""Arithmetic written down once, for one sample, and carried out for thousands at a time.

Formulas run on `Signal`s in place of numbers, in arrays of dtype object, and every operation is recorded on a `Tape`.
Zeros and ones fold away, an operation that stands on the tape already is not written again, and a `Program` keeps what
its outputs need and no more. What a mechanism's geometry makes zero or constant therefore costs nothing later.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.model import compiled
from ident.model.steps import Instruction

Number = int | float


class Tape:
    """A record of operations, each on earlier results, inputs or numbers.

    Attributes:
        steps: Every operation and its operands, in the order of their results; None and nothing for an input.
        inputs: The inputs, which are the first results.
        results: What each of the other steps gives.
    """

    def __init__(self, inputs: int) -> None:
        self.steps: list[Step] = [(None, ())] * inputs
        self.inputs = [Signal(self, k) for k in range(inputs)]
        self.results: dict[Step, Signal] = {}

    def record(self, operation: np.ufunc, *operands: "Signal | Number") -> "Signal":
        """The result of an operation."""
        step = operation, operands
        known = self.results.get(step)
        if known is None:
            known = self.results[step] = Signal(self, len(self.steps))
            self.steps.append(step)
        return known


class Signal:
    """A number of each sample: an input, or the result of a recorded operation.

    Attributes:
        tape: Where it stands.
        index: The step that gives it.
        opposite: What this signal is the negative of, if it was made so.
    """

    __slots__ = ("index", "opposite", "tape")

    def __init__(self, tape: Tape, index: int) -> None:
        self.tape, self.index = tape, index
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
        """Sine, likewise."""
        return self.tape.record(np.sin, self)

    def cos(self) -> "Signal":
        """Cosine, likewise."""
        return self.tape.record(np.cos, self)


def _by_age(one: Signal, other: Signal) -> tuple[Signal, Signal]:
    """Two signals in the order in which they were recorded: sums and products are the same either way."""
    return (one, other) if one.index < other.index else (other, one)


Step = tuple[np.ufunc | None, tuple[Signal | Number, ...]]
"""An operation and what it is done to."""


@dataclass(frozen=True)
class Program:
    """What has to be done to get chosen results, in memory that is used again and again.

    Operands and targets are places in one row of arrays: inputs, numbers, results, registers.

    Attributes:
        inputs: Number of inputs n.
        numbers: Numbers among the operands.
        results: Number of results K.
        registers: Number of intermediate results that are alive at once.
        constants: Places in the results of those that are numbers other than zero, with their values.
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
        """The program that gives these results (K,), signals of a tape or numbers."""
        wanted = {k: x.index for k, x in enumerate(results) if isinstance(x, Signal)}
        last_use = _last_uses(tape, set(wanted.values()))
        steps = [(i, *tape.steps[i]) for i in sorted(last_use)]
        numbers = dict.fromkeys(float(x) for *_, xs in steps for x in xs if not isinstance(x, Signal))
        numbered = {x: len(tape.inputs) + k for k, x in enumerate(numbers)}
        first_result = len(tape.inputs) + len(numbers)
        place = {signal.index: k for k, signal in enumerate(tape.inputs)}
        for k, i in wanted.items():
            place.setdefault(i, first_result + k)
        registers, spare = 0, list[int]()
        code = list[Instruction]()
        for i, operation, operands in steps:
            if operation is None:
                continue
            used = [place[x.index] if isinstance(x, Signal) else numbered[x] for x in operands]
            spare += {place[x.index] for x in operands if isinstance(x, Signal) and last_use[x.index] == i}
            if i not in place:
                if not spare:
                    spare.append(first_result + len(results) + registers)
                    registers += 1
                place[i] = spare.pop()
            code.append((operation, used[0], used[1] if len(used) > 1 else None, place[i]))
        # Results that are inputs, or are wanted twice, have a place elsewhere.
        elsewhere = {first_result + k: place[i] for k, i in wanted.items() if place[i] != first_result + k}
        code += [(np.positive, source, None, target) for target, source in elsewhere.items()]
        constants = tuple((k, float(x)) for k, x in enumerate(results) if not isinstance(x, Signal) and x != 0)
        return cls(len(tape.inputs), tuple(numbers), len(results), registers, constants, tuple(code))

    def fill(self, out: np.ndarray) -> None:
        """Writes the constant results into zeros (K, N), once for any number of runs."""
        for k, value in self.constants:
            out[k] = value

    @cached_property
    def written(self) -> np.ndarray:
        """Which results are not zero whatever the inputs are (K,)."""
        out = np.zeros(self.results, bool)
        first = self.inputs + len(self.numbers)
        out[[k for k, _ in self.constants]] = True
        out[[target - first for *_, target in self.code if first <= target < first + self.results]] = True
        return out

    @cached_property
    def encoded(self) -> compiled.Encoded:
        """The same for compiled code."""
        operands = self.inputs + len(self.numbers)
        return compiled.Encoded((operands, self.results, self.registers), self.code)

    def run(self, inputs: np.ndarray, out: np.ndarray, constants: Sequence[float] | np.ndarray = ()) -> None:
        """Writes the results that depend on the inputs into `out` (K, C), and leaves the others as they are.

        Args:
            inputs: The first of the inputs, samples next to each other in memory (n - k, C).
            out: Where to, likewise.
            constants: The last inputs, if they are the same for all samples (k,).
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


def _last_uses(tape: Tape, wanted: set[int]) -> dict[int, int]:
    """For every step that results depend on, the last step that uses it; for inputs and results none."""
    never = len(tape.steps)
    last = dict.fromkeys(wanted, never)
    for i in reversed(range(never)):
        for x in tape.steps[i][1] if i in last else ():
            if isinstance(x, Signal):
                last.setdefault(x.index, never if tape.steps[x.index][0] is None else i)
    return last
