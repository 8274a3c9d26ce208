"""Motors that move several joints together: which of them rotors and friction belong to, from a mapping or a file."""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from ident.errors import LogError
from ident.files.table import short
from ident.tolerances import HUGE

OWNERS = ("motors", "joints")
"""Owners that friction and rotors of coupled motors may have; the first is the default."""


def couplings(
    where: str, entry: Mapping[str, Any], joints: Sequence[str], matrix: np.ndarray, taken: Collection[str] = ()
) -> dict[str, dict[str, float]]:
    """Rows of coupled motors by their names, `NAME 1`, `NAME 2`; empty where rotors and friction belong to the joints.

    They do where the mapping says so, and where every motor moves one joint.

    Args:
        where: Name of the motors' entry, `motors.NAME`.
        entry: The entry.
        joints: The joints.
        matrix: R of `q_motor = R q` (n, n).
        taken: Names that a motor must not have, those of all joints.

    Raises:
        LogError: `friction` is none of `OWNERS`, or a motor has the name of a joint.
    """
    owner = entry.get("friction", OWNERS[0])
    if owner not in OWNERS:
        raise LogError(f"{where}.friction needs one of {', '.join(OWNERS)}; got {short(owner)}.")
    if owner != OWNERS[0] or (np.count_nonzero(matrix, axis=1) < 2).all():
        return {}
    names = [f"{where.partition('.')[2]} {number}" for number in range(1, len(matrix) + 1)]
    if twice := [name for name in names if name in taken]:
        raise LogError(f"[{where}] has a motor '{twice[0]}', and a joint is named so too; rename the motors.")
    rows = ({joint: float(x) for joint, x in zip(joints, row, strict=True) if x} for row in matrix)
    return dict(zip(names, rows, strict=True))


def couplings_of(entries: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    """Rows of coupled motors from the metadata of a saved recording, by motor.

    Raises:
        LogError: An entry is none.
    """
    for motor, row in entries.items():
        if not isinstance(row, Mapping) or not row or not all(_is_factor(x) for x in row.values()):
            raise LogError(f"the motor '{short(motor)}' needs a number other than 0 for each joint, got {short(row)}.")
    return {motor: {joint: float(x) for joint, x in row.items()} for motor, row in entries.items()}


def _is_factor(x: Any) -> bool:
    return type(x) in (int, float) and 0 < abs(x) < HUGE
