"""Entries of `estimate.json`: what `identify` writes is what the documentation lists."""

import re
from pathlib import Path

import ident
from ident.judgement.finding import FINDINGS, SetupFinding

PAGE = Path(ident.__file__).parents[1] / "docs" / "reading_a_report.md"
ROW = re.compile(r"\| (`\w+`(?:, `\w+`)*) \| (.+) \|")


def documented():
    """Documented entries with their description."""
    rows = [ROW.fullmatch(line) for line in PAGE.read_text(encoding="utf-8").splitlines()]
    rows = [row.groups() for row in rows if row]
    return {name: contents for names, contents in rows for name in re.findall(r"`(\w+)`", names)}


def test_a_set_up_error_has_the_documented_entries_and_the_code_of_its_finding():
    values = {"of": "ground", "axis": None, "value": 0.02, "std": 0.001}
    entry = SetupFinding("delay(ground)", 0.02, 0.001, "delay", values, ()).to_dict()
    assert set(re.findall(r"`(\w+)`", documented()["setup"])) == entry.keys()
    assert FINDINGS[entry["code"]].rendered(values) == entry["text"]
