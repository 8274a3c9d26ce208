"""Settings of markers from a TOML file: their sites or positions, their weights, and bodies that share a scale factor.

unit = "mm"                  # of a table that states none
up = "y"                     # axis of the laboratory that points up; by default the model's: z, in OpenSim y
[markers.KNEE]               # a label
site = "knee"                # a site of the model; by default that with the label's name
weight = 0.5                 # of its squared distance; by default 1
[markers.HEEL]
body = "foot"                # instead of a site: a position on a body
position = [-0.05, 0, -0.04] # m
[scale]
groups = [["left_thigh", "right_thigh"]]
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated

import numpy as np

from ident.annotations import Needs, Point, Positive, one_of
from ident.errors import InputError
from ident.files.column import UNITS
from ident.files.limits import toml
from ident.files.schema import made

UP = {
    "z": np.eye(3),
    "y": np.array([[1.0, 0, 0], [0, 0, -1], [0, 1, 0]]),
    "x": np.array([[0.0, 1, 0], [0, 0, 1], [1, 0, 0]]),
}
"""Rotations from a laboratory whose vertical axis is the key to one with Z upwards."""


@dataclass(frozen=True)
class MarkerPlace:
    """Site or position of a marker on the model.

    Attributes:
        site: Name of a site, "" if a body is named.
        body: Name of a body, "" if a site is named.
        position: Position in the body's frame, m; None if a site is named.
        weight: Weight of the squared distance.
    """

    site: str = ""
    body: str = ""
    position: Point | None = None
    weight: Positive = 1.0

    def __post_init__(self) -> None:
        if self.site and (self.body or self.position is not None):
            raise InputError("needs a site, or a body with a position, got both.")
        if bool(self.body) != (self.position is not None):
            raise InputError("needs the name of a body and a position [x, y, z] in m on it.")


@dataclass(frozen=True)
class ScaleTable:
    """Table `[scale]`.

    Attributes:
        groups: Names of bodies that share a scale factor.
    """

    groups: Annotated[tuple[tuple[str, ...], ...], Needs("a list of lists of bodies", lambda _: True)] = ()


@dataclass(frozen=True)
class Settings:
    """Settings of a file.

    Attributes:
        unit: Unit of a table, None if not stated.
        up: Axis of the laboratory that points up, None if not stated.
        markers: Sites or positions of markers, by label.
        scale: Bodies that share a scale factor.
    """

    unit: Annotated[str, one_of(UNITS["length"])] | None = None
    up: Annotated[str, one_of(UP)] | None = None
    markers: Mapping[str, MarkerPlace] = field(default_factory=dict)
    scale: ScaleTable = ScaleTable()


def read_settings(path: Path) -> Settings:
    """Reads a file of settings.

    Raises:
        InputError: The file is missing or malformed; the message names the entry.
    """
    entries = toml(path, "settings of markers need")
    try:
        settings = made(Settings, "", entries)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    named = {k: x if x.site or x.body else replace(x, site=k) for k, x in settings.markers.items()}
    return replace(settings, markers=named)
