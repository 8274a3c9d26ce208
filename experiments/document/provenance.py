"""Provenance of results: options, versions and commit."""

import importlib.metadata
import os
import platform
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from experiments.document.kernels import advice, features, kernels


def provenance(options: Mapping[str, Any], recording: Mapping[str, Any] | None = None) -> dict[str, Any]:
    """Everything needed to repeat a study: options, scene, versions, kernels of linear algebra and commit."""
    packages = ("multicontact", "mujoco", "numpy", "scipy", "matplotlib")
    chosen = kernels()
    remark = advice(chosen, features())
    return {
        "options": dict(options),
        "recording": dict(recording or {}),
        "versions": {"python": platform.python_version()} | {name: version(name) for name in packages},
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
