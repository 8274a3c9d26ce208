"""Motors that move several joints together: which of them rotors and friction belong to, from a mapping or a file."""

from collections.abc import Collection, Mapping, Sequence
from typing import Annotated, Any

import numpy as np

from ident.annotations import Needs
from ident.errors import LogError
from ident.files.entries import choice

OWNERS = ("motors", "joints")
"""Owners that friction and rotors of coupled motors may have; the first is the default."""

Factor = Annotated[float, Needs("a number other than 0", bool)]
Row = Annotated[Mapping[str, Factor], Needs("a number for each joint", bool)]


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
    owner = choice(f"{where}.friction", entry.get("friction", OWNERS[0]), OWNERS)
    if owner != OWNERS[0] or (np.count_nonzero(matrix, axis=1) < 2).all():
        return {}
    names = [f"{where.partition('.')[2]} {number}" for number in range(1, len(matrix) + 1)]
    if twice := [name for name in names if name in taken]:
        raise LogError(f"[{where}] has a motor '{twice[0]}', and a joint is named so too; rename the motors.")
    rows = ({joint: float(x) for joint, x in zip(joints, row, strict=True) if x} for row in matrix)
    return dict(zip(names, rows, strict=True))
