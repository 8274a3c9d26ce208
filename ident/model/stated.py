"""Values of drives that a model states, by the names of their columns."""

from collections.abc import Mapping, Sequence

import numpy as np

from ident.mechanism.drives import NO_DRIVE, Drive
from ident.mechanism.mechanism import Mechanism
from ident.tolerances import DRIVE


def stated_values(mechanism: Mechanism, names: Sequence[str]) -> np.ndarray:
    """Values that the model states for columns such as `Fv(elbow)`, zero where it states none (d,)."""
    places = map(column_place, names)
    return np.array([mechanism.drives.get(freedom, NO_DRIVE).value(kind) for kind, freedom in places], float)


def with_values(mechanism: Mechanism, values: Mapping[str, float]) -> dict[str, Drive]:
    """Drives with other values of some columns, of the freedoms that these are of, by name."""
    drives = dict[str, Drive]()
    for name, value in values.items():
        kind, freedom = column_place(name)
        before = drives.get(freedom, mechanism.drives.get(freedom, NO_DRIVE))
        drives[freedom] = before.with_value(kind, value)
    return drives


def column_place(name: str) -> tuple[str, str]:
    """Kind and freedom of a column such as `Fv(elbow)`."""
    column, _, freedom = name.removesuffix(")").partition("(")
    return next(kind for kind, own in DRIVE.items() if own == column), freedom
