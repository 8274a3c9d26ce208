"""The files that `identify` writes, read and checked entry by entry, since users may have edited them."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.data.comparison import Result
from ident.annotations import fits, in_words
from ident.errors import InputError

LARGE = 1e30
"""Larger than any number of an identification; its inverse is smaller than any standard deviation."""

Content = Mapping[str, Any]


class _WrongError(Exception):
    """An entry is invalid; the message is the second half of a sentence."""


def read_results(folders: Sequence[Path]) -> list[Result]:
    """Reads folders that `identify` has written.

    Raises:
        InputError: A folder lacks a file, or holds something else.
    """
    if len(folders) < 2 or len({folder.resolve() for folder in folders}) < len(folders):
        raise InputError("A comparison needs two or more different folders of results.")
    names = [folder.resolve().name for folder in folders]
    if len(set(names)) < len(names):
        names = list(map(str, folders))
    return [
        Result(name, estimate_of(folder), provenance_of(folder)) for name, folder in zip(names, folders, strict=True)
    ]


def estimate_of(folder: Path) -> Content:
    """Content of `estimate.json` in a folder.

    Raises:
        InputError: The folder lacks it, or a needed entry is missing or of another type.
    """
    return _read(folder / "estimate.json", _check_estimate)


def covariance_of(folder: Path, names: Sequence[str]) -> np.ndarray:
    """Covariance of some parameters from the noise, of the `estimate.json` in a folder; raises as `estimate_of`."""
    estimate = estimate_of(folder)
    where = [estimate["columns"].index(name) for name in names]
    return np.array(estimate["covariance"], float)[np.ix_(where, where)]


def provenance_of(folder: Path) -> Content:
    """Content of `provenance.json`; raises as `estimate_of`."""
    return _read(folder / "provenance.json", _check_provenance)


def _read(path: Path, check: Callable[[Content], None]) -> Content:
    try:
        content: Content = json.loads(path.read_text(encoding="utf-8"))
        # Half of a surrogate pair is text for JSON, but cannot be written to a file.
        json.dumps(content, ensure_ascii=False).encode()
    except (OSError, ValueError, RecursionError) as error:
        raise InputError(f"'{path.parent}' needs to hold results of identify, but {path.name}: {error}.") from None
    try:
        check(content)
    except _WrongError as error:
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
    _check_covariance(np.array(covariance, float), [columns.index(name) for name in base])
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
    if not holds:
        raise _WrongError(otherwise)


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
