"""Sets of indices as the bits of integers, which are hashed and united faster than arrays."""

import numpy as np


def bits_of(mask: np.ndarray) -> int:
    """Integer with the bits of a mask (k,), the first one lowest."""
    return int.from_bytes(np.packbits(mask, bitorder="little").tobytes(), "little")


def indices_of(bits: int) -> np.ndarray:
    """Indices of the bits that are set, ascending."""
    return np.array([k for k in range(bits.bit_length()) if bits >> k & 1], int)
