"""Public recordings, as the registry has them, and the results of the validation on them."""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, is_dataclass
from itertools import combinations
from typing import Annotated, Any, TypeVar, get_args, get_origin, get_type_hints

import numpy as np

from ident.annotations import Needs, typed
from ident.errors import InputError
from ident.files.limits import value_of
from ident.files.table import short
from ident.judgement.verdict import Outcome
from ident.tolerances import DRIVE, INTERVAL

T = TypeVar("T")

NAME = re.compile(r"\w(?:[\w.+ :-]{0,98}[\w+-])?", re.ASCII)
"""Form of the name of a file or folder, which no system takes for a path."""

FARTHEST = 100.0
"""Error in half intervals that stands for larger ones, such as those of an interval that ends at the estimate."""

FRICTION = tuple(DRIVE[kind] for kind in ("viscous", "coulomb", "stribeck"))
"""Beginnings of the names of friction."""


@typed()
@dataclass(frozen=True)
class Source:
    """Place at which a recording is published.

    Attributes:
        repository: GitHub repository, `owner/name`.
        commit: Commit of its files.
        licence: SPDX identifier of its licence; empty if it is not known.
        reference: Publication or page that documents it.
    """

    repository: str
    commit: str = ""
    licence: str = ""
    reference: str = ""


@typed()
@dataclass(frozen=True)
class SourceFile:
    """A file of a recording.

    Attributes:
        name: Name in the folder of the recording.
        path: Path in the repository; empty if no file there is the original of this one.
        sha256: SHA-256 of the file as it stands in the folder; empty if it was never at hand.
        original: SHA-256 of the published file; empty if unknown.
        made: Converter that makes the file of the published one, by name; empty for a copy.
        converter: Converter of the file into one that is read, by name; empty if it is read as it is.
    """

    name: str
    path: str = ""
    sha256: str = ""
    original: str = ""
    made: str = ""
    converter: str = ""


Stated = Annotated[float, Needs("a number of at least 0", lambda x: not x < 0)]
"""A size that an entry states, NaN if it does not."""


@typed("std")
@dataclass(frozen=True)
class StatedValue:
    """A parameter that is published, or known as it was weighed or measured by itself.

    Attributes:
        name: Name of the base parameter or drive.
        value: Its value, SI units.
        std: Standard deviation of its value; NaN if none is stated.
        source: Origin of the value: formula, file, table, or what measured it.
    """

    name: str
    value: float
    std: Stated = float("nan")
    source: str = ""


@typed("median", "worse")
@dataclass(frozen=True)
class Reference:
    """Results of earlier work on a recording, as goals; the identification does not see them.

    Attributes:
        source: How they were reached.
        ratios: Held-out residuals over signal by channel.
        median: Their median over all channels; NaN for none.
        best: Number of channels in which the estimate is to be best; 0 for none.
        worse: Share by which it may be worse than the best other candidate in a channel; NaN for none.
    """

    source: str
    ratios: Mapping[str, float] = field(default_factory=dict)
    median: Stated = float("nan")
    best: int = 0
    worse: Stated = float("nan")


@typed()
@dataclass(frozen=True)
class Entry:
    """A recording in the registry.

    Attributes:
        name: Its name.
        title: Its title.
        about: Description in a sentence.
        folder: Name of its folder.
        tried: True if it has been run.
        source: Where it is published.
        files: Its files.
        model: Name of the model's file, one of its own or of the package's `models`.
        fitted: Names of the files of each fitted log.
        judged: Names of the files of each log to judge by; without any the end of each fitted log is held out.
        options: Options of `identify`, by name.
        sensor: Name of the wrench sensor that carries a body alone in each log, as for `payload`; empty for none.
        body: Name of the body that carries a weighed load in `loaded` and not in `empty`; empty for none.
        empty: Names of the files of each log without that load.
        loaded: Names of the files of each log with it.
        true_files: Files with true parameters of a simulation: a model, or of bodies alone one for each fitted log.
        truth: Known parameters; with a `body` quantities of its load.
        published: Published parameters.
        held_out: Published held-out residuals over signal, by channel.
        reference: Results of earlier work; None without any.
        alike: Groups of parameters that are equal by construction of the system.
        note: What could not be verified.
    """

    name: str
    title: str
    about: str
    folder: str
    tried: bool
    source: Source
    files: tuple[SourceFile, ...]
    model: str = ""
    fitted: tuple[tuple[str, ...], ...] = ()
    judged: tuple[tuple[str, ...], ...] = ()
    options: Mapping[str, Any] = field(default_factory=dict)
    sensor: str = ""
    body: str = ""
    empty: tuple[tuple[str, ...], ...] = ()
    loaded: tuple[tuple[str, ...], ...] = ()
    true_files: tuple[str, ...] = ()
    truth: tuple[StatedValue, ...] = ()
    published: tuple[StatedValue, ...] = ()
    held_out: Mapping[str, float] = field(default_factory=dict)
    reference: Reference | None = None
    alike: tuple[tuple[str, ...], ...] = ()
    note: str = ""

    def __post_init__(self) -> None:
        columns = value_of("options.columns", self.options.get("columns", "none"), str)
        single = [*self.folder.split("/"), *(file.name for file in self.files), columns]
        paths = [self.source.repository, *(file.path for file in self.files if file.path)]
        for each in (*single, *(part for path in paths for part in path.split("/"))):
            if not NAME.fullmatch(each) or (":" in each and each in single):
                raise InputError(
                    f"{self.name}: names and paths of files and folders stay in their folder and have at most 100 "
                    f"letters, digits, '.', '+', '-', '_' and spaces, got {short(repr(each))}."
                )

    @property
    def logs(self) -> tuple[tuple[str, ...], ...]:
        """Names of the files of all logs, the fitted ones first."""
        return (*self.fitted, *self.judged)


