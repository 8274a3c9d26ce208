"""Results of identify: their files, checked as users may have edited them, and differences of two."""

import json
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from os.path import realpath
from pathlib import Path
from typing import Any

import numpy as np

from ident.annotations import fits, in_words
from ident.display.brief import listed
from ident.errors import InputError
from ident.files.limits import reason
from ident.judgement.residuals import Comparison

EXCLUDED = ("out", "name", "logs", "model", "held_out", "verbose")
"""Options without effect on results, and files, which are compared by content."""

LARGE = 1e30
"""Larger than any number of an identification; its inverse is smaller than any standard deviation."""


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
    """Difference of two results, for the base parameters with the same regrouping in both.

    Attributes:
        first: The result to subtract from.
        second: The result to subtract.
    """

    first: Result
    second: Result

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Base parameters with the same regrouping.

        Raises:
            InputError: There is none.
        """
        other = self.second.regrouping
        names = tuple(name for name, made_of in self.first.regrouping.items() if other.get(name) == made_of)
        if not names or self.first.bodies != self.second.bodies:
            raise InputError(
                f"Results of one mechanism can be compared, but '{self.first.name}' is of bodies "
                f"{', '.join(self.first.bodies)} and '{self.second.name}' of {', '.join(self.second.bodies)}, with "
                f"{len(names)} base parameters in common."
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
    results = [Result(name, estimate_of(folder), provenance_of(folder)) for name, folder in pairs]
    logs = {log for result in results for log in result.logs.items()}
    alike = len({name for _, name in logs}) < len(logs)
    return [replace(result, in_full=alike) for result in results]


def estimate_of(folder: Path) -> Content:
    """Content of `estimate.json` in a folder.

    Raises:
        InputError: The folder lacks it, or a needed entry is missing or of another type.
    """
    return _read(folder / "estimate.json", _check_estimate)


def covariance_of(folder: Path, names: Sequence[str]) -> np.ndarray:
    """Covariance of some parameters from the noise, of the `estimate.json` in a folder; raises as `estimate_of`."""
    return Result(folder.name, estimate_of(folder), {}).at(names)[1]


def provenance_of(folder: Path) -> Content:
    """Content of `provenance.json`; raises as `estimate_of`."""
    return _read(folder / "provenance.json", _check_provenance)


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
    _need(bool((sizes < LARGE).all()) and min(std, default=0) >= 0, "a number of it is out of range")
    _need(set(base) <= set(columns), "its 'regrouping' has parameters that are not among its 'columns'")
    own = [columns.index(name) for name in base]
    _need(all(std[k] > 1 / LARGE for k in own), "its 'std_setup' has a deviation that is not positive")
    _check_covariance(np.array(covariance, float), own)
    for channel, entry in content["held_out"].items():
        _need(fits(entry.get("ratio"), float | None), f"its 'held_out' has no number for '{channel}'")
    for entry in content["setup"]:
        _check("an entry of its 'setup'", entry, {"name": str, "text": str})


def _check_covariance(covariance: np.ndarray, base: Sequence[int]) -> None:
    """Checks that the base parameters have a covariance."""
    C = covariance.reshape(len(covariance), -1)[np.ix_(base, base)]
    std = np.sqrt(np.maximum(np.diag(C), 0))
    _need(bool((std > 1 / LARGE).all()), "its 'covariance' has a variance that is not positive")
    correlation = C / np.outer(std, std)
    symmetric = np.allclose(correlation, correlation.T, rtol=0, atol=1e-6)
    positive = symmetric and bool((np.linalg.eigvalsh(correlation) > -1e-6).all())
    _need(positive, "its 'covariance' is not symmetric and positive, as covariances are")


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
