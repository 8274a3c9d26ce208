"""Comparison of results of `identify`: agreement of their parameters, and differences of their settings."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ident.errors import InputError
from ident.judgement.agreement import Comparison

EXCLUDED = ("out", "name", "logs", "model", "held_out", "page_columns")
"""Options without effect on results, and files, which are compared by content."""


@dataclass(frozen=True, eq=False)
class Result:
    """Results of an identification, read from its folder.

    Attributes:
        name: Name of the folder, or its path if names are not unique.
        estimate: Content of `estimate.json`.
        provenance: Content of `provenance.json`.
    """

    name: str
    estimate: Mapping[str, Any]
    provenance: Mapping[str, Any]

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
        return {"+".join(each["sha256"] for each in log): "+".join(each["file"] for each in log) for log in several}

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
