"""Fixed joints that are in no log: the fingers of a hand, coupled by a mimic joint."""

import numpy as np
import pytest
from commands import refusal

from experiments import excite, identify, stream
from experiments.studies.user_files import prepare
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
            ("--fix", "finger1", "0", "1"): "Joint 'finger1' is fixed at 1 coordinates below 1e+08, got [0.0, 1.0].",
            ("--fix", "finger1", "1e300"): "Joint 'finger1' is fixed at 1 coordinates below 1e+08, got [1e+300].",
            ("--fix", "finger1", "nan"): "Joint 'finger1' is fixed at 1 coordinates below 1e+08, got [nan].",
        }.items():
            assert what in refusal(command.main, [*arguments, *fix], capsys)
    message = refusal(excite.main, [str(model), "--base", "base", "--joints", "finger1", "finger2"], capsys)
    assert "Joint 'finger2' cannot be excited: loops make it depend on finger1. Name finger1 with" in message
