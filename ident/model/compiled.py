"""Programs run by compiled code, `blocks.c`, if a compiler was available when this package was installed.

Products and negatives are fused into the sums that use them: sums, differences, negatives and products are all
`± a b ± c`, with ones and zeros for missing operands.

Everything works without it, with the same results to rounding: a sum with a product is rounded once, sines and cosines
may differ in the last two of fifty-three bits, and zeros in their sign. The environment variable
MULTICONTACT_COMPILED=0 switches it off.
"""

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from ctypes import CDLL, POINTER, Structure, byref, c_int32, c_int64, c_void_p
from functools import cache
from importlib.util import find_spec
from itertools import chain
from math import prod
from typing import Any

import numpy as np

Instruction = tuple[np.ufunc, int, int | None, int]
"""Operation, places of its one or two operands, and place of its result."""

LINEAR = 0
"""Code of `± a b ± c` in `blocks.c`."""

OTHERS = {np.sin: 1, np.cos: 2, np.tanh: 3, np.divide: 4}
"""Codes of the other operations there."""

SUMS = np.add, np.subtract
"""Operations into which a product may be fused."""

VARIABLE = "MULTICONTACT_COMPILED"
"""Environment variable that switches compiled code off."""

VERSION = 6
"""Version of the interface, as in `blocks.c`."""

BLOCK, COLUMN, TILE = 64, 136, 4
"""Samples of a block; stride of a column of samples in `grams`; and columns whose products are computed at once."""

WIDTHS = 128, 256, 512
"""Widths of registers for which code may exist, bits."""

LINE = 64
"""Bytes of a cache line; rows aligned to it are read and written faster."""


class _Program(Structure):
    """The struct `program` of `blocks.c`."""

    _fields_ = (
        *((name, c_int64) for name in ("inputs", "numbers", "results", "registers", "steps")),
        ("code", c_void_p),
    )


def available() -> bool:
    """True if there is compiled code, and it is not switched off."""
    return os.environ.get(VARIABLE) != "0" and _library() is not None


@contextmanager
def switched(on: bool) -> Iterator[None]:
    """Switches compiled code on or off for a block, for this process and those that it starts."""
    before = os.environ.get(VARIABLE)
    os.environ[VARIABLE] = str(int(on))
    try:
        yield
    finally:
        del os.environ[VARIABLE]
        if before is not None:
            os.environ[VARIABLE] = before


