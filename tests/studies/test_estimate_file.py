"""Entries of `estimate.json`: what `identify` and `stream` write is what the documentation lists."""

import json
import re
from pathlib import Path

import pytest
from fuzz.undrawn import leave_undrawn

import ident
import scenes
from experiments import identify, stream
from ident.judgement.codes import FINDINGS
from ident.judgement.setup_findings import SetupFinding
from ident.judgement.summary import VERSION
from ident.judgement.verdict import Outcome
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.simulate import simulate

PAGE = Path(ident.__file__).parents[1] / "docs" / "reading_a_report.md"
ROW = re.compile(r"\| (`\w+`(?:, `\w+`)*) \| (.+) \| (both|identify|stream) \|")


def documented(command):
    """Documented entries of a command with their description."""
    rows = [ROW.fullmatch(line) for line in PAGE.read_text(encoding="utf-8").splitlines()]
    rows = [row.groups() for row in rows if row and row[3] in ("both", command)]
    return {name: contents for names, contents, _ in rows for name in re.findall(r"`(\w+)`", names)}


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Contents of the files by command, of the trajectory estimate and of one pass."""
    folder = tmp_path_factory.mktemp("written")
    model, log = folder / "model.xml", folder / "log.npz"
    spec = scenes.load("double_pendulum")
    spec.compile()
    model.write_text(spec.to_xml(), encoding="utf-8")
    simulate(spec, DOUBLE_PENDULUM, samples=400).save(log)
    given = [str(model), str(log), "--base", "base", "--out"]
    with pytest.MonkeyPatch.context() as patched:
        leave_undrawn(patched)
        assert identify.main([*given, str(folder), "--name", "identify"]) == 0
        assert stream.main([*given, str(folder / "stream")]) == 0
    return {
        command: json.loads((folder / command / "estimate.json").read_text(encoding="utf-8"))
        for command in ("identify", "stream")
    }


@pytest.mark.parametrize("command", ["identify", "stream"])
def test_the_file_has_the_documented_entries(written, command):
    assert written[command].keys() == documented(command).keys()


@pytest.mark.parametrize("command", ["identify", "stream"])
def test_what_both_commands_write_has_one_form(written, command):
    estimate = written[command]
    assert estimate["version"] == VERSION and f"`version`, now {VERSION}," in PAGE.read_text(encoding="utf-8")
    assert estimate["outcome"] in {outcome.value for outcome in Outcome} and isinstance(estimate["verdict"], str)
    assert all(f"`{outcome.value}`" in documented(command)["outcome"] for outcome in Outcome)
    n = len(estimate["columns"])
    assert len(estimate["values"]) == len(estimate["std"]) == len(estimate["covariance"]) == n
    assert all(len(row) == n for row in estimate["covariance"])
    assert list(estimate["regrouping"]) == estimate["columns"][: len(estimate["regrouping"])]
    assert estimate["part"] in ("held-out", "fitted") and estimate["condition_number"] > 1
    assert all(each["ratio"] > 0 for each in estimate["held_out"].values())
    assert all(each.keys() == {"value", "std"} for each in estimate["offsets"].values())
    assert estimate["findings"]
    for each in estimate["findings"]:
        assert each.keys() == {"code", "values", "doubt", "place", "text"}
        assert FINDINGS[each["code"]].rendered(each["values"]) == each["text"]


def test_a_set_up_error_has_the_documented_entries_and_the_code_of_its_finding():
    values = {"of": "ground", "axis": None, "value": 0.02, "std": 0.001}
    entry = SetupFinding("delay(ground)", 0.02, 0.001, "delay", values, ()).to_dict()
    assert set(re.findall(r"`(\w+)`", documented("identify")["setup"])) == entry.keys()
    assert FINDINGS[entry["code"]].rendered(values) == entry["text"]
