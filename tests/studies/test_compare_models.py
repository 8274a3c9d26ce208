"""Models side by side: their bodies and drives."""

import json
from dataclasses import replace

import driven_arm
import mujoco
import numpy as np
import pytest
from commands import refusal

import sim
from experiments import compare
from experiments.data.model_comparison import pairs
from experiments.reports import compare_models_report
from ident.mechanism.drives import Drive
from sim.models.model_update import write_model


@pytest.fixture
def models(tmp_path):
    """A model, and one with another mass, first moment and drives."""
    (tmp_path / "arm.xml").write_text(driven_arm.text(more=driven_arm.ACTUATORS), encoding="utf-8")
    arm = sim.mechanism(tmp_path / "arm.xml")
    phi = arm.known.copy()
    phi[20:] *= 1.1
    drives = {"bend": replace(arm.drives["bend"], viscous=0.45), "turn": Drive(0.8, 0.9, 0.2)}
    write_model(tmp_path / "new.xml", arm, phi, drives)
    return [tmp_path / "arm.xml", tmp_path / "new.xml"]


def test_bodies_and_drives_are_side_by_side(models, tmp_path, capsys):
    assert compare.main([*map(str, models), "--out", str(tmp_path / "out")]) == 0
    written = json.loads((tmp_path / "out" / "comparison.json").read_text(encoding="utf-8"))
    (pair,) = written["pairs"]
    bodies = {(row["of"], row["quantity"]): row for row in pair["bodies"]}
    assert bodies["fore", "mass"]["second"] == pytest.approx(1.65) and bodies["upper", "mass"]["second"] == 3.0
    assert bodies["fore", "centre of mass x"]["second"] == pytest.approx(0.15)
    drives = {(row["of"], row["quantity"]): row for row in pair["drives"]}
    assert (drives["bend", "viscous"]["first"], drives["bend", "viscous"]["second"]) == (0.3, 0.45)
    assert drives["bend", "viscous"]["unit"] == "N m s" and drives["bend", "kp"]["first"] == 30.0
    assert ("turn", "spring") not in drives and drives["lift", "spring reference"]["first"] == 0.4
    assert "relatively most the viscous friction of bend, by +50 %." in capsys.readouterr().out


def test_a_robot_is_the_same_in_both_formats(tmp_path, capsys):
    urdf = """<robot name="arm"><link name="base"/><joint name="turn" type="revolute"><parent link="base"/>
      <child link="one"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="9" velocity="9"/>
      <dynamics damping="1.0" friction="0.5"/></joint><link name="one"><inertial><mass value="1"/>
      <origin xyz="0.1 0 0"/><inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
      </robot>"""
    mjcf = """<mujoco><worldbody><body name="one"><joint name="turn" axis="0 0 1" damping="1" frictionloss="0.5"/>
      <inertial mass="1" pos="0.1 0 0" diaginertia="0.1 0.1 0.1"/></body></worldbody></mujoco>"""
    (tmp_path / "arm.urdf").write_text(urdf, encoding="utf-8")
    (tmp_path / "arm.xml").write_text(mjcf, encoding="utf-8")
    assert compare.main([str(tmp_path / "arm.urdf"), str(tmp_path / "arm.xml"), "--out", str(tmp_path / "out")]) == 0
    assert "arm.urdf and arm.xml have the same bodies and drives." in capsys.readouterr().out


def test_what_only_one_model_has_is_listed(models):
    whole, changed = map(sim.mechanism, models)
    shorter = sim.mechanism(models[0], fix={"bend": [0.0]})
    (pair,) = pairs(["whole", "shorter"], [whole, shorter])
    assert pair.alone == ["Only whole has the joints bend."]
    assert {row.of for row in pair.drives} == {"turn", "lift"}
    both = pairs(["whole", "changed", "shorter"], [whole, changed, shorter])
    document = compare_models_report.document(both, {})
    assert set(document.tables) == {f"table_{what}_{k}" for what in ("bodies", "drives") for k in (2, 3)}


def test_a_slide_has_the_units_of_a_slide():
    text = """<mujoco><worldbody><body name="cart"><joint name="x" type="slide" damping="2" stiffness="3"/>
      <geom size="0.1"/></body></worldbody></mujoco>"""
    arm = sim.mechanism(mujoco.MjSpec.from_string(text))
    (pair,) = pairs(["a", "b"], [arm, arm])
    assert {row.quantity: row.unit for row in pair.drives} == {"viscous": "N s/m", "spring": "N/m"}
    assert all(row.difference == 0 for row in pair.bodies) and np.isfinite([row.first for row in pair.bodies]).all()


BODY = """<mujoco><worldbody><body name="b"><joint name="j" {}/>
  <inertial mass="0.001" pos="{} 0 0" diaginertia="{} 1e-8 1e-8"/></body></worldbody></mujoco>"""


def pair_of(*texts):
    """Two models of a text each."""
    return pairs(["one", "other"], [sim.mechanism(mujoco.MjSpec.from_string(text)) for text in texts])[0]


