"""Kernels of linear algebra that OpenBLAS chose for this processor, and whether newer ones fit."""

import ctypes
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import numpy as np

SYMBOLS = ("scipy_openblas_get_corename64_", "scipy_openblas_get_corename", "openblas_get_corename")
"""Names of the function that names the kernels, in builds of numpy, of scipy and of others."""

WIDE = ("SkylakeX", "Cooperlake", "SapphireRapids")
"""Kernels that use AVX-512."""


def kernels() -> dict[str, str]:
    """Names of the kernels that the OpenBLAS of numpy and that of scipy use; none for other libraries."""
    places = Path(np.__file__).parents[1]
    every = {package: _of(sorted(places.glob(f"{package}.libs/*openblas*"))) for package in ("numpy", "scipy")}
    return {package: name for package, name in every.items() if name is not None}


def _of(files: list[Path]) -> str | None:
    for file in files:
        with suppress(OSError):
            library = ctypes.CDLL(str(file))
            for symbol in SYMBOLS:
                with suppress(AttributeError):
                    name = getattr(library, symbol)
                    name.restype = ctypes.c_char_p
                    return str(name().decode())
    return None


def advice(chosen: Mapping[str, str], features: set[str]) -> str | None:
    """Sentence on kernels that are older than the processor; None if they fit.

    Args:
        chosen: Names of the kernels by package.
        features: Features of the processor, as in /proc/cpuinfo.
    """
    old = {package: name for package, name in chosen.items() if name.lower() not in {each.lower() for each in WIDE}}
    if not old or "avx512f" not in features:
        return None
    packages, names = " and ".join(old), " and ".join(dict.fromkeys(old.values()))
    return (
        f"The OpenBLAS of {packages} uses its kernels for {names}, without the AVX-512 that this processor has; with "
        f"OPENBLAS_CORETYPE={WIDE[0]} in the environment linear algebra may be faster, and results may differ by "
        "rounding."
    )


def features() -> set[str]:
    """Features of the processor; empty where the system does not list them."""
    with suppress(OSError):
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("flags"):
                return set(line.partition(":")[2].split())
    return set()