MODEL, LEAST_SQUARES, ESTIMATE = "model", "least squares", "estimate"
CANDIDATES = {MODEL: "model as it came", LEAST_SQUARES: "least squares", ESTIMATE: "trajectory estimate"}
"""Candidates that predict the held-out part, by the names of their ratios."""

OTHERS = (LEAST_SQUARES, MODEL)
"""Candidates besides the estimate."""

WORSE = 1.05
"""Ratio of two held-out residuals above which a prediction is worse than another one."""


@dataclass(frozen=True, eq=False)
class Values:
    """Estimated base parameters and drives.

    Attributes:
        names: Their names.
        values: Estimates, SI units (p,).
        std: Standard deviations from the noise (p,).
        std_setup: Standard deviations with the uncertainty of the set-up (p,).
        prior: Standard deviations of the prior, infinite without one (p,).
        units: Units.
    """

    names: tuple[str, ...]
    values: np.ndarray
    std: np.ndarray
    std_setup: np.ndarray
    prior: np.ndarray
    units: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        # JSON has no infinite numbers.
        object.__setattr__(self, "prior", np.where(np.isnan(self.prior), np.inf, self.prior))

    def __getitem__(self, name: str) -> tuple[float, float, float]:
        """Estimate of a parameter, its standard deviation, and that with the set-up."""
        k = self.names.index(name)
        return float(self.values[k]), float(self.std[k]), float(self.std_setup[k])

    def is_from_data(self, name: str) -> bool:
        """True if the recording says more on a parameter than the prior."""
        k = self.names.index(name)
        return bool(self.std_setup[k] < self.prior[k] / np.sqrt(2))


@dataclass(frozen=True)
class Goal:
    """A reference result.

    Attributes:
        what: What it is of.
        wanted: The reference: the largest value, or the least.
        reached: What the estimate has.
        least: True if the reference is the least value.
    """

    what: str
    wanted: float
    reached: float
    least: bool = False

    @property
    def met(self) -> bool:
        """True if the estimate is as good as the reference."""
        return self.reached >= self.wanted if self.least else self.reached <= self.wanted


