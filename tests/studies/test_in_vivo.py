"""The recording of a person, if available, and a sentence if not."""

import json
import os
from pathlib import Path

import pytest
from commands import refusal
from pages import replayed

from experiments.in_vivo import __main__ as in_vivo

DATA = Path(os.environ.get("MULTICONTACT_DATA", "")) / "human_bowing"
needs_data = pytest.mark.skipif(not (DATA / "bowing.csv").is_file(), reason="MULTICONTACT_DATA has no human_bowing")


def test_what_is_missing_is_named(tmp_path, capsys):
    message = refusal(in_vivo.main, ["--data", str(tmp_path), "--out", str(tmp_path / "out")], capsys)
    assert (
        "three_link_human.xml and bowing.csv" in message and "has no three_link_human.xml and no bowing.csv" in message
    )
    assert not (tmp_path / "out").exists()


@needs_data
@pytest.mark.usefixtures("undrawn")
def test_inertias_are_a_persons_where_filters_halve_them(tmp_path, capsys):
    assert in_vivo.main(["--data", str(DATA), "--out", str(tmp_path / "out")]) == 0
    assert "trajectory estimate" in capsys.readouterr().out
    assert replayed(tmp_path / "out" / "report.html")["estimated"]
    summary = json.loads((tmp_path / "out" / "summary.json").read_text(encoding="utf-8"))
    at = {name: summary["names"].index(name) for name in ("Iyy2", "Iyy3")}
    value = {name: {k: each["values"][i] for k, i in at.items()} for name, each in summary["parameters"].items()}
    model, joint = value["scaled model"], value["trajectory estimate"]
    for k, i in at.items():
        assert abs(joint[k] - model[k]) < 2 * summary["parameters"]["trajectory estimate"]["std"][i]
        assert (
            value["least squares, 6 Hz"][k] < 0.7 * model[k] and value["weighted, cut-off chosen"][k] < 0.7 * model[k]
        )
    held_out = summary["held_out"]
    assert held_out["trajectory estimate"]["Fz"] < min(
        held_out[name]["Fz"] for name in held_out if name != "trajectory estimate"
    )
    assert held_out["trajectory estimate"]["My"] < held_out["least squares, 6 Hz"]["My"]
