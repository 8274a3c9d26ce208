"""The files that `identify` writes, read and checked entry by entry, since users may have edited them."""

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.data.comparison import Result
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
    _check_keys("it", content, _ESTIMATE)
    columns = content["columns"]
    _need(_is_list_of(columns, str), "its 'columns' are no list of names")
    for name in ("values", "std_setup"):
        _check_numbers(f"its '{name}'", content[name], len(columns))
    _need(min(content["std_setup"], default=0) >= 0, "its 'std_setup' has a negative number")
    _check_mapping("its 'regrouping'", content["regrouping"], str)
    base = list(content["regrouping"])
    _need(set(base) <= set(columns), "its 'regrouping' has parameters that are not among its 'columns'")
    _check_covariance(content["covariance"], len(columns), [columns.index(name) for name in base])
    _check_mapping("its 'bodies'", content["bodies"], dict)
    _check_mapping("its 'held_out'", content["held_out"], dict)
    for channel, entry in content["held_out"].items():
        _need(entry.get("ratio") is None or _is_number(entry["ratio"]), f"its 'held_out' has no number for '{channel}'")
    _need(_is_list_of(content["setup"], dict), "its 'setup' is no list of entries")
    for entry in content["setup"]:
        _check_keys("an entry of its 'setup'", entry, {"name": str, "text": str})


def _check_covariance(covariance: Any, size: int, base: Sequence[int]) -> None:
    """Checks a covariance of this size, with positive variances of the base parameters."""
    _need(_is_list_of(covariance, list) and len(covariance) == size, f"its 'covariance' has not {size} rows")
    for row in covariance:
        _check_numbers("a row of its 'covariance'", row, size)
    C = np.array(covariance, float).reshape(size, size)[np.ix_(base, base)]
    std = np.sqrt(np.maximum(np.diag(C), 0))
    _need(bool((std > 1 / LARGE).all()), "its 'covariance' has a variance that is not positive")
    correlation = C / np.outer(std, std)
    symmetric = np.allclose(correlation, correlation.T, rtol=0, atol=1e-6)
    _need(
        symmetric and bool((np.linalg.eigvalsh(correlation) > -1e-6).all()),
        "its 'covariance' is not symmetric and positive, as covariances are",
    )


def _check_provenance(content: Content) -> None:
    _check_keys("it", content, _PROVENANCE)
    _check_keys("its 'recording'", content["recording"], {"logs": list})
    _check_keys("its 'versions'", content["versions"], {"multicontact": str})
    files = [content["recording"][key] for key in ("model", "columns") if key in content["recording"]]
    for log in content["recording"]["logs"]:
        several = log.get("files") if isinstance(log, dict) else None
        files += several if isinstance(several, list) and several else [log]
    for file in files:
        _check_keys("a file of its 'recording'", file, {"file": str, "sha256": str})


def _check_keys(what: str, content: Any, needed: Mapping[str, type]) -> None:
    """Checks that content is a mapping with entries of these types."""
    _need(isinstance(content, dict), f"{what} is no JSON object")
    missing = [key for key in needed if key not in content]
    _need(not missing, f"{what} lacks {', '.join(missing)}")
    for key, kind in needed.items():
        _need(isinstance(content[key], kind), f"{what} has a '{key}' that is {_KINDS.get(kind, 'of another kind')}")


def _check_mapping(what: str, content: Mapping[str, Any], kind: type) -> None:
    _need(all(isinstance(each, kind) for each in content.values()), f"{what} have an entry that is {_KINDS[kind]}")


def _check_numbers(what: str, numbers: Any, size: int) -> None:
    right = isinstance(numbers, list) and len(numbers) == size and all(map(_is_number, numbers))
    _need(right, f"{what} has not {size} finite numbers, one for each of its 'columns'")


def _is_list_of(content: Any, kind: type) -> bool:
    return isinstance(content, list) and all(isinstance(each, kind) for each in content)


def _is_number(x: Any) -> bool:
    return isinstance(x, int | float) and not isinstance(x, bool) and abs(x) < LARGE


def _need(holds: bool, otherwise: str) -> None:
    if not holds:
        raise _WrongError(otherwise)


_KINDS: Mapping[type, str] = {str: "no text", list: "no list", dict: "no JSON object"}

_ESTIMATE: Mapping[str, type] = {
    "columns": list,
    "values": list,
    "covariance": list,
    "std_setup": list,
    "regrouping": dict,
    "bodies": dict,
    "held_out": dict,
    "setup": list,
    "verdict": str,
}
_PROVENANCE: Mapping[str, type] = {"options": dict, "recording": dict, "versions": dict, "git_commit": object}
