"""Files of `identify`: entries of estimate.json, and what is called held out."""

import re
from pathlib import Path

import driven_arm

import ident
from experiments import identify
from ident.judgement.finding import FINDINGS, SetupFinding

PAGE = Path(ident.__file__).parents[1] / "docs" / "reading_a_report.md"
ROW = re.compile(r"\| (`\w+`(?:, `\w+`)*) \| (.+) \|")


def documented():
    rows = filter(None, map(ROW.fullmatch, PAGE.read_text(encoding="utf-8").splitlines()))
    return {name: row[2] for row in rows for name in re.findall(r"`(\w+)`", row[1])}


def test_a_set_up_error_has_the_documented_entries_and_the_code_of_its_finding():
    values = {"of": "ground", "axis": None, "value": 0.02, "std": 0.001}
    entry = SetupFinding("delay(ground)", 0.02, 0.001, "delay", values, ()).to_dict()
    assert set(re.findall(r"`(\w+)`", documented()["setup"])) == entry.keys()
    assert FINDINGS[entry["code"]].rendered(values) == entry["text"]


def test_samples_that_were_fitted_are_not_called_held_out(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.xml").write_text(driven_arm.text(), encoding="utf-8")
    driven_arm.log(4.0, 50.0).save(tmp_path / "log.csv")
    options = "--estimator weighted --cutoff 8 --formats png --out out --name x --holdout 0"
    assert identify.main(["arm.xml", "log.csv", *options.split()]) == 0
    shown = capsys.readouterr().out
    for file in ("report.html", "estimate.json", "table_held_out.md", "table_held_out.tex"):
        shown += (tmp_path / "out" / "x" / file).read_text(encoding="utf-8")
    assert not re.search("held[- ]out", shown, re.IGNORECASE)
    assert "Usable to predict joint torques: fitted residuals" in shown
