"""Findings on an estimate: a code with values, from which `FINDINGS` makes a sentence; and errors of its set-up."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import isfinite
from string import Formatter
from typing import Any

import numpy as np

from ident.display.text import rounded
from ident.estimation.setup_parameters import SetupParameter
from ident.setup import SETUP
from ident.trajectory.result import TrajectoryEstimate

NAMED = 4
"""Largest number of parameters, bodies or channels that a sentence names; more are counted."""

WORDS = 7
"""Largest number of words in a title."""


@dataclass(frozen=True)
class Place:
    """Place of a finding; empty where it has none.

    Attributes:
        bodies: Names of bodies; likewise `joints`, `wrenches` and `channels`.
        span: First and last time, s.
        log: Index of the log, if there are several.
    """

    bodies: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    wrenches: tuple[str, ...] = ()
    channels: tuple[str, ...] = ()
    span: tuple[float, float] | None = None
    log: int = 0

    def to_dict(self) -> dict[str, Any]:
        """Entries that are not empty, in JSON's types."""
        names = {key: getattr(self, key) for key in ("bodies", "joints", "wrenches", "channels")}
        entries: dict[str, Any] = {key: list(value) for key, value in names.items() if value}
        entries |= {} if self.span is None else {"span": list(self.span)}
        return entries | ({"log": self.log} if self.log or self.span else {})


NOWHERE = Place()


@dataclass(frozen=True)
class Row:
    """Sentence, doubt and place of a code.

    Attributes:
        template: Format string of the values, as `_InWords` formats them, or a function of the values where grammar
            depends on them.
        doubt: True if it speaks against the estimate; None if that depends on the values, and the judge decides.
        place: Key of the value that names the bodies, joints, wrenches or channels of its place, by these words.
    """

    template: str | Callable[..., str]
    doubt: bool | None
    place: Mapping[str, str] = field(default_factory=dict)

    def rendered(self, values: Mapping[str, Any]) -> str:
        """The sentence with these values."""
        if isinstance(self.template, str):
            return _InWords().vformat(self.template, (), values)
        return self.template(**values)

    def place_of(self, values: Mapping[str, Any]) -> Place:
        """The place that these values name."""
        own = ((kind, values[key]) for kind, key in self.place.items())
        names: dict[str, Any] = {kind: (each,) if isinstance(each, str) else tuple(each) for kind, each in own}
        return Place(**names)


def doubt(template: str | Callable[..., str], **place: str) -> Row:
    """Row of a finding that speaks against the estimate."""
    return Row(template, True, place)


def remark(template: str | Callable[..., str], **place: str) -> Row:
    """Row of a finding that does not."""
    return Row(template, False, place)


def judged(template: str | Callable[..., str], **place: str) -> Row:
    """Row of a finding that is a doubt if its judge says so."""
    return Row(template, None, place)


class _InWords(Formatter):
    """Formats templates: few names are listed, others counted; `{ratios:channels .3g}` brackets each one's number.

    `%` as a format is a share in per cent.
    """

    def get_value(self, key: int | str, args: Any, kwargs: Any) -> Any:
        value = kwargs[key]
        names = isinstance(value, list | tuple) and all(isinstance(own, str) for own in value)
        return listed(value, str(key)) if names else value

    def format_field(self, value: Any, format_spec: str) -> str:
        if isinstance(value, Mapping):
            what, _, form = format_spec.rpartition(" ")
            return bracketed(value, what, form)
        if isinstance(value, list | tuple):
            return listed(format(own, format_spec) for own in value)
        return percent(value) if format_spec == "%" else format(value, format_spec)


FINDINGS: dict[str, Row] = {}
"""Row of each code, by subject: modules with judges add theirs; `judges` imports all of them."""


TITLES = {
    "worse_than_candidate": "another candidate predicts clearly better",
    "candidate_better": "another candidate predicts somewhat better",
    "unexplained_channels": "this motion does not explain",
    "unmodelled": "the model lacks something",
    "wrench_sign_or_axes": "sign or axes of the wrench",
    "other_base": "wrench measured in another frame",
    "mass_by_setup": "mass by set-up and mass weighed",
    "mass_or_common_gain": "another mass, or a common gain",
    "inseparable_offsets": "offsets inseparable from masses",
    "unchecked": "could not be checked",
    "friction_not_fitted": "friction is left out",
    "low_velocity_friction": "torques count less at low velocity",
    "smooth_coulomb_friction": "smooth Coulomb friction",
    "body_not_carried": "a body that was not carried",
    "channels_late": "channels late against others",
    "own_in_logs": "friction or offsets differ between logs",
    "prior_beside_data": "the model's bodies were a prior, needlessly",
    "prior_needed": "the model's bodies served as a prior",
    "joint_noise_not_included": "noise of joints is not included",
    "model_not_contradicted": "the data do not contradict the model",
    "physical_within_region": "updated model within the 95 % region",
    "no_physical_bodies": "no physical bodies near the estimate",
    "masses_shown": "masses far from the model's",
    "masses_limited": "masses that no channel contains",
    "masses_hardly_shown": "masses that the data hardly show",
}
"""Short titles of findings whose codes are not words enough."""


def title_of(code: str) -> str:
    """Title of a code's findings, in at most `WORDS` words.

    >>> title_of("weight_differs")
    'Weight differs'
    """
    words = TITLES.get(code, code.replace("setup", "set-up").replace("_", " "))
    return words[0].upper() + words[1:]


