"""A document: what a report says and shows, before it is a page, text, or files for print."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from experiments.document.replay import Replay
from experiments.document.tabular import Table
from experiments.document.terminal import wrapped
from ident.judgement.finding import line_of
from ident.recordings.recording import Recording


@dataclass(frozen=True, eq=False)
class Document:
    """Contents of a folder of results, by file name without suffix, and of their page.

    Attributes:
        title: Its title.
        about: Description of the command, in a sentence or two.
        verdict: Verdict on the results, if they are judged.
        findings: Findings on them, each with True if it is a doubt.
        lines: Sentences with the main numbers.
        heading: Heading of these sentences.
        folded: More sentences, which the page shows when their summary is opened, by that summary.
        tables: Tables.
        figures: Figures and their captions.
        numbers: Contents of JSON files.
        blocks: Texts to copy, by purpose.
        replay: Replay of the motion.
        recordings: Recordings, by the names of their files, `.npz` or `.csv`.
        files: Functions that write other files, given their path, by name; None for one that is written already.
        screen: Text for the terminal, by default tables, verdict and lines.
    """

    title: str = ""
    about: str = ""
    verdict: str = ""
    findings: Sequence[tuple[str, bool]] = ()
    lines: Sequence[str] = ()
    heading: str = "In numbers"
    folded: Mapping[str, Sequence[str]] = field(default_factory=dict)
    tables: Mapping[str, Table] = field(default_factory=dict)
    figures: Mapping[str, tuple[Figure, str]] = field(default_factory=dict)
    numbers: Mapping[str, dict[str, Any]] = field(default_factory=dict)
    blocks: Mapping[str, str] = field(default_factory=dict)
    replay: Replay | None = None
    recordings: Mapping[str, Recording] = field(default_factory=dict)
    files: Mapping[str, Callable[[Path], object] | None] = field(default_factory=dict)
    screen: str = ""

    def __or__(self, more: "Document") -> "Document":
        """The document with the tables, figures and numbers of another one."""
        return replace(
            self,
            tables={**self.tables, **more.tables},
            figures={**self.figures, **more.figures},
            numbers={**self.numbers, **more.numbers},
        )

    def text(self) -> str:
        """Text for the terminal."""
        # The verdict counts doubts, so that they stand below it; the page has the other findings too.
        doubts = [line_of(text, doubt) for text, doubt in self.findings if doubt]
        tables = [table.text() for table in self.tables.values()]
        shown = [*tables, *filter(None, [self.verdict]), *doubts, *self.lines]
        return self.screen or wrapped("\n".join(shown))

    def loading(self, folder: Path) -> str:
        """Sentence on how to load the recordings from a folder in Python; empty without any."""
        first, *others = [name for name in self.recordings if name.endswith(".npz")] or [""]
        if not first:
            return ""
        like = f"; likewise {', '.join(others)}" if others else ""
        return wrapped(f'In Python, ident.Recording.load("{(folder / first).as_posix()}") is the recording{like}.')
