"""Findings on an estimate: a code with values, from which `FINDINGS` makes a sentence; and errors of its set-up."""

import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from math import inf, isfinite
from pathlib import Path
from typing import Any

import numpy as np

from ident.display.brief import rounded
from ident.estimation.setup_parameters import SetupParameter
from ident.judgement.wording import InWords, listed
from ident.setup import SETUP
from ident.tolerances import NAMED
from ident.trajectory.result import TrajectoryEstimate

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
        text: Template of the values, as `InWords` formats them, or a function of the values.
        level: `doubt` if it speaks against the estimate, `remark` if not, `judged` if its judge decides by the values.
        title: Its title; empty if the code is words enough.
        place: Key of the value that names the bodies, joints, wrenches or channels of its place, by these words.
    """

    text: str | Callable[..., str]
    level: str
    title: str = ""
    place: Mapping[str, str] = field(default_factory=dict)

    def rendered(self, values: Mapping[str, Any]) -> str:
        """The sentence with these values."""
        return InWords().vformat(self.text, (), values) if isinstance(self.text, str) else self.text(**values)

    def place_of(self, values: Mapping[str, Any]) -> Place:
        """The place that these values name."""
        own = ((kind, values[key]) for kind, key in self.place.items())
        names: dict[str, Any] = {kind: (each,) if isinstance(each, str) else tuple(each) for kind, each in own}
        return Place(**names)


def _rows() -> dict[str, Row]:
    """The rows of `findings.toml`, each text on one line."""
    rows = tomllib.loads(Path(__file__).with_name("findings.toml").read_text(encoding="utf-8"))
    return {code: Row(**row | {"text": " ".join(row["text"].split())}) for code, row in rows.items()}


FINDINGS = _rows()
"""Row of each code."""


def title_of(code: str) -> str:
    """Title of a code's findings, in at most `WORDS` words.

    >>> title_of("weight_differs")
    'Weight differs'
    """
    words = (FINDINGS[code].title if code in FINDINGS else "") or code.replace("setup", "set-up").replace("_", " ")
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
        if (row.level == "judged") == (doubt is None):
            raise ValueError(f"'{code}' needs its doubt either from its row or from its judge.")
        return cls(code, values, row.level == "doubt" or bool(doubt), row.place_of(values) if place is None else place)

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


@dataclass(frozen=True)
class SetupFinding:
    """Error of the set-up, which the estimate includes.

    Attributes:
        name: Name of the set-up parameter.
        value: Its estimate, in SI units and radians.
        std: Its standard deviation, with what else of the set-up is uncertain.
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
    theta, deviations = joint.fit.theta.tolist(), joint.std_setup.tolist()
    noise = np.sqrt(np.diag(joint.fit.covariance)).tolist()
    for deviation in joint.deviations:
        k, together = deviation.index, deviation.together
        each, value, std = joint.setup[k], theta[k], deviations[k]
        own: dict[str, Any] = {"value": value, "std": std, "noise": noise[k], "log": each.log, "together": together}
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
    noise: float = inf,
    together: Sequence[str] = (),
    alternatives: Sequence[Mapping[str, Any]] = (),
    **name: Any,
) -> str:
    """Set-up error in a sentence, with the causes that the data cannot distinguish from it."""
    text = sentence(_parameter(kind, **name), value, std, noise)
    causes = [_parameter(**each) for each in alternatives]
    if others := "; ".join([*together, *(each.text(each.row.short) for each in causes)]):
        text = f"{text} Other causes have the same effect: {others}."
    return text


def place_of(each: SetupParameter) -> Place:
    """The wrenches, the channel or the joint that a set-up parameter belongs to."""
    names: dict[str, Any] = dict(each.place)
    return Place(**names, log=(each.log or 1) - 1)


def sentence(each: SetupParameter, value: float, std: float, noise: float = inf) -> str:
    """Error of the set-up and its size in one sentence, also ± from noise alone if that is less than half.

    A tilt that is clear against the noise may look doubtful beside a sensor that may be turned.
    """
    unit = each.row.unit
    size = f"{' ± '.join(rounded(abs(value) * unit.factor, std * unit.factor))}{unit.shown}"
    text = each.text(each.row.sentence, size=size, sign=each.sign(value))
    where = "" if each.log is None else f" in log {each.log}"
    if std > 2 * noise:
        alone = rounded(noise * unit.factor, noise * unit.factor)[1]
        where += f", ± {alone}{unit.shown} if the rest of the set-up is right"
    return f"{text}{where}. The estimate includes this.{' ' * bool(each.row.note)}{each.row.note}"


FINDINGS.update(
    {
        f"setup_{kind}": Row(partial(setup_sentence, kind), "remark", f"set-up error: {kind.replace('_', ' ')}")
        for kind in SETUP
    }
)