@dataclass(frozen=True)
class Finding:
    """A doubt on the estimate, or a remark on it.

    Attributes:
        code: Key of `FINDINGS`.
        values: Numbers and names in its sentence.
        doubt: True if it speaks against the estimate.
        place: Its place.
    """

    code: str
    values: Mapping[str, Any]
    doubt: bool
    place: Place = NOWHERE

    @classmethod
    def of(cls, code: str, place: Place | None = None, /, doubt: bool | None = None, **values: Any) -> "Finding":
        """The finding of a code.

        Args:
            code: Key of `FINDINGS`.
            place: Where it is, by default as its row says.
            doubt: Whether it is a doubt, for codes that leave it to the judge; by default as its row says.
            values: Numbers and names in its sentence.

        Raises:
            ValueError: Both the row and the judge say whether it is a doubt, or neither does.
        """
        row = FINDINGS[code]
        if (row.doubt is None) == (doubt is None):
            raise ValueError(f"'{code}' needs its doubt either from its row or from its judge.")
        return cls(code, values, bool(doubt or row.doubt), row.place_of(values) if place is None else place)

    @property
    def text(self) -> str:
        """The finding in a sentence."""
        return FINDINGS[self.code].rendered(self.values)

    @property
    def title(self) -> str:
        """At most `WORDS` words: what it says, and what it is about if these names are few enough."""
        words = title_of(self.code)
        names = [*self.place.channels, *self.place.wrenches, *self.place.joints, *self.place.bodies]
        about = f": {listed(names, 'places')}"
        return words + about * (0 < len(names) <= NAMED and len((words + about).split()) <= WORDS)

    @property
    def line(self) -> str:
        """Line of a list in the terminal."""
        return line_of(self.text, self.doubt)

    def to_dict(self) -> dict[str, Any]:
        """Code, values, doubt, place and sentence in JSON's types."""
        own = {"code": self.code, "values": in_json(self.values), "doubt": self.doubt}
        return own | {"place": self.place.to_dict(), "text": self.text}


def in_json(value: Any) -> Any:
    """A value in JSON's types; numbers that are not finite become None."""
    if isinstance(value, Mapping):
        return {str(key): in_json(each) for key, each in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return in_json(value.tolist())
    if isinstance(value, float):
        return value if isfinite(value) else None
    if isinstance(value, str | int | None):
        return value
    return [in_json(each) for each in value]


def doubts_first(findings: Iterable[Finding]) -> list[Finding]:
    """Findings with the doubts first, otherwise in their order."""
    return sorted(findings, key=lambda each: not each.doubt)


def line_of(text: str, doubt: bool) -> str:
    """Line of a finding's sentence in a list in the terminal."""
    return f"  {'!' if doubt else '-'} {text}"


def listed(names: Iterable[str], what: str = "") -> str:
    """Names with commas between them, or how many of `what` they are if more than `NAMED`.

    >>> listed("abc", "joints"), listed("abcde", "joints")
    ('a, b, c', '5 joints')
    """
    every = [*names]
    return f"{len(every)} {what}" if what and len(every) > NAMED else ", ".join(every)


def bracketed(values: Mapping[str, float], what: str, form: str = ".3g") -> str:
    """Names with commas between them, each with its number in brackets, or how many and the range of their numbers.

    >>> bracketed({"a": 1.0, "b": 0.25}, "joints"), bracketed(dict(zip("abcde", range(5))), "joints")
    ('a (1), b (0.25)', '5 joints (0 to 4)')
    """
    if len(values) > NAMED:
        return f"{len(values)} {what} ({min(values.values()):{form}} to {max(values.values()):{form}})"
    return listed(f"{name} ({value:{form}})" for name, value in values.items())


def percent(share: float, digits: int = 0) -> str:
    """A share in per cent."""
    return f"{round(100 * share, digits) + 0.0:.{digits}f} %"


def number_of(number: int, noun: str) -> str:
    """A number with its noun, in the plural for all but one."""
    return f"{number} {noun}{'s' * (number != 1)}"


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
    names, out = joint.fit.names, []
    theta, deviations = joint.fit.theta.tolist(), np.sqrt(np.diag(joint.fit.covariance)).tolist()
    for deviation in joint.deviations:
        k, together = deviation.index, deviation.together
        each, value, std = joint.setup[k], theta[k], deviations[k]
        own: dict[str, Any] = {"value": value, "std": std, "log": each.log, "together": together}
        alternatives = [{"kind": joint.setup[a].kind, **_named(joint.setup[a])} for a in deviation.alternatives]
        values = _named(each) | own | {"alternatives": alternatives}
        others = (*together, *(names[a] for a in deviation.alternatives))
        out.append(SetupFinding(names[k], value, std, each.kind, values, others, place_of(each)))
    return out


def _named(each: SetupParameter) -> dict[str, Any]:
    """Object and axis of a set-up parameter, and the joint at the other end of a link."""
    own = {"of": each.of, "axis": None if each.axis is None else "xyz"[each.axis]}
    return own | ({"link": each.link} if each.link else {})


def _parameter(kind: str, of: str, axis: str | None, log: int | None = None, link: str = "") -> SetupParameter:
    """Set-up parameter by its name."""
    return SetupParameter(kind, of, None if axis is None else "xyz".index(axis), 0.0, log, link=link)


def setup_sentence(
    kind: str,
    value: float,
    std: float,
    together: Sequence[str] = (),
    alternatives: Sequence[Mapping[str, Any]] = (),
    **name: Any,
) -> str:
    """Set-up error in a sentence, with the causes that the data cannot distinguish from it."""
    text = sentence(_parameter(kind, **name), value, std)
    if others := "; ".join([*together, *(short(_parameter(**each)) for each in alternatives)]):
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


FINDINGS.update(
    {f"setup_{kind}": remark(partial(setup_sentence, kind)) for kind, row in SETUP.items() if not row.constant}
)
