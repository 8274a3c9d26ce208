"""Files of `identify`: entries of estimate.json, and what is called held out."""

import re
from pathlib import Path

import driven_arm
import numpy as np
import pytest
from mechanisms import by_joint, sines

import ident
import sim
from experiments import identify
from ident import joint_torque_regressor
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


URDF = """<robot name="r"><link name="base"/>{}</robot>"""
JOINT = """<joint name="{0}" type="revolute"><parent link="{1}"/><child link="{2}"/><origin xyz="{3} 0 0"/>
<axis xyz="0 1 0"/><limit lower="-3" upper="3" effort="9" velocity="9"/></joint>
<link name="{2}"><inertial><origin xyz=".1 0 .02"/><mass value="2"/>
<inertia ixx=".02" ixy="0" ixz="0" iyy=".02" iyz="0" izz=".02"/></inertial></link>"""


@pytest.mark.usefixtures("undrawn")
def test_rotors_that_a_urdf_file_cannot_hold_are_named_on_the_screen(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    links = JOINT.format("lift", "base", "upper", 0) + JOINT.format("bend", "upper", "fore", 0.3)
    Path("arm.urdf").write_text(URDF.format(links), encoding="utf-8")
    arm, time, rng = sim.mechanism("arm.urdf"), np.arange(600) / 100, np.random.default_rng(0)
    states = sines(time, rng.uniform(0.2, 0.5, (2, 4)), np.array([2.0, 3.1, 4.7, 6.0]), rng.uniform(0, 6, (2, 4)))
    torques = joint_torque_regressor(arm.tree, *states, gravity=arm.gravity) @ arm.known + 0.4 * states[2]
    torques = torques + 0.01 * rng.normal(size=torques.shape)
    ident.Recording(time, by_joint(arm.joints, position=states[0], torque=torques)).save("log.csv")
    assert identify.main(["arm.urdf", "log.csv", "--estimator", "weighted", "--cutoff", "8"]) == 0
    end = capsys.readouterr().out.rpartition("open report.html.")[2]
    # That of the first joint is part of its link.
    assert end.strip() == "model.urdf cannot hold Ia(bend)."