@pytest.mark.parametrize("motion", ["type='slide'", "type='ball'"])
def test_drives_of_joints_that_move_differently_are_not_compared(motion):
    pair = pair_of(BODY.format("damping='2'", 0, 1e-8), BODY.format(f"{motion} damping='2'", 0, 1e-8))
    assert pair.unlike == ["j"] and not pair.drives
    assert pair.alone == ["Drives of joints that move in another way in one and other are not compared: j."]
    assert compare_models_report.sentence(pair) == "All 10 quantities that one and other have in common are the same."


def test_percent_is_of_the_size_of_its_kind():
    pair = pair_of(BODY.format("", "0.1", 2e-8), BODY.format("damping='2'", "0.11", 1.5e-8))
    rows = {row.quantity: row.percent for row in [*pair.bodies, *pair.drives]}
    assert rows["centre of mass x"] == pytest.approx(10) and rows["centre of mass y"] == 0
    assert rows["inertia xx"] == pytest.approx(-25) and rows["inertia yy"] == 0 and rows["viscous"] is None


def test_rounding_is_no_difference(models):
    (pair,) = pairs(["arm", "new"], list(map(sim.mechanism, models)))
    assert all(row.percent == 0 for row in pair.bodies if row.of != "fore")
    assert {row.quantity for row in pair.bodies if row.differs} == {"mass", *(f"inertia {x}{x}" for x in "xyz")}


def test_small_inertias_are_legible():
    pair = pair_of(*2 * [BODY.format("", 0, 1e-8)])
    assert "0.0000000100" in compare_models_report.table(pair, pair.bodies, "Bodies").text()


def test_figure_shows_masses_and_drives(models):
    (pair,) = pairs(["arm", "new_$"], list(map(sim.mechanism, models)))
    (ax,) = compare_models_report.figure(pair).axes
    labels = [label.get_text() for label in ax.get_yticklabels()]
    assert labels[:3] == ["mass of column", "mass of upper", "mass of fore"] and len(labels) == 3 + len(pair.drives)
    first, second = (line.get_xdata() for line in ax.lines[1:])
    assert first[2] == pytest.approx(1 / 1.1) and second[2] == 1
    assert "Shown are" not in compare_models_report.caption(pair)


def test_figure_of_many_shows_those_that_differ_most(models, monkeypatch):
    monkeypatch.setattr(compare_models_report.row_panels, "most_rows", lambda: 2)
    (pair,) = pairs(["arm", "new"], list(map(sim.mechanism, models)))
    shown = [(row.of, row.quantity) for row in compare_models_report.shown_rows(pair)]
    assert shown == [("fore", "mass"), ("bend", "viscous")]
    assert "Shown are the 2 of 20 that differ most" in compare_models_report.caption(pair)


def test_options_of_models_are_those_of_identify(models, tmp_path, capsys):
    joined = driven_arm.text(more="<equality><weld name='held' body1='fore'/></equality>")
    names = ["a.xml", "b.xml"]
    for name in names:
        (tmp_path / name).write_text(joined, encoding="utf-8")
    files = [str(tmp_path / name) for name in names]
    out = ["--out", str(tmp_path / "out")]
    refusal(compare.main, [*files, *out], capsys)
    assert compare.main([*files, "--ignore", "held", "--fix", "bend", "0.5", *out]) == 0
    written = json.loads((tmp_path / "out" / "comparison.json").read_text(encoding="utf-8"))
    assert {row["of"] for row in written["pairs"][0]["drives"]} == {"turn", "lift"}
    assert {row["percent"] for row in written["pairs"][0]["bodies"]} == {0.0}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["arm.xml", "."], "folders of results or of model files, not of both"),
        (["arm.xml", "arm.xml"], "needs two or more different model files"),
        (["arm.xml", "other.xml"], "have no body in common; bodies are compared by name"),
        (["arm.xml", "bad.xml"], "bad.xml"),
        ([".", "..", "--base", "column"], "--base is for model files"),
        ([".", "..", "--fix", "bend"], "--fix is for model files"),
        (["arm.xml", "absent.xml"], "A model is an MJCF, URDF or OpenSim file that exists, got 'absent.xml'"),
        (["absent.xml", "."], "folders of results or of model files, not of both"),
        (["arm.xml", "new.xml", "--fix", "bend", "x"], "--fix takes a joint and where it stands"),
        (
            ["arm.xml", "new.xml", "--caption", "x", "y"],
            "--caption needs one of table_bodies, table_drives, figure_models",
        ),
        (["arm.xml", "new.xml", "--parameters", "m1"], "there are none here, got 'm1'"),
        (["arm.xml", "new.xml", "--base", "nowhere"], "nowhere"),
    ],
)
@pytest.mark.usefixtures("models")
def test_bad_input_is_one_sentence(tmp_path, monkeypatch, capsys, arguments, message):
    monkeypatch.chdir(tmp_path)
    other = "<mujoco><worldbody><body name='x'><joint/><geom size='1'/></body></worldbody></mujoco>"
    (tmp_path / "other.xml").write_text(other, encoding="utf-8")
    (tmp_path / "bad.xml").write_text("<mujoco><worldbody>", encoding="utf-8")
    assert message in refusal(compare.main, [*arguments, "--out", "out"], capsys)
    assert not (tmp_path / "out").exists()
