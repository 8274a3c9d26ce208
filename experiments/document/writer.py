"""Documents and their writing: HTML, TeX, Markdown, CSV and JSON files, and figures in a folder; the screen's text."""

import base64
import hashlib
import json
import re
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cache, cached_property, partial
from html import escape
from importlib.util import cache_from_source
from pathlib import Path
from pickle import UnpicklingError
from typing import TYPE_CHECKING, Any, NamedTuple, Self

from jinja2 import Environment, FileSystemBytecodeCache, PackageLoader, StrictUndefined
from jinja2.bccache import Bucket
from jinja2.filters import do_mark_safe

from experiments.document import print_table, typography
from experiments.document.replay import Replay
from experiments.document.result_folder import OUTPUTS, results_folder, write_json
from experiments.document.tabular import Table
from experiments.document.typography import pieces, wrapped
from ident import __version__
from ident.files.atomic import replacing
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
        parts = ("tables", "figures", "numbers")
        both: dict[str, Any] = {part: {**getattr(self, part), **getattr(more, part)} for part in parts}
        return replace(self, **both)

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


EMBEDDED = {"png": "image/png", "svg": "image/svg+xml"}
"""Formats of figures that a page can embed, the first of those that are written, and their media types."""


def page(template: str, root: Path, shown: Mapping[str, Document], formats: Iterable[str], **values: object) -> str:
    """A page in one file, which runs only its own script and loads nothing.

    Args:
        template: File of the folder `templates`.
        root: Folder of the page.
        shown: Written documents by folder name in `root`; the empty name stands for `root` itself.
        formats: Formats in which the figures are written. No figure is drawn again for the page: it embeds the file of
            one of these formats, and links to a figure that is written as PDF alone.
        values: Other variables of the template.
    """
    chosen = sorted(set(formats))
    embedded = next((ending for ending in EMBEDDED if ending in chosen), None)

    def picture(folder: str, name: str) -> str:
        if embedded is None:
            return ""
        content = (root / folder / f"{name}.{embedded}").read_bytes()
        return f"data:{EMBEDDED[embedded]};base64,{base64.b64encode(content).decode()}"

    given = {"results": shown, "formats": chosen, "picture": picture}
    return environment().get_template(template).render(**given, **values)


class _Compiled(FileSystemBytecodeCache):
    """Compiled templates in the folder of Python's own bytecode, if that can be written."""

    def load_bytecode(self, bucket: Bucket) -> None:
        """Reads a compiled template, if it is whole."""
        with suppress(OSError, EOFError, UnpicklingError):
            super().load_bytecode(bucket)

    def dump_bytecode(self, bucket: Bucket) -> None:
        """Keeps a compiled template."""
        if not sys.dont_write_bytecode:
            with suppress(OSError):
                super().dump_bytecode(bucket)


@cache
def environment() -> Environment:
    """The templates, compiled once."""
    environment = Environment(
        bytecode_cache=_Compiled(str(Path(cache_from_source(__file__)).parent), f"%s.{__version__}.jinja"),
        loader=PackageLoader("experiments.document"),
        autoescape=lambda name: not (name or "").endswith(".txt"),
        undefined=StrictUndefined,
        finalize=_visible,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    indented = partial(json.dumps, indent=1, ensure_ascii=False)
    own = {"pieces": pieces, "options": _options, "indented": indented, "digest": _digest, "form": format}
    environment.filters |= own
    return environment


def sentences(template: str, **values: object) -> list[str]:
    """Sentences of a template of text, each of which begins with a dash at the margin."""
    text = environment().get_template(template).render(**values)
    return [" ".join(each.split("\n")).strip() for each in re.split("^- ", text, flags=re.MULTILINE)[1:]]


def _visible(value: Any) -> Any:
    """A text without marks of writing direction; keeps the type of HTML texts."""
    return type(value)(typography.visible(value)) if isinstance(value, str) else value


def _options(text: str) -> str:
    """Text in HTML, in which no line breaks within the name of an option.

    >>> print(_options("as <b> --no-rail has"))
    as &lt;b&gt; <code class="option">--no-rail</code> has
    """
    return do_mark_safe(re.sub(r"(?<!\S)--[a-z][\w-]*", r'<code class="option">\g<0></code>', escape(text)))


def _digest(text: str) -> str:
    """Hash by which a page's content security policy names an allowed script or style."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


PAGE = "report.html"
"""Name of the page in a folder of results."""


@dataclass(frozen=True)
class Output:
    """A folder for documents, and the formats of figures."""

    folder: Path
    formats: Sequence[str]


def write(
    document: Document,
    out: Output,
    *,
    stale: Sequence[str] = OUTPUTS,
    inputs: Sequence[Path] = (),
    then: str = "",
    verbose: bool = False,
) -> Document:
    """Writes a document into its folder with a page, prints it and returns it.

    Args:
        document: The document.
        out: Its folder.
        stale: Patterns of files of an earlier run to remove.
        inputs: Input files, which are never replaced.
        then: What to do next, in a sentence.
        verbose: True to print the longer text.
    """
    written(document, out, stale=stale, inputs=inputs)
    print((verbose and document.verbose) or document.text())
    end(document, out, then)
    return document


def end(document: Document, out: Output, then: str = "") -> None:
    """Prints where everything is and how to load recordings."""
    print(f"Everything is in {out.folder}; open {PAGE}.")
    for line in filter(None, (document.loading(out.folder), then)):
        print(line)


def written(document: Document, out: Output, *, stale: Sequence[str] = OUTPUTS, inputs: Sequence[Path] = ()) -> None:
    """Writes a document into its folder with a page, arguments as for `write`."""
    with results_folder(out.folder, stale=stale, inputs=inputs) as folder:
        write_parts(document, replace(out, folder=folder))
        for name, recording in document.recordings.items():
            recording.save(folder / name)
        for name, save in document.files.items():
            if save is not None:
                save(folder / name)
        write_page(document, folder, out.formats)


def write_parts(document: Document, out: Output) -> None:
    """Writes tables, figures with their data and for PDF the float that holds them, and numbers into a folder."""
    texts = dict[str, str]()
    for name, table in document.tables.items():
        texts |= {
            f"{name}.csv": table.csv(),
            f"{name}.md": table.markdown(),
            f"{name}.tex": print_table.tex(table, name),
        }
    for name, plot in document.figures.items() if out.formats else ():
        # Commands that draw nothing start without matplotlib.
        from experiments.document import figures

        figures.save(plot.figure, out.folder, name, out.formats)
        texts[f"{name}.csv"] = figures.csv_text(plot.figure)
        if "pdf" in out.formats:
            texts[f"{name}.tex"] = print_table.figure(name, plot.caption, float(plot.figure.get_figwidth()))
    for name, content in texts.items():
        (out.folder / name).write_text(content, encoding="utf-8")
    for name, numbers in document.numbers.items():
        write_json(out.folder / f"{name}.json", numbers)


def write_page(document: Document, folder: Path, formats: Iterable[str]) -> None:
    """Writes `report.html` into a folder that holds the document's other files, with links to them."""
    moving = None if document.replay is None else document.replay.to_page()
    content = page("report.html", folder, {"": document}, formats, replay=moving)
    with replacing(folder / PAGE) as temporary:
        temporary.write_text(content, encoding="utf-8", errors="backslashreplace")
