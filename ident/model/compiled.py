"""Programs run by compiled code, `blocks.c`, if a compiler was available when this package was installed.

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
from math import prod
from typing import Any

import numpy as np

from ident.model.steps import Instruction, steps

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
