"""Findings on the set-up: each error in one sentence, with the causes that the data cannot distinguish from it."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.estimation.setup import SetupParameter
from ident.judgement.finding import NOWHERE, Place
from ident.setup import Unit
from ident.trajectory.result import TrajectoryEstimate


@dataclass(frozen=True)
class SetupFinding:
    """Error of the set-up, which the estimate includes.

    Attributes:
        name: Name of the set-up parameter.
        value: Its estimate, in SI units and radians.
        std: Its standard deviation.
        text: The finding in one sentence.
        alternatives: Names of other causes that the data cannot distinguish from it.
        place: What it belongs to.
    """

    name: str
    value: float
    std: float
    text: str
    alternatives: tuple[str, ...]
    place: Place = NOWHERE

    def to_dict(self) -> dict[str, Any]:
        """For scripts, in JSON's types."""
        told = {"name": self.name, "value": self.value, "std": self.std, "text": self.text}
        return told | {"alternatives": list(self.alternatives), "place": self.place.to_dict()}


def setup_findings(joint: TrajectoryEstimate) -> list[SetupFinding]:
    """Set-up errors of a trajectory estimate, the most significant first."""
    fit, names = joint.fit, joint.fit.names
    std = np.sqrt(np.diag(fit.covariance))
    out = []
    for deviation in joint.search.deviations:
        k = deviation.index
        each = joint.setup[k]
        text = sentence(each, float(fit.theta[k]), float(std[k]))
        if deviation.alternatives or deviation.together:
            meant = ", or ".join([*deviation.together, *(short(joint.setup[a]) for a in deviation.alternatives)])
            text = f"{text[:-1]}; or else, as the data cannot tell these apart: {meant}."
        others = (*deviation.together, *(names[a] for a in deviation.alternatives))
        out.append(SetupFinding(names[k], float(fit.theta[k]), float(std[k]), text, others, place_of(each)))
    return out


def place_of(each: SetupParameter) -> Place:
    """The wrenches, the channel or the joint that a set-up parameter belongs to."""
    names: dict[str, Any] = dict(each.place)
    return Place(**names, log=(each.log or 1) - 1)


def sentence(each: SetupParameter, value: float, std: float) -> str:
    """Error of the set-up and its size, in one sentence."""
    sign = each.row.signs[0 if value > 0 else 1]
    text = each.text(each.row.sentence, size=_with_std(abs(value), std, each.row.unit), sign=sign)
    where = "" if each.log is None else f" in log {each.log}"
    return f"{text}{where}; the estimate includes this."


def short(each: SetupParameter) -> str:
    """Set-up error in a few words."""
    return each.text(each.row.short)


def _with_std(value: float, std: float, unit: Unit) -> str:
    """Value and standard deviation in the unit that is shown, to two digits of the latter."""
    value, std = value * unit.factor, std * unit.factor
    decimals = max(0, 1 - int(np.floor(np.log10(max(std, 1e-12))))) if std else 1
    return f"{value:.{decimals}f} ± {std:.{decimals}f}{unit.shown}"
