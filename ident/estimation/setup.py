"""Set-up parameters of the channels of a recording: the kinds of `ident.setup`, for every object that has them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ident.estimation.equations import COMPONENTS, Equations
from ident.recordings.wrench import GROUND
from ident.setup import PRIORS, SETUP, SetupKind

TOGETHER = " + "
"""Separator of the names of wrenches that share a delay and a clock."""


@dataclass(frozen=True)
class SetupParameter:
    """Parameter that is zero if the set-up is as stated.

    Attributes:
        kind: One of `SETUP`.
        of: Wrench, channel or joint, "" for gravity; `contact Fx` for a gain of a contact.
        axis: Axis of the frame, or None.
        std: Standard deviation of the prior, whose mean is zero, in SI units and radians.
        log: Number of the log that has it separately, counted from 1; None if it is that of the first or of all.
        place: Names of the wrenches, channels or joints that it belongs to, by `wrenches`, `channels` and `joints`.
    """

    kind: str
    of: str
    axis: int | None
    std: float
    log: int | None = None
    place: Mapping[str, tuple[str, ...]] = field(default_factory=dict, hash=False)

    @property
    def row(self) -> SetupKind:
        """Its kind's row."""
        return SETUP[self.kind]

    @property
    def name(self) -> str:
        """Name of the column: `origin_x(ground)`, `delay(ground) of log 2`."""
        name = self.kind if self.axis is None else f"{self.kind}_{'xyz'[self.axis]}"
        name = f"{name}({self.of})" if self.of else name
        return name if self.log is None else name_in_log(name, self.log)

    def text(self, template: str, **values: str) -> str:
        """A template of its row, with its object, its axis and other values."""
        return template.format(of=self.of, axis="" if self.axis is None else "xyz"[self.axis], **values)


def name_in_log(name: str, log: int) -> str:
    """Name of a parameter that a log has separately."""
    return f"{name} of log {log}"


class Subject(NamedTuple):
    """Something that may differ from what is stated.

    Attributes:
        name: Its name, "" for gravity.
        axes: Axes along which it may; one None if it has no axes.
        place: As for `SetupParameter`.
        std: Standard deviation of its own, by default the kind's.
    """

    name: str
    axes: Sequence[int | None]
    place: Mapping[str, tuple[str, ...]]
    std: float | None = None


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
    std, every = PRIORS | (priors or {}), objects(equations, contacts, held=held)
    return tuple(
        SetupParameter(kind, subject.name, axis, own, place=subject.place)
        for group in dict.fromkeys(row.of for row in SETUP.values())
        for subject in every[group]
        for kind, row in SETUP.items()
        if row.of == group and (own := subject.std if subject.std and std[kind] else std[kind]) > 0
        for axis in subject.axes
    )


def objects(equations: Equations, contacts: Sequence[str], *, held: bool) -> dict[str, list[Subject]]:
    """Objects of the kinds of set-up errors, by `SetupKind.of`; arguments as for `setup_parameters`.

    Returns:
        `clocks` of the wrenches, one for all that share it; `commands` of servos, if there are no other channels;
        `frames` of the wrenches; `channels`, and those of the contacts; `scales` of torques that are stated not to be
        exact, whose channels have no gain besides; `gravity`, about the axes across it; `angles` of the hinges, and
        their `axes`, about those across.
    """
    tree, gravity = equations.mechanism.tree, equations.mechanism.gravity
    wrench = len(equations.channels) > len(equations.torques)
    ground = (GROUND,) if wrench and held else ()
    together = ground if held else tuple(contacts) if wrench else ()
    channels = equations.channels[0 if held else len(equations.channels) - len(equations.torques) :]
    commanded = [name for k, name in enumerate(equations.channels) if k not in equations.sensed]
    scales = equations.scaled
    hinges = [(body, {"joints": (body.joint,)}) for body in tree.bodies if body.coordinates and body.turns]
    # A tilted axis would open its loop.
    loops = tree.closure.part.names if tree.closure else ()
    return {
        "clocks": [Subject(TOGETHER.join(together), (None,), {"wrenches": together})] if together else [],
        "commands": [Subject("", (None,), {})] if not wrench and len(commanded) == len(equations.channels) > 0 else [],
        "frames": [Subject(name, range(3), {"wrenches": (name,)}) for name in (*ground, *contacts)],
        "channels": [
            Subject(name, (None,), {"channels": (name,)}) for name in channels if name not in (*commanded, *scales)
        ]
        + [Subject(f"{name} {x}", (None,), {"wrenches": (name,)}) for name in contacts for x in COMPONENTS],
        "scales": [Subject(name, (None,), {"channels": (name,)}, std) for name, std in scales.items()],
        "gravity": [Subject("", across(gravity), {})] if np.any(gravity) else [],
        "angles": [Subject(body.joint, (None,), place) for body, place in hinges],
        "axes": [
            Subject(body.joint, across(body.twist[3:]), place) for body, place in hinges if body.name not in loops
        ],
    }


def across(direction: np.ndarray) -> list[int]:
    """Indices of the two coordinate axes farthest from a direction."""
    return sorted(np.argsort(np.abs(np.asarray(direction, float)), kind="stable")[:2].tolist())
