"""Fixed joints that are in no log: the fingers of a hand, coupled by a mimic joint."""

from functools import partial

import mujoco
import numpy as np
import pytest
from commands import refusal

from experiments import excite, identify, stream
from experiments.cli import options, running
from experiments.studies.identification import prepare
from ident.identification import identified
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor
from ident.recordings.recording import STATES, Recording
from sim.models.mujoco_model import parameters_from_model, tree_from_model
from sim.models.notes import ModelNote

INERTIAL = '<inertial mass="{}" pos=".05 .02 .1" fullinertia=".02 .03 .015 .001 0 .002"/>'
HAND = f"""<mujoco><worldbody><body name="base">{INERTIAL.format(3)}
<body name="arm" pos="0 0 .3"><joint name="shoulder" axis="0 1 0"/>{INERTIAL.format(2)}
<body name="left" pos=".3 0 0"><joint name="finger1" type="slide" axis="0 1 0"/>{INERTIAL.format(0.3)}</body>
<body name="right" pos=".3 0 0"><joint name="finger2" type="slide" axis="0 -1 0"/>{INERTIAL.format(0.4)}</body>
</body></body></worldbody><equality><joint joint1="finger2" joint2="finger1"/></equality></mujoco>"""
"""An arm with two fingers, coupled like mimic joints of URDF."""

ODD = """<robot name="r"><link name="a"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="3" ixy="0" ixz="0" iyz="0"/></inertial></link></robot>"""

AT = 0.03
"""Position of the fingers, m."""

TIME = np.arange(300) / 100


@pytest.fixture
def files(tmp_path):
    """The model, and a recording of the wrench below it and of the shoulder's torque."""
    model, log = tmp_path / "hand.xml", tmp_path / "log.csv"
    model.write_text(HAND, encoding="utf-8")
    with pytest.warns(ModelNote, match="By equality"):
        tree, phi = tree_from_model(model, "base"), parameters_from_model(model, "base")
    w = 2 * np.pi * np.array([0.4, 0.9, 1.3])
    a, phase = np.array([0.7, 0.3, 0.1]), np.array([0.2, 1.1, 2.5])
    angle = np.multiply.outer(TIME, w) + phase
    q, dq, ddq = (a * np.sin(angle)).sum(1), (a * w * np.cos(angle)).sum(1), (-a * w**2 * np.sin(angle)).sum(1)
    states = (np.column_stack([q, 0 * q + AT, 0 * q + AT]), *(np.column_stack([x, 0 * x, 0 * x]) for x in (dq, ddq)))
    noise = 1e-6 * np.random.default_rng(0).normal(size=(len(TIME), 6))
    wrench = base_wrench_regressor(tree, *states, gravity=[0, 0, -9.81]) @ phi + noise
    torque = joint_torque_regressor(tree, *states, gravity=[0, 0, -9.81]) @ phi
    channels = {f"shoulder_{kind}": x for kind, x in zip(STATES, (q, dq, ddq), strict=True)}
    channels |= {"ground_force": wrench[:, :3], "ground_torque": wrench[:, 3:]}
    Recording(TIME, channels).save(log)
    return model, log, channels | {"shoulder_torque": torque[:, 0]}


@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
def test_a_log_without_the_fingers_gives_the_parameters_of_the_whole(files, tmp_path):
    model, log, _ = files
    prepared = prepare(model, log, base="base", fix={"finger1": [AT], "finger2": [AT]})
    assert prepared.mechanism.tree.joints == ("shoulder",) and len(prepared.mechanism.known) == 40
    result = identified(prepared)
    truth = prepared.equations.parameters.regroup(prepared.mechanism.known)
    np.testing.assert_allclose(result.psi, truth, atol=1e-6 * abs(truth).max())