@dataclass(frozen=True, eq=False)
class Validation:
    """Results of one recording.

    Attributes:
        entry: The recording.
        values: Base parameters and drives of the trajectory estimate.
        rivals: Base parameters and drives of other candidates, by name (p,).
        channels: Names of the channels.
        units: Units of the channels.
        ratios: Held-out residual over signal by candidate (C,).
        at_rest: The same where joints that rub are at rest, which is not judged; NaN without such samples (C,).
        halves: Differences of the two halves' base parameters in their standard deviations from the noise (r,).
        widening: Factor on those deviations because of the halves.
        trials: Estimates of each trial alone, by its name.
        outcome: Decision of the verdict.
        verdict: The verdict in words.
        doubts: Codes of its doubts.
        samples: Numbers of fitted and of held-out samples.
        cutoff: Chosen cut-off of least squares, Hz; None without one.
        seconds: CPU time of the identification, s.
        unchecked: Names of files that no hash of the registry was compared with.
        peers: Held-out `ratios` (C,) and CPU `seconds` of other software, or the sentence why there are none, by name.
    """

    entry: Entry
    values: Values
    rivals: Mapping[str, np.ndarray]
    channels: tuple[str, ...]
    units: tuple[str, ...]
    ratios: Mapping[str, np.ndarray]
    at_rest: Mapping[str, np.ndarray]
    halves: np.ndarray
    widening: float
    trials: Mapping[str, Values]
    outcome: str
    verdict: str
    doubts: tuple[str, ...]
    samples: tuple[int, int]
    cutoff: float | None
    seconds: float
    unchecked: tuple[str, ...] = ()
    peers: Mapping[str, Mapping[str, Any] | str] = field(default_factory=dict)

    @property
    def best_other(self) -> np.ndarray:
        """Ratio of the better one of the other candidates (C,)."""
        return np.min([self.ratios[name] for name in OTHERS if name in self.ratios], axis=0)

    @property
    def explained(self) -> np.ndarray:
        """Mask of the channels that some candidate explains (C,)."""
        return np.min(list(self.ratios.values()), axis=0) <= 1

    @property
    def against_best(self) -> np.ndarray:
        """Ratio of the estimate's residual to that of the best other candidate, in the explained channels."""
        return (self.ratios[ESTIMATE] / self.best_other)[self.explained]

    @property
    def trial_z(self) -> np.ndarray:
        """Differences between trials identified alone, in their standard deviations with the set-up."""
        return np.concatenate(self.trial_z_apart)

    @property
    def trial_z_apart(self) -> tuple[np.ndarray, np.ndarray]:
        """These differences of bodies and rotors, and of friction, which changes from trial to trial.

        Of each pair of trials and each parameter on which both say more than the prior.
        """
        out: tuple[list[float], list[float]] = [], []
        for a, b in combinations(self.trials.values(), 2):
            for name in (name for name in a.names if name in b.names):
                if a.is_from_data(name) and b.is_from_data(name):
                    (x, _, of_x), (y, _, of_y) = a[name], b[name]
                    out[name.startswith(FRICTION)].append((x - y) / float(np.hypot(of_x, of_y)))
        return np.array(out[0]), np.array(out[1])

    @property
    def alike_z(self) -> np.ndarray:
        """Differences of parameters that are equal by construction, in their standard deviations with the set-up."""
        pairs = [pair for group in self.entry.alike for pair in combinations(group, 2)]
        return np.array([_z(*self.values[a][::2], *self.values[b][::2]) for a, b in pairs])

    @property
    def losses(self) -> list[tuple[str, float, str, float]]:
        """Channels in which another candidate predicts better by more than 5 %.

        Each with the held-out residual over signal of the estimate, the best other candidate, and its residual.
        """
        out = []
        for k, channel in enumerate(self.channels):
            best, other = min((float(self.ratios[name][k]), name) for name in OTHERS if name in self.ratios)
            own = float(self.ratios[ESTIMATE][k])
            if self.explained[k] and own > WORSE * best:
                out.append((channel, own, other, best))
        return out

    @property
    def outside(self) -> dict[str, float]:
        """Published parameters outside the 95 % intervals: estimate less published value in standard deviations."""
        z = {each.name: self.published_z(each) for each in self.entry.published}
        return {name: x for name, x in z.items() if abs(x) > INTERVAL}

    @property
    def goals(self) -> list[Goal]:
        """Reference results of the entry, beside what the estimate reaches."""
        reference = self.entry.reference
        if reference is None:
            return []
        own = dict(zip(self.channels, self.ratios[ESTIMATE].tolist(), strict=True))
        out = [Goal(f"residual of {name}", most, own[name]) for name, most in reference.ratios.items() if name in own]
        if np.isfinite(reference.median):
            out.append(Goal("median residual", reference.median, float(np.median(self.ratios[ESTIMATE]))))
        if reference.best:
            out.append(Goal("channels in which it is best", reference.best, int((self.against_best <= 1).sum()), True))
        if np.isfinite(reference.worse):
            out.append(Goal("largest excess over the best other", reference.worse, float(self.against_best.max() - 1)))
        return out

    def published_z(self, published: StatedValue) -> float:
        """Estimate less published value in their standard deviations."""
        value, _, std = self.values[published.name]
        return _z(value, std, published.value, published.std)


