"""Kernels of linear algebra that OpenBLAS chose for this processor, and whether newer ones fit."""

import ctypes
from contextlib import suppress
from pathlib import Path

import numpy as np

SYMBOLS = ("scipy_openblas_get_corename64_", "scipy_openblas_get_corename", "openblas_get_corename")
"""Names of the function that names the kernels, in numpy's own builds and in others."""

WIDE = ("SkylakeX", "Cooperlake", "SapphireRapids")
"""Kernels that use AVX-512."""


def kernels() -> str | None:
    """Name of the kernels that numpy's OpenBLAS uses; None for another library or an unknown build."""
    for file in sorted(Path(np.__file__).parents[1].glob("numpy.libs/*openblas*")):
        with suppress(OSError):
            library = ctypes.CDLL(str(file))
            for symbol in SYMBOLS:
                with suppress(AttributeError):
                    name = getattr(library, symbol)
                    name.restype = ctypes.c_char_p
                    return str(name().decode())
    return None


def advice(name: str | None, features: set[str]) -> str | None:
    """Sentence on kernels that are older than the processor; None if they fit.

    Args:
        name: Name of the kernels.
        features: Features of the processor, as in /proc/cpuinfo.
    """
    if name is None or "avx512f" not in features or name.lower() in {each.lower() for each in WIDE}:
        return None
    return (
        f"OpenBLAS uses its kernels for {name}, without the AVX-512 that this processor has; with OPENBLAS_CORETYPE="
        f"{WIDE[0]} in the environment linear algebra may be faster, and results may differ by rounding."
    )


def features() -> set[str]:
    """Features of the processor; empty where the system does not list them."""
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("flags"):
                return set(line.partition(":")[2].split())
    return set()
