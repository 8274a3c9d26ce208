"""A document: what a report says and shows, before it is a page, text, or files for print."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from experiments.document.replay import Replay
from experiments.document.tabular import Table
from experiments.document.terminal import wrapped
from ident.judgement.finding import Finding, line_of
from ident.judgement.verdict import Verdict
from ident.recordings.recording import Recording

if TYPE_CHECKING:
    from matplotlib.figure import Figure


class Card(NamedTuple):
    """A finding: its text under a title of a few words, and True if it is a doubt."""

    title: str
    text: str
    doubt: bool

    @classmethod
    def of(cls, finding: Finding) -> Self:
        """Card of a finding."""
        return cls(finding.title, finding.text, finding.doubt)


class Headline(NamedTuple):
    """A verdict in a word and a sentence, and its outcome: `usable`, `partly` or `not`."""

    word: str
    sentence: str
    outcome: str

    @classmethod
    def of(cls, verdict: Verdict) -> Self:
        """Headline of a verdict."""
        return cls(verdict.word, verdict.brief, verdict.outcome.value)

    @property
    def symbol(self) -> str:
        """Sign of the outcome."""
        return {"usable": "✓", "partly": "◐", "not": "✕"}[self.outcome]

    @property
    def line(self) -> str:
        """Line of the terminal."""
        return wrapped(f"{self.symbol} {self.word}. {self.sentence}")


@dataclass(frozen=True, eq=False)
class Plot:
    """A figure that is drawn when it is first asked for, and its caption."""

    draw: Callable[[], "Figure"]
    caption: str

    @cached_property
    def figure(self) -> "Figure":
        """The figure."""
        return self.draw()


@dataclass(frozen=True, eq=False)
class Document:
    """Contents of a folder of results, by file name without suffix, and of their page.

    Attributes:
        title: Its title.
        about: Description of the command, in a sentence or two.
        headline: Headline of the verdict, if the results are judged.
        verdict: The verdict in full.
        pictures: Pictures of the first screen.
        findings: Findings on the results.
        lines: Sentences with the main numbers.
        heading: Heading of these sentences.
        folded: More sentences, which the page shows when their summary is opened, by that summary.
        tables: Tables.
        figures: Figures.
        numbers: Contents of JSON files.
        blocks: Texts to copy, by purpose.
        replay: Replay of the motion.
        recordings: Recordings, by the names of their files, `.npz` or `.csv`.
        files: Functions that write other files, given their path, by name; None for one that is written already.
        screen: Text for the terminal, by default tables, verdict and lines.
        verbose: Longer text for the terminal, by default the same.
    """

    title: str = ""
    about: str = ""
    headline: Headline | None = None
    verdict: str = ""
    pictures: Sequence[str] = ()
    findings: Sequence[Card] = ()
    lines: Sequence[str] = ()
    heading: str = "In numbers"
    folded: Mapping[str, Sequence[str]] = field(default_factory=dict)
    tables: Mapping[str, Table] = field(default_factory=dict)
    figures: Mapping[str, Plot] = field(default_factory=dict)
    numbers: Mapping[str, dict[str, Any]] = field(default_factory=dict)
    blocks: Mapping[str, str] = field(default_factory=dict)
    replay: Replay | None = None
    recordings: Mapping[str, Recording] = field(default_factory=dict)
    files: Mapping[str, Callable[[Path], object] | None] = field(default_factory=dict)
    screen: str = ""
    verbose: str = ""

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
        doubts = [line_of(card.text, True) for card in self.findings if card.doubt]
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
