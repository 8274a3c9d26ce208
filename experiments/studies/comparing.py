"""Results of `identify` side by side: whether their parameters agree, and what was done otherwise."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from experiments.studies.result_files import estimate_of, provenance_of
from ident.errors import InputError
from ident.judgement.comparison import Comparison

UNTOLD = ("out", "name", "logs", "model", "held_out", "page_columns", "style", "caption", "parameters")
"""Options that decide nothing, or are files, which are told by their contents."""


@dataclass(frozen=True, eq=False)
class Result:
    """What an identification left in its folder.

    Attributes:
        name: What the folder is called, with the folders above it as far as others have the same name.
        estimate: Content of `estimate.json`.
        provenance: Content of `provenance.json`.
    """

    name: str
    estimate: Mapping[str, Any]
    provenance: Mapping[str, Any]

    @property
    def regrouping(self) -> Mapping[str, str]:
        """Base parameters, each with what it is made of."""
        return self.estimate["regrouping"]

    @property
    def bodies(self) -> tuple[str, ...]:
        """Names of the bodies by their numbers."""
        return tuple(self.estimate["bodies"])

    @property
    def logs(self) -> Mapping[str, str]:
        """Files that were fitted, by the sums of their contents."""
        several = [log.get("files") or [log] for log in self.provenance["recording"]["logs"]]
        return {"+".join(each["sha256"] for each in log): "+".join(each["file"] for each in log) for log in several}

    @property
    def settings(self) -> Mapping[str, str]:
        """All that was chosen, in words."""
        files, origin = self.provenance["recording"], self.provenance
        chosen = {key: _told(value) for key, value in origin["options"].items() if key not in UNTOLD}
        told = {
            key: f"{files[key]['file']} ({files[key]['sha256'][:8]})" for key in ("model", "columns") if key in files
        }
        version = {"version": str(origin["versions"]["multicontact"]), "commit": str(origin["git_commit"])}
        return chosen | told | {"logs": ", ".join(self.logs.values())} | version

    def at(self, names: Sequence[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Values (k,), covariance from noise (k, k) and deviations with the set-up (k,) of some parameters."""
        found = self.estimate
        where = [found["columns"].index(name) for name in names]
        covariance = np.array(found["covariance"], float)[np.ix_(where, where)]
        return np.array(found["values"], float)[where], covariance, np.array(found["std_setup"], float)[where]


def _told(value: Any) -> str:
    if isinstance(value, list):
        return " ".join(map(str, value)) or "none"
    if isinstance(value, bool):
        return "yes" if value else "no"
    return "none" if value is None else str(value)


def read_results(folders: Sequence[Path]) -> list[Result]:
    """Reads folders that `identify` has written.

    Raises:
        InputError: One of them lacks a file, or holds something else.
    """
    if len(folders) < 2 or len({folder.resolve() for folder in folders}) < len(folders):
        raise InputError("A comparison needs two or more different folders of results.")
    names = [folder.resolve().name for folder in folders]
    if len(set(names)) < len(names):
        names = list(map(str, folders))
    return [
        Result(name, estimate_of(folder), provenance_of(folder)) for name, folder in zip(names, folders, strict=True)
    ]


@dataclass(frozen=True, eq=False)
class Difference:
    """One result less another, of the base parameters that mean the same in both.

    Attributes:
        first: The one.
        second: The other.
    """

    first: Result
    second: Result

    @cached_property
    def names(self) -> tuple[str, ...]:
        """Base parameters of the same regrouping.

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
        """Logs that both were fitted to, whose noise is in both: no interval of the difference is known then."""
        return [file for sum_, file in self.first.logs.items() if sum_ in self.second.logs]

    @cached_property
    def comparison(self) -> Comparison:
        """The difference from noise that the two do not share.

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
        """Deviations of the difference with what each leaves open of a set-up of its own (k,)."""
        return np.hypot(self.first.at(self.names)[2], self.second.at(self.names)[2])

    @property
    def settings(self) -> dict[str, tuple[str, str]]:
        """What was chosen otherwise."""
        a, b = self.first.settings, self.second.settings
        pairs = {key: (a.get(key, "none"), b.get(key, "none")) for key in (*a, *b)}
        return {key: pair for key, pair in pairs.items() if pair[0] != pair[1]}
