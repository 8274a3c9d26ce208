"""Set-up parameters: errors of the stated sensor poses, gains, clocks and joint axes, with priors."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.estimation.equations import COMPONENTS, Equations
from ident.recordings.wrench import GROUND

PRIORS = {
    "delay": 0.05,
    "clock": 0.003,
    "origin": 0.05,
    "rotation": np.radians(3),
    "gain": 0.03,
    "gravity": np.radians(3),
    "zero": np.radians(3),
    "axis": np.radians(3),
}
"""Default standard deviations of the priors: delay of a wrench, s; a clock's rate; origin of a wrench's frame, m, and
its rotation, rad; gain of a channel; tilt of gravity, zeros and tilts of joint axes, rad."""


TOGETHER = " + "
"""Separator of the names of wrenches that share a delay and a clock."""


@dataclass(frozen=True)
class SetupParameter:
    """Parameter that is zero if the set-up is as stated.

    Attributes:
        kind: One of `PRIORS`.
        of: Wrench, channel or joint, "" for gravity; `contact Fx` for a gain of a contact.
        axis: Axis of the frame, or None.
        std: Standard deviation of the prior, whose mean is zero, in SI units and radians.
    """

    kind: str
    of: str
    axis: int | None
    std: float

    @property
    def name(self) -> str:
        """Name of the column: `origin_x(ground)`."""
        suffix = "" if self.axis is None else "_" + "xyz"[self.axis]
        return f"{self.kind}{suffix}({self.of})" if self.of else f"{self.kind}{suffix}"


def setup_parameters(
    equations: Equations, contacts: Sequence[str], priors: dict[str, float] | None = None, *, held: bool = True
) -> tuple[SetupParameter, ...]:
    """Set-up parameters of the channels of a recording.

    Args:
        equations: Equations to fit.
        contacts: Names of the wrenches besides the ground's, one for all bodies that share a plate.
        priors: Standard deviations that replace those of `PRIORS`; a kind at zero is left out.
        held: True if there is a ground wrench; without one, all contacts share a delay and a clock, and their sum has
            no gains besides theirs.
    """
    std = PRIORS | (priors or {})
    tree, gravity = equations.mechanism.tree, equations.mechanism.gravity
    felt = len(equations.channels) > len(equations.torques)
    ground = [GROUND] if felt and held else []
    wrenches, together = [*ground, *contacts], [TOGETHER.join(contacts)] if felt and contacts else []
    hinges = [body for body in tree.bodies if body.coordinates and body.turns]
    rows: list[tuple[str, str, int | None]] = []
    for wrench in ground if held else together:
        rows += [("delay", wrench, None), ("clock", wrench, None)]
    for wrench in wrenches:
        rows += [(kind, wrench, axis) for kind in ("origin", "rotation") for axis in range(3)]
    channels = equations.channels[0 if held else len(equations.channels) - len(equations.torques) :]
    rows += [("gain", channel, None) for channel in channels]
    rows += [("gain", f"{contact} {component}", None) for contact in contacts for component in COMPONENTS]
    rows += [("gravity", "", axis) for axis in across(gravity)] if np.any(gravity) else []
    rows += [("zero", body.joint, None) for body in hinges]
    rows += [("axis", body.joint, axis) for body in hinges for axis in across(body.twist[3:])]
    return tuple(SetupParameter(kind, of, axis, std[kind]) for kind, of, axis in rows if std[kind] > 0)


def across(direction: np.ndarray) -> list[int]:
    """Indices of the two coordinate axes farthest from a direction."""
    return sorted(np.argsort(np.abs(np.asarray(direction, float)), kind="stable")[:2].tolist())
