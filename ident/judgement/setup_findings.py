"""What of the set-up was found not to be as stated, in words."""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ident.estimation.equations import COMPONENTS
from ident.estimation.setup import TOGETHER, SetupParameter
from ident.judgement.finding import NOWHERE, Place
from ident.trajectory.result import TrajectoryEstimate


@dataclass(frozen=True)
class SetupFinding:
    """Something of the set-up that is not as stated.

    Attributes:
        name: Name of the set-up parameter.
        value: What it was found to be, in SI units and radians.
        std: Its standard deviation.
        text: The finding in one sentence.
        alternatives: Names of others that the data could mean as well.
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
    """What a trajectory estimate found, the most significant first."""
    fit, names = joint.fit, joint.fit.names
    std = np.sqrt(np.diag(fit.covariance))
    by_name = {each.name: each for each in joint.measurement.setup}

    def parameter(k: int) -> tuple[SetupParameter, str]:
        base, _, log = names[k].partition(" of log ")
        return by_name[base], log

    out = []
    for deviation in joint.search.deviations:
        k = deviation.index
        each, log = parameter(k)
        text = sentence(each, float(fit.theta[k]), float(std[k]), f" in log {log}" if log else "")
        if deviation.alternatives or deviation.together:
            meant = ", or ".join([*deviation.together, *(short(parameter(a)[0]) for a in deviation.alternatives)])
            text = f"{text[:-1]}; or else, as the data cannot tell these apart: {meant}."
        others = (*deviation.together, *(names[a] for a in deviation.alternatives))
        place = replace(place_of(each), log=int(log) - 1) if log else place_of(each)
        out.append(SetupFinding(names[k], float(fit.theta[k]), float(std[k]), text, others, place))
    return out


def place_of(each: SetupParameter) -> Place:
    """The wrenches, the channel or the joint that a set-up parameter belongs to."""
    if each.kind in ("delay", "clock", "origin", "rotation"):
        return Place(wrenches=tuple(each.of.split(TOGETHER)))
    contact, _, component = each.of.rpartition(" ")
    of_contact = contact and component in COMPONENTS
    gain = Place(wrenches=(contact,)) if of_contact else Place(channels=(each.of,))
    kinds = {"gain": gain, "zero": Place(joints=(each.of,)), "axis": Place(joints=(each.of,))}
    return kinds.get(each.kind, NOWHERE)


def sentence(each: SetupParameter, value: float, std: float, where: str = "") -> str:
    """What a set-up parameter says; the estimate includes it."""
    of, axis = each.of, "" if each.axis is None else "xyz"[each.axis]
    size = _with_std(abs(value), std, each)
    along = f"{'+' if value > 0 else '-'}{axis}"
    kinds = {
        "delay": f"The wrench '{of}' is {size} {'late' if value > 0 else 'early'}",
        "clock": f"The clock of the wrench '{of}' runs {size} {'slow' if value > 0 else 'fast'}",
        "origin": f"The origin of the wrench '{of}' is {size} further along {along} than stated",
        "rotation": f"The frame of the wrench '{of}' is turned by {size} about {along} from where it was stated",
        "gain": f"The channel {of} reads {size} too {'much' if value > 0 else 'little'}",
        "gravity": f"Gravity is tilted by {size} about {along} of the base frame",
        "zero": f"The joint '{of}' reads {size} too {'much' if value > 0 else 'little'}",
        "axis": f"The axis of joint '{of}' is tilted by {size} about {along} of the base frame",
    }
    return f"{kinds[each.kind]}{where}; the estimate includes this."


def short(each: SetupParameter) -> str:
    """What a set-up parameter is, in a few words."""
    axis = "" if each.axis is None else "xyz"[each.axis]
    return {
        "delay": f"a delay of the wrench '{each.of}'",
        "clock": f"another clock of the wrench '{each.of}'",
        "origin": f"another origin of the wrench '{each.of}' along {axis}",
        "rotation": f"a turn of the wrench '{each.of}' about {axis}",
        "gain": f"another gain of the channel {each.of}",
        "gravity": f"a tilt of gravity about {axis}",
        "zero": f"another zero of joint '{each.of}'",
        "axis": f"a tilt of the axis of joint '{each.of}' about {axis}",
    }[each.kind]


def _with_std(value: float, std: float, each: SetupParameter) -> str:
    factor, unit = {
        "delay": (1e3, " ms"),
        "clock": (100.0, " %"),
        "origin": (1e3, " mm"),
        "gain": (100.0, " %"),
    }.get(each.kind, (180 / np.pi, "°"))
    decimals = max(0, 1 - int(np.floor(np.log10(max(std * factor, 1e-12))))) if std else 1
    return f"{value * factor:.{decimals}f} ± {std * factor:.{decimals}f}{unit}"
