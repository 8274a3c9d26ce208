"""SI units of parameters, drives, offsets and channels, by their names."""

import numpy as np

from ident.estimation.equations import COMPONENTS
from ident.geometry.inertia import body_index
from ident.mechanism.tree import Tree
from ident.tolerances import DRIVE_UNITS


def unit_of(parameter: str) -> str | None:
    """Unit of a parameter of φ, such as `m2rz2`; None for other names."""
    if body_index(parameter) is None:
        return None
    return "kg m²" if parameter.startswith("I") else "kg m" if "r" in parameter else "kg"


def offset_unit(name: str) -> str:
    """Unit of a component of a wrench, or of its offset: N for `Fx` and `offset(Fx)`, N m for moments."""
    return "N" if name.removeprefix("offset(").startswith("F") else "N m"


def channel_unit(channel: str, tree: Tree) -> str:
    """Unit of a channel: a component of a wrench, or a joint's torque or force."""
    if channel in COMPONENTS:
        return offset_unit(channel)
    motion = np.hstack([body.motions for body in tree.bodies if body.freedoms])[:, tree.freedoms.index(channel)]
    return "N m" if motion[3:].any() else "N"


def coefficient_unit(name: str, tree: Tree) -> str:
    """Unit of a coefficient by its name, such as `m2rz2`, `Fv(knee)` or `offset(Fx)`."""
    if (own := unit_of(name)) is not None:
        return own
    kind, _, of = name.removesuffix(")").partition("(")
    if kind in DRIVE_UNITS:
        # Motors, which are no freedoms, turn.
        return DRIVE_UNITS[kind][of in tree.freedoms and channel_unit(of, tree) == "N"]
    return channel_unit(of, tree)
