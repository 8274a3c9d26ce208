"""Pages that hold everything they show: templates of HTML, filled with results."""

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
from experiments.output import escape, figures, report
from experiments.output.page_symbols import pieces
from experiments.output.replay import Replay
from experiments.output.results import Results
from experiments.output.terminal import wrapped
from ident.errors import InputError
from ident.recordings.atomic import replacing

PAGE = "report.html"
"""The page in a folder of results."""


@dataclass(frozen=True)
class Said:
    """What a page says besides its tables and figures.

    Attributes:
        title: Its title.
        about: What the command does, in a sentence or two.
        verdict: Whether to believe the results, where that is judged.
        findings: What was found on them, each with whether it is a doubt.
        lines: Sentences with the main numbers.
        heading: What they are about.
        blocks: Texts to copy, by what they are for.
        replay: What moves.
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
    """Writes `report.html` into a folder that holds these results, which it links to."""
    moving = None if said.replay is None else said.replay.to_page()
    page = rendered("report.html", folder, {"": shown}, formats, said=said, replay=moving)
    with replacing(folder / PAGE) as temporary:
        temporary.write_text(page, encoding="utf-8", errors="backslashreplace")


def write_results(args: argparse.Namespace, folder: Path, shown: Results, formats: Iterable[str], said: Said) -> str:
    """Writes tables, figures, numbers and their page into a folder, for print as the command line says.

    Returns:
        Why captions and parameters are not as it says, in a sentence, else nothing.
    """
    layout, refused = shown.chosen(layout_of(args))
    shown.write(folder, formats, layout)
    write_report(folder, shown, formats, said)
    return refused


def filmed(asked: bool, folder: Path, said: Said) -> tuple[Said, str]:
    """What a page says, with a film of what moves written into the folder if one is asked for.

    Returns:
        It with the name of the film, and why there is none although it is asked for, in a sentence, else nothing.
    """
    if not asked or said.replay is None:
        return said, ""
    from experiments.output.film import write_film

    try:
        name = write_film(folder, said.replay.mechanism, said.replay.to_page())
    except InputError as error:
        return said, f"All but the film is written: {error}"
    return replace(said, files=(*said.files, name)), ""


def conclude(args: argparse.Namespace, found: Results, said: Said, origin: dict[str, Any]) -> Results:
    """Ends a command that has no more to write than results: writes them with a page, and prints what they say.

    Args:
        args: The command line: folder `out` and `formats`.
        found: What was found.
        said: What the page says besides, of which the terminal shows verdict and lines.
        origin: Where it comes from, as of `report.provenance`.

    Returns:
        All that was written.

    Raises:
        InputError: A film is asked for, and cannot be written, or captions or parameters are chosen of what is not
            there; all else is written.
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
    """Ends a command, after everything is written and printed, with what is not as it was asked for.

    Raises:
        InputError: There is such a sentence.
    """
    if told := " ".join(filter(None, sentences)):
        raise InputError(told)


def rendered(template: str, root: Path, shown: Mapping[str, Results], formats: Iterable[str], **values: object) -> str:
    """A page in one file, which runs no script but its own and asks for nothing from anywhere.

    Args:
        template: File of the folder `templates`.
        root: Folder of the page.
        shown: Results by the names of their folders in `root`, or by an empty name those in `root` itself; they are
            written.
        formats: Formats of the figures.
        values: What else the template takes.
    """

    def png(folder: str, name: str) -> str:
        drawn = root / folder / f"{name}.png"
        return base64.b64encode(drawn.read_bytes() if drawn.is_file() else _png(shown[folder], name)).decode()

    given = {"results": shown, "formats": sorted(set(formats)), "png": png}
    return _environment().get_template(template).render(**given, **values)


@cache
def _environment() -> Environment:
    """The templates, which are compiled when they are first used: that takes as long as to fill them."""
    environment = Environment(
        loader=PackageLoader("experiments.output"),
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
    """A figure that was written in other formats only."""
    return figures.drawn(results.figures[name][0], "png")


def _visible(value: Any) -> Any:
    """A text without what would turn the text around it, HTML that is one already the same."""
    return type(value)(escape.visible(value)) if isinstance(value, str) else value


def _digest(text: str) -> str:
    """How a page's policy names the one script, or style, that it allows."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _indented(content: Any) -> str:
    """JSON for readers."""
    return json.dumps(content, indent=1, ensure_ascii=False)
