"""Generated parts of docs/validation.md, README.md and paper.md: tables, sentences and figures of the validation."""

import html
import json
from collections.abc import Sequence
from pathlib import Path
from textwrap import fill
from typing import Any

from experiments.data.validation import WORSE, Study, inside
from experiments.document import symbols
from experiments.reports import validation_tables as tables
from experiments.reports.validation_report import STEEL, overview_lines, truth_lines, worse_lines
from experiments.studies.validation.files import registry
from ident.errors import InputError
from ident.files.atomic import replacing

FILE = "validation.json"
"""Record of the shown run in docs."""

KNOWN = "Estimates less true values in half-widths of their 95 % intervals, by system"
"""Words for a picture."""

WIDTH = 140
"""Characters of a line of text."""


def results(root: Path) -> dict[str, Any]:
    """Key numbers for docs/validation.md: those of `results/validate`, or else the current ones.

    Raises:
        InputError: They are of some recordings only.
    """
    made, shown = root / "results" / "validate" / "summary.json", root / "docs" / FILE
    numbers = json.loads((made if made.exists() else shown).read_text(encoding="utf-8"))
    there = {*numbers["recordings"], *(each["entry"] for each in numbers["truths"].values())}
    if missing := [name for name, entry in registry().items() if entry.tried and name not in there]:
        raise InputError(
            f"docs/validation.md shows all recordings, but '{made}' has no {', '.join(missing)}: run it on all."
        )
    return dict(numbers)


def write_record(path: Path, numbers: dict[str, Any]) -> None:
    """Writes the numbers as JSON, a line for each recording."""
    rest = {key: value for key, value in numbers.items() if key != "recordings"}
    lines = [f"{json.dumps(name)}: {json.dumps(each)}" for name, each in numbers["recordings"].items()]
    text = ",\n".join(lines)
    with replacing(path) as temporary:
        temporary.write_text(f'{json.dumps(rest)[:-1]}, "recordings": {{\n{text}\n}}}}\n', encoding="utf-8")


def page_blocks(study: Study) -> dict[str, str]:
    """Contents of the blocks of docs/validation.md, by name."""
    shown = {
        "truth": tables.table_truth(study),
        "peers": tables.table_peers(study),
        "recordings": tables.table_recordings(study),
        "held out": tables.table_held_out(study),
        "published": tables.table_published(study),
        "steel": tables.table_steel(study.validations[STEEL]),
        "agreement": tables.table_agreement(study),
        "was published": tables.table_was_published(study),
    }
    registered = "".join(
        f"| `{entry.name}` | {symbols.markdown(entry.title)} | {entry.source.repository} | "
        f"{entry.source.licence or 'not verified'} | {symbols.markdown(entry.note)} |\n"
        for entry in study.untried
    )
    head = "| name | recording | repository | licence | what is missing |\n| --- | --- | --- | --- | --- |\n"
    texts = {name: table.markdown() for name, table in shown.items()}
    verdicts = "".join(f"<li>{html.escape(f'{each.entry.title}: {each.verdict}')}</li>\n" for each in study)
    worse = (tables.table_worse(study), tables.table_outside(study), tables.table_missed(study))
    shown_worse = [_list(worse_lines(study)), *(table.markdown() for table in worse if table.rows)]
    return {
        "known": f"**{truth_lines(study)[0]}**\n\n![{KNOWN}](validation_known.svg)\n",
        "sentences": _list(overview_lines(study)),
        "worse": "\n".join(shown_worse),
        # HTML, as Markdown within it is not read everywhere.
        "verdicts": f"<details><summary>Verdicts in words</summary>\n<ul>\n{verdicts}</ul>\n</details>\n",
        **texts,
        "untried": head + registered,
    }


def _list(lines: Sequence[str]) -> str:
    """List of sentences."""
    return "".join(f"- {symbols.markdown(line)}\n" for line in lines)


def summary_blocks(study: Study) -> dict[str, str]:
    """Contents of the blocks of README.md and paper.md, by name: known parameters, and the main other numbers."""
    ratio, held = study.against_best, {kind: f"{100 * inside(z):.0f} %" for kind, z in study.trial_z.items()}
    best, worse = int((ratio <= 1).sum()), int((ratio > WORSE).sum())
    systems = len({each.entry.folder for each in study})
    text = (
        f"On {len(study.validations)} public recordings of {systems} systems, identified unattended, the estimate "
        f"predicts held-out data best in {best} of {len(ratio)} channels, and in {worse} it is worse by more than 5 % "
        "than the model as it came or least squares at the best of five cut-offs. Of the differences between "
        f"recordings of one system, {held['bodies']} of the bodies' and {held['friction']} of the frictions' are "
        "inside their 95 % intervals: friction changes from trial to trial. Where the verdict is 'unusable', "
        f"{held['unusable']} are."
    )
    return {name: f"{fill(each, WIDTH)}\n" for name, each in (("known", truth_lines(study)[0]), ("validation", text))}