@pytest.mark.usefixtures("here")
def test_what_to_type_is_said(files, tmp_path, capsys):
    model, log, _ = files
    arguments = [str(model), str(log), "--base", "base", "--out", str(tmp_path / "out")]
    for command in (identify, stream):
        message = refusal(command.main, arguments, capsys)
        assert "Where it does not move, --fix finger1 [VALUE] leaves it out" in message.replace("the joint", "it")
        assert "Note: By equality (joint) 'equality0' of finger1, finger2, joints without a column" in message
        for fix, what in {
            ("--fix", "thumb"): "There is no joint 'thumb' to fix; the joints are shoulder, finger1, finger2.",
            ("--fix", "finger1", "open"): "--fix takes a joint and where it stands, got finger1 open.",
            ("--fix", "finger1", "0", "1"): "Joint 'finger1' is fixed at 1 finite coordinates, got [0.0, 1.0].",
            ("--fix", "finger1", "nan"): "Joint 'finger1' is fixed at 1 finite coordinates, got [nan].",
        }.items():
            assert what in refusal(command.main, [*arguments, *fix], capsys)
    message = refusal(excite.main, [str(model), "--base", "base", "--joints", "finger1", "finger2"], capsys)
    assert "Joint 'finger2' cannot be excited: loops make it depend on finger1. Name finger1 with" in message


@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
def test_a_finger_whose_torque_is_measured_moves_the_other_until_their_coupling_is_ignored(files):
    model, log, channels = files
    Recording(TIME, channels).save(log)
    fingers = {f"finger{k}": [AT] for k in (1, 2)}
    assert prepare(model, log, base="base", fix=fingers).equations.channels[-1] == "shoulder"
    moving = {f"finger{k}_{kind}": 0 * TIME + (kind == "position") * AT for k in (1, 2) for kind in STATES}
    Recording(TIME, channels | moving).save(log)
    assert prepare(model, log, base="base").equations.channels[-1] == "shoulder"
    (note,) = (note for note in prepare(model, log, base="base", fix=fingers).notes if "--fix" in note)
    assert "joints that are fixed (--fix) were not read: finger1_position, finger1_velocity, finger1_acc" in note
    Recording(TIME, channels | moving | {"finger2_torque": 0.1 * np.sin(TIME)}).save(log)
    ready = prepare(model, log, base="base")
    assert ready.mechanism.tree.dependent == ("finger1",) and ready.equations.channels[-2:] == ("shoulder", "finger2")
    assert any(
        "The column of 'finger1' counts too, as loops are closed, but for a constant of 0." in x for x in ready.notes
    )
    assert prepare(model, log, base="base", ignore=("equality0",)).equations.channels[-2:] == ("shoulder", "finger2")


def test_notes_are_printed_once(tmp_path, capsys):
    path = tmp_path / "odd.urdf"
    path.write_text(ODD, encoding="utf-8")

    def study(_):
        tree_from_model(path)
        tree_from_model(path, "a")

    assert running.run(study, partial(options.command_parser, "study", None), []) == 0
    expected = "Note: The inertia stated for a is taken as it is, but no rigid body has it (A + B < C).\n"
    assert capsys.readouterr().err == expected


def test_coordinates_on_the_command_line():
    assert options.fixed([["a"], ["b", "-0.5"], ["c", "1", "0", "0", "0"]]) == {"a": [], "b": [-0.5], "c": [1, 0, 0, 0]}


def test_joints_are_fixed_where_the_model_draws_them():
    joint = '<joint name="j" axis="0 1 0" ref="40"/>'
    m = mujoco.MjModel.from_xml_string(
        f'<mujoco><worldbody><body name="a"><geom size=".1"/><body name="b" euler="10 0 0">{joint}<geom size=".1"/>'
        "</body></body></worldbody></mujoco>"
    )
    full, fixed = tree_from_model(m), tree_from_model(m, fix={"j": []})
    np.testing.assert_allclose(fixed.poses(np.zeros(0)), full.poses(m.qpos0), atol=1e-12)
