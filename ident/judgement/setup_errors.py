"""Errors of the set-up that an estimate includes, in sentences."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.display.text import rounded
from ident.estimation.setup_parameters import SetupParameter
from ident.judgement.finding import NOWHERE, Place
from ident.trajectory.result import TrajectoryEstimate


@dataclass(frozen=True)
class SetupFinding:
    """Error of the set-up, which the estimate includes.

    Attributes:
        name: Name of the set-up parameter.
        value: Its estimate, in SI units and radians.
        std: Its standard deviation.
        kind: Kind of the set-up parameter.
        values: Numbers and names of its sentence.
        alternatives: Names of other causes that the data cannot distinguish from it.
        place: Its place.
    """

    name: str
    value: float
    std: float
    kind: str
    values: Mapping[str, Any]
    alternatives: tuple[str, ...]
    place: Place = NOWHERE

    @property
    def code(self) -> str:
        """Code of its finding."""
        return f"setup_{self.kind}"

    @property
    def text(self) -> str:
        """The finding in one sentence."""
        return setup_sentence(self.kind, **self.values)

    def to_dict(self) -> dict[str, Any]:
        """Name, code, value, standard deviation, sentence, alternatives and place, in JSON's types."""
        own = {"name": self.name, "code": self.code, "value": self.value, "std": self.std, "text": self.text}
        return own | {"alternatives": list(self.alternatives), "place": self.place.to_dict()}


def setup_findings(joint: TrajectoryEstimate) -> list[SetupFinding]:
    """Set-up errors of a trajectory estimate, the most significant first."""
    fit, names = joint.fit, joint.fit.names
    std = np.sqrt(np.diag(fit.covariance))
    out = []
    for deviation in joint.deviations:
        k = deviation.index
        each, alternatives = joint.setup[k], [joint.setup[a] for a in deviation.alternatives]
        values: dict[str, Any] = {
            **_named(each),
            "value": float(fit.theta[k]),
            "std": float(std[k]),
            "log": each.log,
            "together": deviation.together,
            "alternatives": [{"kind": x.kind, **_named(x)} for x in alternatives],
        }
        others = (*deviation.together, *(names[a] for a in deviation.alternatives))
        out.append(SetupFinding(names[k], values["value"], values["std"], each.kind, values, others, place_of(each)))
    return out


def _named(each: SetupParameter) -> dict[str, str | None]:
    """Object and axis of a set-up parameter, and the joint at the other end of a link."""
    own = {"of": each.of, "axis": None if each.axis is None else "xyz"[each.axis]}
    return own | ({"link": each.link} if each.link else {})


def _parameter(kind: str, of: str, axis: str | None, log: int | None = None, link: str = "") -> SetupParameter:
    """Set-up parameter by its name."""
    return SetupParameter(kind, of, None if axis is None else "xyz".index(axis), 0.0, log, link=link)


def setup_sentence(
    kind: str,
    of: str,
    axis: str | None,
    value: float,
    std: float,
    log: int | None = None,
    link: str = "",
    together: Sequence[str] = (),
    alternatives: Sequence[Mapping[str, Any]] = (),
) -> str:
    """Set-up error in a sentence, with the causes that the data cannot distinguish from it."""
    text = sentence(_parameter(kind, of, axis, log, link), value, std)
    if together or alternatives:
        others = "; ".join([*together, *(short(_parameter(**each)) for each in alternatives)])
        text = f"{text} Other causes have the same effect: {others}."
    return text


def place_of(each: SetupParameter) -> Place:
    """The wrenches, the channel or the joint that a set-up parameter belongs to."""
    names: dict[str, Any] = dict(each.place)
    return Place(**names, log=(each.log or 1) - 1)


def sentence(each: SetupParameter, value: float, std: float) -> str:
    """Error of the set-up and its size, in one sentence."""
    unit = each.row.unit
    size = f"{' ± '.join(rounded(abs(value) * unit.factor, std * unit.factor))}{unit.shown}"
    text = each.text(each.row.sentence, size=size, sign=each.sign(value))
    where = "" if each.log is None else f" in log {each.log}"
    return f"{text}{where}. The estimate includes this.{' ' * bool(each.row.note)}{each.row.note}"


def short(each: SetupParameter) -> str:
    """Set-up error in a few words."""
    return each.text(each.row.short)
