"""Files of any origin: limits on what they may take in memory, errors for damage and for missing libraries."""

import json
import re
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import InputError, LogError
from ident.files.column import UNITS

LIMIT = 500_000_000
"""Default of the bytes that arrays may take in memory: a million samples of sixty channels."""

NUMBER = 8
"""Bytes of a number in memory; in the file it may be one byte."""

PIECE = 1 << 16
"""Bytes that are unpacked or received at a time."""

LONGEST = 4_000_000
"""Characters of the longest line of a log, enough for a hundred thousand columns or for metadata in JSON."""

TOML = 1_000_000
"""Largest file of settings in bytes, whose entries take a hundred times as much."""

TOML_LINE = 20_000
"""Longest line of such a file: `tomllib` takes 100 bytes for every digit of a number."""

TOML_DEPTH = 32
"""Most names with dots between them in a key, of which `tomllib` keeps every beginning."""

_NAME = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
_TOO_DEEP = re.compile(rf"(?<![\w-]){_NAME}(?:[ \t]*+\.[ \t]*+{_NAME}){{{TOML_DEPTH}}}")

SI = {unit: factor for units in UNITS.values() for unit, factor in units.items()}
"""All known units, as factors to SI."""


def check_size(path: Path, size: int, limit: int) -> None:
    """Refuses a size in memory above a limit, unless the file itself is as large.

    Raises:
        LogError: The size exceeds the limit and `NUMBER` times the size of the file.
    """
    if size > max(limit, NUMBER * path.stat().st_size):
        raise LogError(
            f"the file takes {size / 1e6:.0f} MB in memory where at most {limit / 1e6:.0f} MB are expected of it; if "
            "it may be so large, say so (--max-size)."
        )


def parsed_json(text: str) -> Any:
    """Content of a JSON text from an archive or a file.

    Raises:
        ValueError: It is malformed, or so long that what it holds could take gigabytes.
        RecursionError: It is nested too deeply.
    """
    if len(text) > LONGEST:
        raise ValueError(f"JSON of {len(text) / 1e6:.0f} MB where at most {LONGEST / 1e6:g} MB are expected")
    return json.loads(text)


def toml(path: Path, needs: str) -> dict[str, Any]:
    """Entries of a TOML file.

    Args:
        path: The file.
        needs: What needs to be TOML, for messages, as "a study needs".

    Raises:
        LogError: It cannot be read, is malformed or beyond the limits.
    """
    try:
        with path.open("rb") as file:
            content = file.read(TOML + 1)
        if len(content) > TOML:
            raise ValueError(f"it has more than {TOML / 1e6:g} MB")
        text = content.decode("utf-8-sig")
        for number, line in enumerate(text.split("\n"), start=1):
            if len(line) > TOML_LINE or _TOO_DEEP.search(line):
                raise ValueError(
                    f"row {number} has more than {TOML_LINE} characters, or {TOML_DEPTH} names with dots between them"
                )
        return tomllib.loads(text)
    # Not all errors are the parser's own: Python refuses numbers of thousands of digits, and deep nesting.
    except (OSError, ValueError, RecursionError) as wrong:
        raise LogError(f"{path}: {needs} to be TOML in UTF-8 ({reason(wrong)}).") from None


def reason(error: object) -> str:
    """An error or its text as one line, short enough for a message."""
    if "allow_pickle" in str(error):
        return "pickled objects are not read"
    text = str(getattr(error, "strerror", None) or error).removesuffix(".")
    line = " ".join(text.split()) or type(error).__name__
    return line if len(line) <= 200 else f"{line[:197]}..."


@contextmanager
def library(extra: str, what: str = "This log") -> Iterator[None]:
    """Turns a failed import in a block into a sentence that names the extra to install.

    Args:
        extra: The extra.
        what: What needs it, for the message.

    Raises:
        InputError: The import failed.
    """
    try:
        yield
    except ImportError as error:
        package = error.name or str(error)
        raise InputError(
            f"{what} needs the package '{package}', which the extra '{extra}' brings: "
            f"pip install multicontact[{extra}]."
        ) from None


@contextmanager
def undamaged(what: str) -> Iterator[None]:
    """Turns any error that a library raises in a block into one sentence on the damaged file.

    Args:
        what: Kind of file that is needed, for the message.

    Raises:
        LogError: The block failed.
    """
    try:
        yield
    except LogError:
        raise
    # Each library has a dozen classes of errors for damage, and a damaged size may ask for any amount of memory.
    except Exception as error:
        raise LogError(f"the file needs to be {what} ({reason(error)}).") from error


def checked_rate(rate: float, what: str) -> float:
    """The rate in Hz, checked to be positive and finite.

    Raises:
        LogError: It is not.
    """
    if not (np.isfinite(rate) and rate > 0):
        raise LogError(f"{what} needs to be positive, the file says {rate:g} Hz.")
    return float(rate)
