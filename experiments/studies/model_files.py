"""Model files to compare."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from experiments.data.model_comparison import ModelPair, pairs
from ident.errors import InputError
from sim.models.mechanism import mechanism

MODELS = (".xml", ".mjcf", ".urdf", ".xacro", ".osim")
"""Endings of model files."""


def is_model(path: Path) -> bool:
    """True for a file, and for a name of one that does not exist."""
    return path.is_file() or (path.suffix.lower() in MODELS and not path.is_dir())


def compared_models(files: Sequence[Path], **model: Any) -> list[ModelPair]:
    """The first of several MJCF, URDF or OpenSim files with each of the others.

    Args:
        files: The files.
        model: As for `sim.mechanism`.

    Raises:
        InputError: There is one file only, a file cannot be read, or two models have no body in common.
    """
    if len(files) < 2 or len({file.resolve() for file in files}) < len(files):
        raise InputError("A comparison needs two or more different model files.")
    names = [file.name for file in files]
    names = names if len(set(names)) == len(names) else list(map(str, files))
    compared = pairs(names, [mechanism(file, **model) for file in files])
    for pair in compared:
        if not pair.bodies:
            raise InputError(f"{' and '.join(pair.names)} have no body in common; bodies are compared by name.")
    return compared
