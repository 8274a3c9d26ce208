"""Results of identify: their files, differences of two, and agreement of many logs."""

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from os.path import realpath
from pathlib import Path
from typing import Any

import numpy as np
from scipy import special

from ident.annotations import fits, in_words
from ident.display.brief import listed
from ident.errors import InputError
from ident.files.limits import reason
from ident.files.table import FAR
from ident.judgement.residuals import Comparison
from ident.tolerances import DRIVE, SIGNIFICANT

EXCLUDED = ("out", "name", "logs", "model", "held_out", "verbose")
"""Options without effect on results, and files, which are compared by content."""


@dataclass(frozen=True, eq=False)
class Result:
    """Results of an identification, read from its folder.

    Attributes:
        name: Name of the folder, or its path if names are not unique.
        estimate: Content of `estimate.json`.
        provenance: Content of `provenance.json`.
        in_full: True if logs go by their paths and contents, as others of the same name are compared with.
    """

    name: str
    estimate: Mapping[str, Any]
    provenance: Mapping[str, Any]
    in_full: bool = False

    @property
    def regrouping(self) -> Mapping[str, str]:
        """Regrouping of each base parameter, by name."""
        return self.estimate["regrouping"]

    @property
    def made_of(self) -> Mapping[str, str]:
        """Regrouping of each base parameter, and of each drive itself, by name."""
        drives = (name for name in self.estimate["columns"] if name.partition("(")[0] in DRIVE.values())
        return {**self.regrouping, **{name: name for name in drives}}

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies in order."""
        return tuple(self.estimate["bodies"])

    @property
    def logs(self) -> Mapping[str, str]:
        """Fitted files by the SHA-256 sums of their contents."""
        several = [log.get("files") or [log] for log in self.provenance["recording"]["logs"]]
        names = {"+".join(each["sha256"] for each in log): "+".join(each["file"] for each in log) for log in several}
        if not self.in_full:
            return names
        paths = self.provenance["options"].get("logs", [])
        paths = paths if fits(paths, list[str]) and len(paths) == len(names) else names.values()
        return {sums: f"{path} ({sums[:8]})" for sums, path in zip(names, paths, strict=True)}

    @property
    def settings(self) -> Mapping[str, str]:
        """All settings, as text."""
        files, origin = self.provenance["recording"], self.provenance
        chosen = {key: _text(value) for key, value in origin["options"].items() if key not in EXCLUDED}
        inputs = {
            key: f"{files[key]['file']} ({files[key]['sha256'][:8]})" for key in ("model", "columns") if key in files
        }
        version = {"version": str(origin["versions"]["multicontact"]), "commit": str(origin["git_commit"])}
        return chosen | inputs | {"logs": ", ".join(self.logs.values())} | version

    def at(self, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Values (k,), covariance from noise (k, k) and standard deviations with the set-up (k,) of some parameters."""
        estimate = self.estimate
        where = [estimate["columns"].index(name) for name in names]
        covariance = np.array(estimate["covariance"], float)[np.ix_(where, where)]
        return np.array(estimate["values"], float)[where], covariance, np.array(estimate["std_setup"], float)[where]


def _text(value: Any) -> str:
    if isinstance(value, list):
        return " ".join(map(str, value)) or "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "none" if value is None else str(value)


