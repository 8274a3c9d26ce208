"""Files of `identify`: angles in one and forces in another, markers, and its estimate.json."""

import json
import re
from pathlib import Path

import driven_arm
import numpy as np
import pytest
from guesses.odd_logs import recording
from written_formats import DEG, write_csv, write_mot

import ident
import scenes
from experiments import columns, identify
from ident.judgement.finding import FINDINGS, SetupFinding

MODEL = str(Path(scenes.__file__).parent / "double_pendulum.xml")


def files(tmp_path, number=1):
    """OpenSim's pair of files, with a plate at its own rate and other column names."""
    angles, forces = tmp_path / f"trial{number}_ik.mot", tmp_path / f"trial{number}_grf.csv"
    taken = slice(100 * number, 100 * number + 250)
    time, wrench = recording().time[taken], recording().wrench("ground").values[taken]
    write_mot(angles, {"time": time, **{f"joint{k}": DEG * recording()[f"joint{k}_position"][taken] for k in (1, 2)}})
    own = np.arange(time[0], time[-1], 1 / 200)
    names = [f"plate_{letter}{axis}" for letter in "fm" for axis in "xyz"]
    write_csv(
        forces,
        {"clock_ms": 1e3 * own, **{name: np.interp(own, time, x) for name, x in zip(names, wrench.T, strict=True)}},
    )
    return f"{angles}+{forces}"


@pytest.mark.usefixtures("undrawn")
def test_two_commands_lead_from_two_files_to_parameters(tmp_path, capsys):
    log = files(tmp_path)
    assert columns.main([MODEL, log, "--base", "base"]) == 0
    *_, command = capsys.readouterr().out.strip().splitlines()
    written = (tmp_path / "trial1_ik.toml").read_text(encoding="utf-8")
    assert 'time = [{ column = "time", unit = "s" }, { column = "clock_ms", unit = "ms" }]' in written
    arguments = [*command.split()[2:], "--out", str(tmp_path), "--name", "out"]
    assert identify.main(arguments) == 0
    logs = json.loads((tmp_path / "out" / "provenance.json").read_text(encoding="utf-8"))["recording"]["logs"]
    assert [each["file"] for each in logs[0]["files"]] == ["trial1_ik.mot", "trial1_grf.csv"]
    estimate = json.loads((tmp_path / "out" / "estimate.json").read_text(encoding="utf-8"))
    assert estimate["held_out"]["Mx"]["ratio"] < 0.2 and estimate["held_out"]["Fz"]["ratio"] < 0.5


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


OPTIONS = ["--estimator", "weighted", "--cutoff", "8", "--formats", "png", "--out", "out", "--name", "x"]


@pytest.mark.parametrize(("holdout", "there"), [("0", False), ("0.4", True)])
def test_samples_that_were_fitted_are_not_called_held_out(tmp_path, capsys, monkeypatch, holdout, there):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.xml").write_text(driven_arm.text(), encoding="utf-8")
    driven_arm.log(4.0, 50.0).save(tmp_path / "log.csv")
    assert identify.main(["arm.xml", "log.csv", *OPTIONS, "--holdout", holdout]) == 0
    shown = capsys.readouterr().out
    for file in ("report.html", "estimate.json", "table_held_out.md", "table_held_out.tex"):
        shown += (tmp_path / "out" / "x" / file).read_text(encoding="utf-8")
    assert bool(re.search("held[- ]out", shown, re.IGNORECASE)) is there
    assert ("Usable to predict joint torques: fitted residuals" in shown) is not there
