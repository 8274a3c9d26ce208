"""Evidence on an estimate: its residuals, errors of its set-up, other candidates, and checks of the recordings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ident.estimation.preparation import Prepared
from ident.estimation.setup_parameters import SetupParameter
from ident.judgement.checks import Checks
from ident.judgement.finding import NOWHERE, Place
from ident.mechanism.mechanism import Mechanism
from ident.parameters.consistency import ConsistentParameters
from ident.parameters.prior import KNOWN
from ident.regression.ordinary import Fit
from ident.setup import Unit
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
    size = _with_std(abs(value), std, each.row.unit)
    text = each.text(each.row.sentence, size=size, sign=each.sign(value))
    where = "" if each.log is None else f" in log {each.log}"
    return f"{text}{where}. The estimate includes this.{' ' * bool(each.row.note)}{each.row.note}"


def short(each: SetupParameter) -> str:
    """Set-up error in a few words."""
    return each.text(each.row.short)


def _with_std(value: float, std: float, unit: Unit) -> str:
    """Value ± standard deviation in the displayed unit, with two digits of the latter."""
    value, std = value * unit.factor, std * unit.factor
    decimals = max(0, 1 - int(np.floor(np.log10(max(std, 1e-12))))) if std else 1
    return f"{value:.{decimals}f} ± {std:.{decimals}f}{unit.shown}"


@dataclass(frozen=True)
class Unmodelled:
    """Something that the model may lack.

    Attributes:
        kind: `force`, which depends on where a body is, or `length`, from its parent's frame to its joint.
        body: Name of the body.
        ratio: Residual of what was held out with it, over that without, geometric mean over the channels.
    """

    kind: str
    body: str
    ratio: float


@dataclass(frozen=True, eq=False)
class Evidence:
    """Evidence that judges read; a judge yields no finding where an estimate lacks its entries.

    Attributes:
        fit: The fit.
        ratios: RMS residual over the signal's standard deviation, of each channel judged.
        part: Samples of the ratios, "held-out" or "fitted".
        condition_number: Condition number of the unit-norm, weighted columns.
        checks: Checks of the recording.
        offsets: Constant offset of each channel where it is identifiable, with its standard deviation.
        inseparable: Channels whose offset cannot be separated from parameters.
        scale: Standard deviation of each channel's residual.
        constant: Channels that are constant although the motion would change them.
        logs: Fitted recordings; none where samples were read piece by piece.
        trajectory: The trajectory estimate, None for other estimators.
        setup: Set-up errors.
        rivals: Ratios of other candidates on the same samples (C,), by name.
        filtered_at: Cut-off of the candidate `least squares`, Hz.
        disagreement: Root mean square z of the differences between two halves.
        disagreements: The same of each recording against the others.
        widening: Factor on the standard deviations because of the halves.
        bounded: Drives at their bound of zero: upper limit, and standard deviation with the drive free.
        friction: Share of each joint torque's residual that friction would explain.
        at_rest: Ratios of the samples that are not judged, of joints that rub and rest, NaN without any, by channel.
        in_logs: Ratios of all candidates in each recording, if each is predicted from the others (C,), by name.
        model_error: Share of each channel's residual that the motion explains beyond chance (C,).
        covariance_setup: Covariance of all coefficients with the uncertainty of the set-up (m, m).
        consistent: Physical bodies near the estimate.
        unmodelled: What the model may lack, the likeliest first; empty where residuals are no more than fast noise.
        idle: Reason, as a key of `verdict.IDLE`, by the channels that are not predicted and in which nothing could be.
    """

    fit: Fit
    ratios: Mapping[str, float]
    part: str
    condition_number: float
    checks: Checks
    offsets: Mapping[str, tuple[float, float]]
    inseparable: tuple[str, ...]
    scale: Mapping[str, float]
    constant: tuple[str, ...] = ()
    logs: Sequence[Prepared] = ()
    trajectory: TrajectoryEstimate | None = None
    setup: Sequence[SetupFinding] = ()
    rivals: Mapping[str, np.ndarray] = field(default_factory=dict)
    filtered_at: float | None = None
    disagreement: float | None = None
    disagreements: tuple[float, ...] = ()
    widening: float = 1.0
    bounded: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    friction: Mapping[str, float] = field(default_factory=dict)
    at_rest: Mapping[str, float] = field(default_factory=dict)
    in_logs: Sequence[Mapping[str, np.ndarray]] = ()
    model_error: np.ndarray | None = None
    covariance_setup: np.ndarray | None = None
    consistent: ConsistentParameters | None = None
    unmodelled: Sequence[Unmodelled] = ()
    idle: Mapping[str, str] = field(default_factory=dict)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels judged."""
        return tuple(self.ratios)

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism, with the set-up of the first recording if there is one."""
        return self.logs[0].mechanism if self.logs else self.fit.equations.mechanism

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the base parameters (r, r)."""
        rank = self.fit.parameters.rank
        return self.fit.covariance[:rank, :rank]

    @property
    def known(self) -> dict[str, float]:
        """Standard deviations of the model's φ."""
        return {**KNOWN, **(self.logs[0].recording.known if self.logs else {})}