@dataclass(frozen=True, eq=False)
class Difference:
    """Difference of two results, for the base parameters with the same regrouping in both and the drives of both.

    Attributes:
        first: The result to subtract from.
        second: The result to subtract.
    """

    first: Result
    second: Result

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Base parameters with the same regrouping, and drives.

        Raises:
            InputError: There is no such base parameter.
        """
        other = self.second.made_of
        names = tuple(name for name, made_of in self.first.made_of.items() if other.get(name) == made_of)
        shared = self.first.regrouping.keys() & names
        if not shared or self.first.bodies != self.second.bodies:
            raise InputError(
                f"Results of one mechanism can be compared, but '{self.first.name}' is of bodies "
                f"{', '.join(self.first.bodies)} and '{self.second.name}' of {', '.join(self.second.bodies)}, with "
                f"{len(shared)} base parameters in common."
            )
        return names

    @property
    def shared(self) -> list[str]:
        """Logs that both were fitted to; their noise is in both, so that the difference has no known interval."""
        return [file for sum_, file in self.first.logs.items() if sum_ in self.second.logs]

    @cached_property
    def comparison(self) -> Comparison:
        """The difference, for independent noise of the two.

        Raises:
            InputError: The sum of their covariances is singular.
        """
        (a, A, _), (b, B, _) = (result.at(self.names) for result in (self.first, self.second))
        comparison = Comparison(self.names, a - b, A + B, tuple(self.first.bodies))
        chi2 = np.nan
        with suppress(np.linalg.LinAlgError):
            chi2 = comparison.chi2
        if not 0 <= chi2 < np.inf:
            raise InputError(
                f"Differences of '{self.first.name}' and '{self.second.name}' need a covariance, but the sum of theirs "
                "is singular."
            )
        return comparison

    @cached_property
    def std_setup(self) -> np.ndarray:
        """Standard deviations of the difference, with independent set-up errors of the two (k,)."""
        return np.hypot(self.first.at(self.names)[2], self.second.at(self.names)[2])

    @property
    def settings(self) -> dict[str, tuple[str, str]]:
        """Settings that differ."""
        a, b = self.first.settings, self.second.settings
        pairs = {key: (a.get(key, "none"), b.get(key, "none")) for key in (*a, *b)}
        return {key: pair for key, pair in pairs.items() if pair[0] != pair[1]}


Content = Mapping[str, Any]


def read_results(folders: Sequence[Path]) -> list[Result]:
    """Reads folders that `identify` has written.

    Raises:
        InputError: A folder lacks a file, or holds something else.
    """
    if len(folders) < 2 or len({*map(realpath, folders)}) < len(folders):
        raise InputError("A comparison needs two or more different folders of results.")
    names = [Path(realpath(folder)).name for folder in folders]
    if len(set(names)) < len(names):
        names = list(map(str, folders))
    pairs = zip(names, folders, strict=True)
    results = [
        Result(
            name,
            _read(folder / "estimate.json", _check_estimate),
            _read(folder / "provenance.json", _check_provenance),
        )
        for name, folder in pairs
    ]
    logs = {log for result in results for log in result.logs.items()}
    alike = len({name for _, name in logs}) < len(logs)
    return [replace(result, in_full=alike) for result in results]


def covariance_of(folder: Path, names: Sequence[str]) -> np.ndarray:
    """Covariance of some parameters from the noise, of the `estimate.json` in a folder; raises as `read_results`."""
    return Result(folder.name, _read(folder / "estimate.json", _check_estimate), {}).at(names)[1]


def _read(path: Path, check: Callable[[Content], None]) -> Content:
    try:
        content: Content = json.loads(path.read_text(encoding="utf-8"))
        # Half of a surrogate pair is text for JSON, but cannot be written to a file.
        json.dumps(content, ensure_ascii=False).encode()
    except (OSError, ValueError, RecursionError) as error:
        inner = listed(f"'{each.parent.as_posix()}'" for each in sorted(path.parent.glob(f"*/{path.name}")))
        held = f" Its folders hold some: {inner}." * bool(inner)
        raise InputError(
            f"'{path.parent}' needs to hold results of identify, but {path.name}: {reason(error)}.{held}"
        ) from None
    try:
        check(content)
    except InputError as error:
        raise InputError(f"'{path}' needs to be of identify, but {error}.") from None
    return content


def _check_estimate(content: Content) -> None:
    _check("it", content, _ESTIMATE)
    columns, base = content["columns"], list(content["regrouping"])
    std, covariance = content["std_setup"], content["covariance"]
    alike = all(len(row) == len(columns) for row in (content["values"], std, covariance, *covariance))
    _need(alike, f"its 'values', 'std_setup' and 'covariance' are not of its {len(columns)} 'columns'")
    sizes = np.abs([*content["values"], *std, *np.ravel(covariance)])
    _need(bool((sizes < FAR).all()) and min(std, default=0) >= 0, "a number of it is out of range")
    _need(set(base) <= set(columns), "its 'regrouping' has parameters that are not among its 'columns'")
    own = [columns.index(name) for name in base]
    _need(all(std[k] > 1 / FAR for k in own), "its 'std_setup' has a deviation that is not positive")
    for channel, entry in content["held_out"].items():
        _need(fits(entry.get("ratio"), float | None), f"its 'held_out' has no number for '{channel}'")
    for entry in content["setup"]:
        _check("an entry of its 'setup'", entry, {"name": str, "text": str})


def _check_provenance(content: Content) -> None:
    _check("it", content, {"options": dict, "recording": dict, "versions": dict, "git_commit": Any})
    _check("its 'recording'", content["recording"], {"logs": list[dict[str, Any]]})
    _check("its 'versions'", content["versions"], {"multicontact": str})
    recording = content["recording"]
    files = [recording[key] for key in ("model", "columns") if key in recording]
    for log in recording["logs"]:
        files += log["files"] if fits(log.get("files"), list) and log["files"] else [log]
    for file in files:
        _check("a file of its 'recording'", file, {"file": str, "sha256": str})


def _check(what: str, content: Any, needed: Mapping[str, Any]) -> None:
    """Checks that content is a mapping with entries of these types."""
    _need(isinstance(content, dict), f"{what} is no JSON object")
    missing = [key for key in needed if key not in content]
    _need(not missing, f"{what} lacks {', '.join(missing)}")
    for key, kind in needed.items():
        _need(fits(content[key], kind), f"{what} needs {in_words(kind)} as '{key}'")


def _need(holds: bool, otherwise: str) -> None:
    """Refuses what does not hold, by the second half of a sentence."""
    if not holds:
        raise InputError(otherwise)


_ESTIMATE: Mapping[str, Any] = {
    "columns": list[str],
    "values": list[float],
    "covariance": list[list[float]],
    "std_setup": list[float],
    "regrouping": dict[str, str],
    "bodies": dict[str, dict],
    "held_out": dict[str, dict],
    "setup": list[dict],
    "verdict": str,
}
"""Entries of `estimate.json` that are used."""


@dataclass(frozen=True, eq=False)
class LogAgreement:
    """Agreement of n logs in r parameters.

    Attributes:
        names: Names of the parameters that all logs have.
        difference: Each log's parameters less the mean of the other logs that agree (n, r).
        std: Standard deviations of these differences, times `spread` (n, r).
        chi2: Squared Mahalanobis distances, over `spread` squared (n,).
        spread: Differences between logs over those that their noise explains, 1 or more.
        differ: True for logs that differ from the others (n,).
    """

    names: tuple[str, ...]
    difference: np.ndarray
    std: np.ndarray
    chi2: np.ndarray
    spread: float
    differ: np.ndarray

    @property
    def z(self) -> np.ndarray:
        """Differences in their standard deviations (n, r)."""
        return self.difference / self.std

    @property
    def most(self) -> np.ndarray:
        """Parameters in descending order of what the logs that differ, or all if none does, differ by (r,)."""
        shown = self.z[self.differ] if self.differ.any() else self.z
        return np.argsort(-np.sqrt((shown**2).mean(axis=0)), kind="stable")


def agreement(values: Sequence[Mapping[str, float]], covariances: Sequence[np.ndarray]) -> LogAgreement | None:
    """Agreement of logs, None for fewer than two, or without a common parameter.

    Args:
        values: Parameters of each log by name.
        covariances: Covariance of these from the log's noise, in the same order.
    """
    names = tuple(name for name in (values[0] if values else ()) if all(name in each for each in values))
    if len(values) < 2 or not names:
        return None
    x = np.array([[each[name] for name in names] for each in values])
    which = [[list(each).index(name) for name in names] for each in values]
    covariance = np.array([C[np.ix_(k, k)] for C, k in zip(covariances, which, strict=True)])
    variances = np.diagonal(covariance, axis1=1, axis2=2)
    precision = np.array([_inverse(each) for each in covariance])
    z2 = ((x - np.median(x, axis=0)) ** 2 / variances).mean(axis=1)
    agree = np.zeros(len(x), bool)
    agree[np.argsort(z2, kind="stable")[: (len(x) + 1) // 2]] = True
    # Trials with up to half of the logs set apart took three rounds.
    for _ in range(20):
        difference, spans, chi2 = _from_others(x, covariance, precision, agree)
        spread2 = max(1.0, float(np.median(chi2) / special.chdtri(len(names), 0.5)))
        before, agree = agree, special.chdtrc(len(names), chi2 / spread2) > SIGNIFICANT / len(x)
        if (agree == before).all() or not agree.any():
            break
    return LogAgreement(names, difference, np.sqrt(spread2 * spans), chi2 / spread2, float(np.sqrt(spread2)), ~agree)


def _from_others(
    x: np.ndarray, covariance: np.ndarray, precision: np.ndarray, agree: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Differences of logs from the others that agree (n, r), their variances (n, r), and χ² (n,)."""
    difference, variances, chi2 = np.zeros_like(x), np.zeros_like(x), np.zeros(len(x))
    every = np.arange(len(x))
    for k in every:
        # The only log that agrees is compared with all others.
        others = every[agree & (every != k)] if agree[every != k].any() else every[every != k]
        mean = _inverse(precision[others].sum(axis=0))
        difference[k] = x[k] - mean @ np.einsum("jab,jb->a", precision[others], x[others])
        variances[k] = np.diag(covariance[k] + mean)
        chi2[k] = difference[k] @ _inverse(covariance[k] + mean) @ difference[k]
    return difference, variances, chi2


