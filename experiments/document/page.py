"""Self-contained HTML pages: templates filled with results."""

import argparse
import base64
import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from experiments.cli.print_options import author_choices, layout_of
from experiments.document import escape, figures, report
from experiments.document.page_symbols import pieces
from experiments.document.replay import Replay
from experiments.document.results import Results
from experiments.document.terminal import wrapped
from ident.errors import InputError
from ident.files.atomic import replacing

PAGE = "report.html"
"""Name of the page in a folder of results."""


@dataclass(frozen=True)
class Said:
    """Contents of a page besides its tables and figures.

    Attributes:
        title: Its title.
        about: Description of the command, in a sentence or two.
        verdict: Verdict on the results, if they are judged.
        findings: Findings on them, each with True if it is a doubt.
        lines: Sentences with the main numbers.
        heading: Heading of these sentences.
        blocks: Texts to copy, by purpose.
        replay: Replay of the motion.
        files: Names of other files in the same folder.
    """

    title: str
    about: str = ""
    verdict: str = ""
    findings: Sequence[tuple[str, bool]] = ()
    lines: Sequence[str] = ()
    heading: str = "In numbers"
    blocks: Mapping[str, str] = field(default_factory=dict)
    replay: Replay | None = None
    files: Sequence[str] = ()


def write_report(folder: Path, shown: Results, formats: Iterable[str], said: Said) -> None:
    """Writes `report.html` into a folder that holds these results, with links to them."""
    moving = None if said.replay is None else said.replay.to_page()
    page = rendered("report.html", folder, {"": shown}, formats, said=said, replay=moving)
    with replacing(folder / PAGE) as temporary:
        temporary.write_text(page, encoding="utf-8", errors="backslashreplace")


def write_results(args: argparse.Namespace, folder: Path, shown: Results, formats: Iterable[str], said: Said) -> str:
    """Writes tables, figures, numbers and their page into a folder, in the layout of the command line.

    Returns:
        A sentence if captions or parameters cannot be applied, else an empty one.
    """
    layout, refused = shown.chosen(layout_of(args))
    shown.write(folder, formats, layout)
    write_report(folder, shown, formats, said)
    return refused


def filmed(asked: bool, folder: Path, said: Said) -> tuple[Said, str]:
    """Writes a film of the replay into the folder, if asked for.

    Returns:
        The contents of the page with the film's name, and a sentence if it cannot be written, else an empty one.
    """
    if not asked or said.replay is None:
        return said, ""
    from experiments.document.film import write_film

    try:
        name = write_film(folder, said.replay.mechanism, said.replay.to_page())
    except InputError as error:
        return said, f"All but the film is written: {error}"
    return replace(said, files=(*said.files, name)), ""


def conclude(args: argparse.Namespace, found: Results, said: Said, origin: dict[str, Any]) -> Results:
    """Writes the results of a command with a page, and prints them.

    Args:
        args: The command line: folder `out` and `formats`.
        found: The results.
        said: Further contents of the page; the terminal shows verdict and lines.
        origin: Provenance, from `report.provenance`.

    Returns:
        All written results.

    Raises:
        InputError: The film cannot be written, or captions or parameters are chosen that do not exist; all else is
            written.
    """
    options = {**origin["options"], **author_choices(args)}
    written = found | Results(numbers={"provenance": {**origin, "options": options}})
    with report.results_folder(args.out, stale=report.OUTPUTS) as folder:
        said, missing = filmed(getattr(args, "film", False), folder, said)
        refused = write_results(args, folder, written, args.formats, said)
    shown = [*(table.text() for table in written.tables.values()), *filter(None, [said.verdict]), *said.lines]
    print(wrapped("\n".join(shown)))
    print(f"Everything is in {args.out}; open {PAGE}.")
    complain(missing, refused)
    return written


def complain(*sentences: str) -> None:
    """Raises an error at the end of a command, after all output, if a request could not be met.

    Raises:
        InputError: A sentence is not empty.
    """
    if told := " ".join(filter(None, sentences)):
        raise InputError(told)


def rendered(template: str, root: Path, shown: Mapping[str, Results], formats: Iterable[str], **values: object) -> str:
    """A page in one file, which runs only its own script and loads nothing.

    Args:
        template: File of the folder `templates`.
        root: Folder of the page.
        shown: Written results by folder name in `root`; the empty name stands for `root` itself.
        formats: Formats of the figures.
        values: Other variables of the template.
    """

    def png(folder: str, name: str) -> str:
        drawn = root / folder / f"{name}.png"
        return base64.b64encode(drawn.read_bytes() if drawn.is_file() else _png(shown[folder], name)).decode()

    given = {"results": shown, "formats": sorted(set(formats)), "png": png}
    return _environment().get_template(template).render(**given, **values)


@cache
def _environment() -> Environment:
    """The templates; they are compiled at first use, which takes as long as filling them."""
    environment = Environment(
        loader=PackageLoader("experiments.document"),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_visible,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"pieces": pieces, "indented": _indented, "digest": _digest}
    return environment


def _png(results: Results, name: str) -> bytes:
    """A figure as PNG that was written in other formats only."""
    return figures.drawn(results.figures[name][0], "png")


def _visible(value: Any) -> Any:
    """A text without marks of writing direction; keeps the type of HTML texts."""
    return type(value)(escape.visible(value)) if isinstance(value, str) else value


def _digest(text: str) -> str:
    """Hash by which a page's content security policy names an allowed script or style."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _indented(content: Any) -> str:
    """Indented JSON."""
    return json.dumps(content, indent=1, ensure_ascii=False)