class Encoded:
    """A program encoded for the compiled code."""

    def __init__(self, sizes: tuple[int, int, int], code: Sequence[Instruction]) -> None:
        """Encodes a program.

        Args:
            sizes: Numbers of operands that are inputs or numbers, of results, and of registers.
            code: Its instructions.
        """
        self.operands, self.results, self.registers = sizes
        own = self.operands + self.results
        self.code = steps(code, own, own + self.registers, own + self.registers + 1)

    def run(self, numbers: np.ndarray, inputs: np.ndarray, out: np.ndarray) -> None:
        """Runs the program.

        Args:
            numbers: Numbers among its operands; their places come after the inputs'.
            inputs: Inputs, with samples last and contiguous (n, C).
            out: Array for the results, likewise (K, C), with at least one sample.
        """
        if (samples := out.shape[1]) < BLOCK:
            # The last sample is repeated to fill a block.
            filling = np.minimum(np.arange(BLOCK), samples - 1)
            block = np.take(out, filling, axis=1)
            self.run(numbers, np.take(inputs, filling, axis=1), block)
            out[:] = block[:, :samples]
            return
        _call("run", self._with(numbers), numbers.ctypes.data, *_rows(inputs), *_rows(out), samples)

    def grams(
        self,
        numbers: np.ndarray,
        inputs: np.ndarray,
        rows: np.ndarray,
        measured: np.ndarray,
        weights: np.ndarray | None,
        inverse: np.ndarray,
        changed: np.ndarray,
        first: Sequence[int],
        memory: tuple[np.ndarray, np.ndarray] | None = None,
    ) -> np.ndarray:
        """Gram matrices of columns, times a triangular matrix; the program computes the first columns.

        Args:
            numbers: As for `run`, also `inputs`.
            rows: All columns, with the constant ones written (k, C, COLUMN); overwritten.
            measured: The last column (n, C).
            weights: Weights of the rows (n, C).
            inverse: Upper triangular matrix (k, k).
            changed: Indices of the columns that it changes.
            first: Index of the first nonzero column of each channel (C,).
            memory: Share ρ of each channel's sample before that is added to each, `z_n = x_n + ρ z_n-1` (C,), and z
                before the first sample, overwritten by that of the last one (C, k).

        Returns:
            Gram matrix of each channel (C, k, k).
        """
        (k, channels, _), samples = rows.shape, len(measured)
        measured, inverse = np.ascontiguousarray(measured, float), np.ascontiguousarray(inverse)
        weights = None if weights is None else np.ascontiguousarray(weights, float)
        starts, changed = np.array(first, np.int64) // TILE * TILE, changed.astype(np.int64)
        whole = -(-k // TILE) * TILE
        sums = np.empty((channels, whole, whole))
        decay = last = None
        if memory is not None:
            decay, last = np.ascontiguousarray(memory[0], float), np.zeros((channels, whole))
            last[:, :k] = memory[1]
        _call(
            "grams",
            self._with(numbers),
            numbers.ctypes.data,
            *_rows(inputs),
            measured.ctypes.data,
            *(None if x is None else x.ctypes.data for x in (weights, decay, last)),
            *(samples, channels, k, inverse.ctypes.data, changed.ctypes.data, len(changed), starts.ctypes.data),
            *(rows.ctypes.data, sums.ctypes.data),
        )
        if memory is not None and last is not None:
            memory[1][:] = last[:, :k]
        return sums[:, :k, :k]

    def _with(self, numbers: np.ndarray) -> "_Program":
        """The struct of the program, for the given numbers."""
        sizes = self.operands - len(numbers), len(numbers), self.results, self.registers, len(self.code)
        return _Program(*sizes, self.code.ctypes.data)


def steps(code: Sequence[Instruction], registers: int, zero: int, one: int) -> np.ndarray:
    """Steps as rows: operation, places of a, b, c and of the result, 1 if `a b` is subtracted, 1 if c is.

    Args:
        code: Instructions of the program.
        registers: The first place of intermediate results.
        zero: Place of zeros.
        one: Place of ones.
    """
    taken_up, rows = _taken_up(code, registers), []
    # Signed products that are fused instead of computed, by the places of their results.
    products = dict[int, tuple[int, int, bool]]()
    for k, (operation, x, y, target) in enumerate(code):
        if operation in OTHERS:
            rows.append((OTHERS[operation], x, x if y is None else y, zero, target, False, False))
            products.pop(target, None)
            continue
        term, c, minus = products.get(x, (x, one, False)), zero, False
        if operation is np.negative:
            term = *term[:2], not term[2]
        elif y is not None:
            factor, b, sign = products.get(y, (y, one, False))
            if operation is np.multiply:
                term = term[0], factor, term[2] != sign
            else:
                other = factor, b, sign != (operation is np.subtract)
                term, (c, _, minus) = (term, other) if b == one else (other, term)
        if k in taken_up:
            products[target] = term
        else:
            products.pop(target, None)
            rows.append((LINEAR, *term[:2], c, target, term[2], minus))
    return np.fromiter(chain.from_iterable(rows), np.int32).reshape(-1, 7)


def _taken_up(code: Sequence[Instruction], registers: int) -> set[int]:
    """Indices of negatives and products that are fused into the steps that use them.

    A negative is fused into all its users, a product into a sum that is its only user, one for each sum. Their operands
    must not be overwritten before.
    """
    taken, with_product = set[int](), set[int]()
    places = 1 + max((max(x, x if y is None else y, target) for _, x, y, target in code), default=0)
    readers, overwritten = [list[int]() for _ in range(places)], [len(code)] * places
    for k in reversed(range(len(code))):
        operation, x, y, target = code[k]
        own, readers[target], suits = readers[target], [], False
        if own and target >= registers and (operation is np.multiply or operation is np.negative):
            last = max(own)
            if operation is np.negative:
                suits = not any(code[reader][0] in OTHERS for reader in own)
            else:
                suits = len(own) == 1 and code[last][0] in SUMS and last not in with_product
            suits = suits and overwritten[x] >= last and (y is None or overwritten[y] >= last)
        if suits:
            taken.add(k)
            if operation is np.multiply:
                with_product.add(last)
        overwritten[target] = k
        own = own if suits else [k]
        readers[x] += own
        if y is not None:
            readers[y] += own
    return taken


def zeros(*shape: int) -> np.ndarray:
    """Zeros aligned to a cache line."""
    number = prod(shape)
    memory = np.zeros(number + LINE // 8)
    start = -memory.ctypes.data % LINE // 8
    return memory[start : start + number].reshape(shape)


def _rows(x: np.ndarray) -> tuple[int, int]:
    """Address of the first row, and the stride of rows in numbers."""
    assert x.dtype == float and (not x.size or x.strides[1] == x.itemsize)
    return x.ctypes.data, x.strides[0] // 8


def _call(name: str, program: _Program, *arguments: Any) -> None:
    """Calls a function of the compiled code."""
    if not getattr(_library(), f"{name}_{_width()}")(byref(program), *arguments):
        raise MemoryError(f"There was no memory for {program.registers} intermediate results of {BLOCK} samples.")


@cache
def _width() -> int:
    """Width of the widest registers of this processor for which there is code, bits."""
    library = _library()
    assert library is not None
    return int(library.widest())


@cache
def _library() -> CDLL | None:
    """The compiled code, if it was built."""
    spec = find_spec("ident.model._blocks")
    if spec is None or spec.origin is None:
        return None
    try:
        library = CDLL(spec.origin)
        built = c_int32.in_dll(library, "interface_version").value
    except (OSError, ValueError):  # It was built for another system, or from other sources.
        return None
    if built != VERSION:
        return None
    program, address, number = POINTER(_Program), c_void_p, c_int64
    rows = address, number
    for bits in (width for width in WIDTHS if width <= library.widest()):
        run, grams = (getattr(library, f"{name}_{bits}") for name in ("run", "grams"))
        run.argtypes = program, address, *rows, *rows, number
        grams.argtypes = program, address, *rows, *(address,) * 4, *(number,) * 3, address, *rows, *(address,) * 3
    return library