def _inverse(matrix: np.ndarray) -> np.ndarray:
    """Inverse of a covariance or precision (r, r), whose parameters may differ in size by many powers of ten."""
    size = np.sqrt(np.diag(matrix))
    eigenvalues, vectors = np.linalg.eigh(matrix / np.outer(size, size))
    # Smaller ones of a correlation matrix are rounding.
    return np.asarray((vectors / np.maximum(eigenvalues, 1e-12)) @ vectors.T) / np.outer(size, size)


@dataclass(frozen=True)
class LogOutcome:
    """Outcome of one log.

    Attributes:
        log: Its name.
        folder: Name of the folder with its results; empty if it failed.
        verdict: Outcome of the verdict, as of `ident.judgement.verdict.Outcome`; empty if it failed.
        doubts: Codes of the findings against the estimate.
        predicted: Channels that it predicts.
        missed: Channels that count and that it does not predict.
        ratios: Held-out residual over signal by channel.
        values: Base parameters and drives by name.
        std: Their standard deviations with the uncertainty of the set-up, by name.
        units: Their units, by name.
        seconds: CPU time, s.
        error: The sentence with which it failed; empty if it did not.
        files: SHA-256 sums of the files in its folder, by name.
    """

    log: str
    folder: str = ""
    verdict: str = ""
    doubts: Sequence[str] = ()
    predicted: Sequence[str] = ()
    missed: Sequence[str] = ()
    ratios: Mapping[str, float] = field(default_factory=dict)
    values: Mapping[str, float] = field(default_factory=dict)
    std: Mapping[str, float] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    seconds: float = 0.0
    error: str = ""
    files: Mapping[str, str] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """All of it in JSON's types."""
        return asdict(self)


