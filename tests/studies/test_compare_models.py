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


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["arm.xml", "."], "folders of results or of model files, not of both"),
        (["arm.xml", "arm.xml"], "needs two or more different model files"),
        (["arm.xml", "other.xml"], "have no body in common; bodies are compared by name"),
        (["arm.xml", "bad.xml"], "bad.xml"),
        ([".", "..", "--base", "column"], "--base is for model files"),
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
