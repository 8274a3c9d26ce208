"""Entries of a mapping file: tables, lists of numbers and poses, each checked."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ident.errors import LogError
from ident.files import limits
from ident.files.table import short
from ident.tolerances import HUGE


def toml(path: Path) -> dict[str, Any]:
    """Entries of a mapping file.

    Raises:
        LogError: It is missing or malformed.
    """
    if not path.is_file():
        raise LogError(f"{path}: a mapping of columns is a TOML file that exists.")
    return limits.toml(path, "a mapping of columns needs", LogError)


def table(where: str, value: Any) -> Mapping[str, Any]:
    """The value, checked to be a table of entries.

    Raises:
        LogError: It is none; likewise for all functions here.
    """
    if not isinstance(value, dict):
        raise LogError(f"{where} needs a table of entries, got {short(value)}.")
    return value


def check_keys(where: str, entry: Mapping[str, Any], choices: Sequence[str]) -> None:
    """Refuses unknown keys."""
    for key in entry:
        if key not in choices:
            raise LogError(f"{where} has no entry '{short(key)}'; valid are {', '.join(choices) or 'none'}.")


def vector(where: str, value: Any, size: int) -> np.ndarray:
    """A list of `size` numbers as an array (size,)."""
    numbers = isinstance(value, list) and all(type(x) in (int, float) and abs(x) < HUGE for x in value)
    if not numbers or len(value) != size:
        raise LogError(f"{where} needs a list of {size} numbers, got {short(value)}.")
    return np.array(value, float)


def pose(where: str, entry: Mapping[str, Any]) -> np.ndarray:
    """Pose from an entry's `position` and its `quaternion` or `rpy_deg` (4, 4)."""
    if "quaternion" in entry and "rpy_deg" in entry:
        raise LogError(f"[{where}] needs a quaternion or rpy_deg, got both.")
    T = np.eye(4)
    T[:3, 3] = vector(f"{where}.position", entry.get("position", [0, 0, 0]), 3)
    if "rpy_deg" in entry:
        T[:3, :3] = Rotation.from_euler("xyz", vector(f"{where}.rpy_deg", entry["rpy_deg"], 3), True).as_matrix()
        return T
    quaternion = vector(f"{where}.quaternion", entry.get("quaternion", [1, 0, 0, 0]), 4)
    if not 0.99 < np.linalg.norm(quaternion) < 1.01:
        raise LogError(f"{where}.quaternion needs four numbers w, x, y, z of norm 1, got {quaternion.tolist()}.")
    T[:3, :3] = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    return T
