"""Provenance of results: options, versions, commit and kernels of linear algebra."""

import ctypes
import importlib.metadata
import os
import platform
import subprocess
from collections.abc import Mapping
from contextlib import suppress
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

SYMBOLS = ("scipy_openblas_get_corename64_", "scipy_openblas_get_corename", "openblas_get_corename")
"""Names of the function that names the kernels, in builds of numpy, of scipy and of others."""

WIDE = ("SkylakeX", "Cooperlake", "SapphireRapids")
"""Kernels that use AVX-512."""


def kernels() -> dict[str, str]:
    """Names of the kernels that the OpenBLAS of numpy and that of scipy use; none for other libraries."""
    places, out = Path(np.__file__).parents[1], dict[str, str]()
    for package in ("numpy", "scipy"):
        for file, symbol in product(sorted(places.glob(f"{package}.libs/*openblas*")), SYMBOLS):
            with suppress(OSError, AttributeError):
                name = getattr(ctypes.CDLL(str(file)), symbol)
                name.restype = ctypes.c_char_p
                out.setdefault(package, str(name().decode()))
    return out


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


def provenance(options: Mapping[str, Any], recording: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Everything needed to repeat a study: options, scene, versions, kernels of linear algebra and commit."""
    chosen = kernels()
    remark = advice(chosen, features())
    versions = {name: version(name) for name in ("multicontact", "mujoco", "numpy", "scipy", "matplotlib")}
    return {
        "options": dict(options),
        "recording": dict(recording or {}),
        "versions": {"python": platform.python_version()} | versions,
        "linear_algebra": {"openblas_kernels": chosen} | ({"remark": remark} if remark else {}),
        "git_commit": _git_commit(),
    }


def version(package: str) -> str | None:
    """Version of an installed package; None if it is not installed."""
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def _git_commit() -> str | None:
    """Commit of the checkout that this code runs from, `-dirty` if files differ; None for an installed copy."""
    here = Path(__file__).resolve()
    # A git hook's environment points to another repository.
    environment = {key: value for key, value in os.environ.items() if not key.startswith("GIT_")}

    def git(*arguments: str) -> str:
        # A lock on the checkout would remain if this process's group was killed, or the disk was full.
        command = ["git", "--no-optional-locks", "-C", str(here.parents[2]), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, env=environment).stdout.strip()

    try:
        git("ls-files", "--error-unmatch", str(here))
        # `git describe --dirty` would lock nevertheless.
        differs = git("status", "--porcelain", "--untracked-files=no")
        return git("rev-parse", "HEAD") + ("-dirty" if differs else "")
    except (OSError, subprocess.CalledProcessError):
        return None