@dataclass(frozen=True)
class Spread:
    """A parameter over several logs.

    Attributes:
        name: Its name.
        unit: Its unit.
        logs: Number of logs that have it.
        mean: Mean, weighted by the inverse variances.
        std: Standard deviation of that mean, if the logs' own deviations are right.
        between: Standard deviation between the logs.
        rms_z: Root mean square deviation from the mean over the logs' own deviations, about 1 if these are right; NaN
            for a single log.
    """

    name: str
    unit: str
    logs: int
    mean: float
    std: float
    between: float
    rms_z: float


def spreads(outcomes: Sequence[LogOutcome]) -> list[Spread]:
    """Parameters over all logs that did not fail, in the order of their first occurrence."""
    names = dict.fromkeys(name for each in outcomes for name in each.values)
    return [_spread(name, [each for each in outcomes if name in each.values]) for name in names]


def _spread(name: str, outcomes: Sequence[LogOutcome]) -> Spread:
    """Spread of a parameter over logs that have it."""
    values = np.array([each.values[name] for each in outcomes])
    std = np.array([each.std[name] for each in outcomes])
    weights = 1 / np.maximum(std, 1e-300) ** 2
    mean, number = float(values @ weights / weights.sum()), len(values)
    between = float(values.std(ddof=1)) if number > 1 else np.nan
    # The mean follows the values, which takes a degree of freedom.
    z = float(np.sqrt(((values - mean) ** 2 * weights).sum() / (number - 1))) if number > 1 else np.nan
    return Spread(name, outcomes[0].units[name], number, mean, float(weights.sum() ** -0.5), between, z)
