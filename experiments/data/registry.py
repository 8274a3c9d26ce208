"""Entries of the registry of public recordings."""

import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from ident.annotations import typed
from ident.errors import InputError
from ident.files.table import short

NAME = re.compile(r"\w(?:[\w.+ :-]{0,98}[\w+-])?", re.ASCII)
"""Form of the name of a file or folder, which no system takes for a path."""


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


@typed()
@dataclass(frozen=True)
class Published:
    """A published parameter.

    Attributes:
        name: Name of the base parameter or drive.
        value: Its value, SI units.
        std: Its published standard deviation; NaN if none is published.
        source: Origin of the value: formula, file, table.
    """

    name: str
    value: float
    std: float = float("nan")
    source: str = ""


@typed()
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
    median: float = float("nan")
    best: int = 0
    worse: float = float("nan")


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
        model: Name of the model's file.
        fitted: Names of the files of each fitted log.
        judged: Names of the files of each log to judge by; without any the end of each fitted log is held out.
        options: Options of `identify`, by name.
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
    published: tuple[Published, ...] = ()
    held_out: Mapping[str, float] = field(default_factory=dict)
    reference: Reference | None = None
    alike: tuple[tuple[str, ...], ...] = ()
    note: str = ""

    def __post_init__(self) -> None:
        single = [self.folder, *(file.name for file in self.files), self.options.get("columns", self.folder)]
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