@dataclass(frozen=True, eq=False)
class Truth:
    """Known parameters of a system beside their estimates.

    Attributes:
        entry: The recording.
        level: Level of added noise in words; empty for one level.
        names: Their names.
        units: Their units.
        true: What they are (p,).
        tolerance: Standard deviations of what measured them, zero in simulations (p,).
        values: Estimates (p,).
        lower: Lower ends of their 95 % intervals (p,).
        upper: Upper ends (p,).
        rivals: Estimates of other candidates, by name (p,).
        seconds: CPU time, s.
    """

    entry: Entry
    level: str
    names: tuple[str, ...]
    units: tuple[str, ...]
    true: np.ndarray
    tolerance: np.ndarray
    values: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    rivals: Mapping[str, np.ndarray]
    seconds: float

    @property
    def title(self) -> str:
        """Title of the recording, with the level of noise."""
        return ", ".join(filter(None, (self.entry.title, self.level)))

    @property
    def z(self) -> np.ndarray:
        """Errors, the half of an interval towards the truth counting as `INTERVAL` (p,)."""
        error = self.values - self.true
        half = np.where(error > 0, self.values - self.lower, self.upper - self.values)
        return INTERVAL * error / np.hypot(np.maximum(half, abs(error) / FARTHEST), INTERVAL * self.tolerance)

    @property
    def significant(self) -> np.ndarray:
        """Mask of the parameters other than zero whose 95 % intervals exclude zero (p,)."""
        return ((self.lower > 0) | (self.upper < 0)) & (self.true != 0)

    def errors(self, values: np.ndarray) -> np.ndarray:
        """Relative errors of estimates of the significant parameters."""
        return (values - self.true)[self.significant] / abs(self.true[self.significant])


def from_json(kind: type[T], numbers: Mapping[str, Any], **known: Any) -> T:
    """Data class of results from its fields in JSON's types, in which numbers that do not exist are None.

    Args:
        kind: The data class.
        numbers: Its fields by name; others are left out.
        known: Fields that are not in JSON's types.
    """
    hints = get_type_hints(kind)
    there = [name for name in hints if name in numbers and name not in known]
    return kind(**known, **{name: _from_json(hints[name], numbers[name]) for name in there})


def _from_json(hint: Any, value: Any) -> Any:
    """Value of an annotated type: an array, a mapping of arrays, a tuple or a data class; others as they are."""
    kind, arguments = get_origin(hint) or hint, get_args(hint)
    if kind is np.ndarray or kind is tuple:
        return np.array(value, float) if kind is np.ndarray else tuple(value)
    if kind is Mapping and arguments[1] is np.ndarray:
        return {name: np.array(each, float) for name, each in value.items()}
    return from_json(kind, value) if isinstance(kind, type) and is_dataclass(kind) else value


def _z(a: float, std_a: float, b: float, std_b: float) -> float:
    """Difference in standard deviations; one that is NaN counts as zero."""
    return (a - b) / float(np.hypot(std_a, np.nan_to_num(std_b)))


def inside(z: np.ndarray) -> float:
    """Share of the differences inside their 95 % intervals; NaN without any."""
    return float((np.abs(z) <= INTERVAL).mean()) if len(z) else float("nan")


def typical(errors: np.ndarray) -> float:
    """Median of the errors' sizes; NaN without any."""
    return float(np.median(abs(errors))) if len(errors) else float("nan")


def rms(z: np.ndarray) -> float:
    """Root mean square; NaN without any."""
    return float(np.sqrt((z**2).mean())) if len(z) else float("nan")


@dataclass(frozen=True, eq=False)
class Study:
    """Results of all recordings.

    Attributes:
        validations: Results by name.
        refused: Sentences on recordings without results, by name.
        untried: Entries that have never been run.
        truths: Known parameters beside their estimates, by name.
    """

    validations: Mapping[str, Validation]
    refused: Mapping[str, str]
    untried: tuple[Entry, ...] = ()
    truths: Mapping[str, Truth] = field(default_factory=dict)

    def __iter__(self) -> Iterator[Validation]:
        """Results in their order."""
        return iter(self.validations.values())

    @property
    def against_best(self) -> np.ndarray:
        """Ratios of the estimate's residual to that of the best other candidate, in all explained channels."""
        return np.concatenate([each.against_best for each in self] or [np.zeros(0)])

    @property
    def truth_z(self) -> np.ndarray:
        """Errors of all known parameters, in their standard deviations."""
        return np.concatenate([each.z for each in self.truths.values()] or [np.zeros(0)])

    @property
    def truth_errors(self) -> np.ndarray:
        """Relative errors of all known parameters whose 95 % intervals exclude zero."""
        return np.concatenate([each.errors(each.values) for each in self.truths.values()] or [np.zeros(0)])

    @property
    def trial_z(self) -> dict[str, np.ndarray]:
        """Differences between two recordings of one system, of `bodies` and rotors, of `friction`, and the `unusable`.

        The last are of all parameters, of estimates that are unusable by their verdicts.
        """
        parts: dict[str, list[np.ndarray]] = {"bodies": [], "friction": [], "unusable": []}
        for each in self:
            if each.outcome == Outcome.NOT.value:
                parts["unusable"].append(each.trial_z)
            else:
                bodies, friction = each.trial_z_apart
                parts["bodies"].append(bodies)
                parts["friction"].append(friction)
        return {kind: np.concatenate([np.zeros(0), *own]) for kind, own in parts.items()}
