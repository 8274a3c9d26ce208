"""Joints that share a column, or that the model couples and the log lacks, follow another one exactly."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from random_models import inverse_dynamics
from written_formats import write_csv

import ident
import sim
from experiments.studies.user_files import prepare
from ident import Body, LogError, Mechanism, Recording, Tree, read_log
from ident.estimation.preparation import prepared
from ident.recordings.followers import with_servos
from ident.recordings.stated import Servo
from sim import mechanism

pytestmark = pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")

T = np.arange(80) / 50
ANGLE, GRIP = 0.7 * np.sin(3 * T), 0.3 * np.sin(5 * T) + 0.1


def xml(equalities="", ref=0.0):
    """An arm with a finger that turns, one that slides, and one that turns on the first."""
    inertial = '<inertial mass="{}" pos="0.03 {} 0" diaginertia="2e-4 3e-4 3e-4"/>'
    return f"""<mujoco><compiler angle="radian"/><worldbody><body name="arm"><joint name="lift" axis="0 1 0"/>
    {inertial.format(2, 0.1)}<body name="left" pos="0.3 0.02 0"><joint name="left" axis="0 0 1" ref="{ref}"/>
    {inertial.format(0.2, 0.01)}<body name="tip" pos="0.05 0 0"><joint name="tip" axis="0 0 1"/>
    {inertial.format(0.1, 0)}</body></body><body name="right" pos="0.3 -0.02 0">
    <joint name="right" type="slide" axis="0.6 0.8 0"/>{inertial.format(0.3, 0)}</body></body></worldbody>
    <equality>{equalities}</equality></mujoco>"""


def coupled(joint, lead, polycoef, name):
    return f'<joint name="{name}" joint1="{joint}" joint2="{lead}" polycoef="{polycoef}"/>'


def arm(*given, **options):
    return sim.mechanism(mujoco.MjSpec.from_string(xml(*given, **options)))


LOG = {"time": T, "lift_position": ANGLE, "gripper": np.degrees(GRIP), "force": np.cos(T), "own": np.sin(T)}
ONE = {
    "left": {"position": {"column": "gripper", "unit": "deg"}},
    "tip": {"position": {"column": "gripper", "gain": -2.0, "constant": 3.0, "unit": "deg"}},
    "right": {"position": {"column": "gripper", "gain": -0.5, "constant": 10.0, "unit": "mm"}},
}


def read_shared(more=None):
    """The log whose column moves three joints, with further entries by joint."""
    return read_log(
        LOG, arm(), {"joints": {joint: {**entry, **(more or {}).get(joint, {})} for joint, entry in ONE.items()}}
    )


def leaders(log):
    return {name: each.joint for name, each in log.followers.items()}


def test_one_column_for_several_joints():
    log = read_shared({"left": {"torque": "force"}})
    assert leaders(log) == {"tip": "left", "right": "left"}
    np.testing.assert_allclose(log.followers["tip"].coefficients, [np.radians(3), -2])
    np.testing.assert_allclose(log.followers["right"].coefficients, [0.01, -0.5e-3 * np.degrees(1)])
    assert log.measured.keys() == {"lift_position", "left_position", "left_torque"}
    assert any(note.startswith("'tip' follows 'left': tip = -2*left + 0.05") for note in log.notes)
    tree = prepared(arm(), log, filters=False).mechanism.tree
    assert tree.joints == ("lift", "left") and tree.freedoms == ("lift", "left")


def test_the_driven_joint_leads_and_torques_of_several_motors_move_it_together():
    for own in ({"torque": "force"}, {"command": "force", "kp": 3.0}):
        log = read_shared({"tip": own})
        assert leaders(log) == {"left": "tip", "right": "tip"} and f"tip_{next(iter(own))}" in log.measured
        np.testing.assert_allclose(log.followers["left"].coefficients, [np.radians(1.5), -0.5])
    log = read_shared({"left": {"torque": "force"}, "tip": {"torque": "own"}})
    np.testing.assert_allclose(log["left_torque"], LOG["force"] - 2 * LOG["own"])


def generalized(model_text, followers, q, dq, ddq):
    """Torques of independent joints by MuJoCo's inverse dynamics without constraints, by virtual work (N, n)."""
    model = mujoco.MjModel.from_xml_string(model_text)
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_EQUALITY
    names = [model.joint(j).name for j in range(model.njnt)]
    forces, _ = inverse_dynamics(model, q.T, dq.T, ddq.T)
    tau, own = dict(zip(names, forces.T, strict=True)), dict(zip(names, q, strict=True))
    for name, lead in followers.items():
        tau[lead.joint] = tau[lead.joint] + lead.slope(own[lead.joint]) * tau.pop(name)
    return np.stack(list(tau.values()), axis=1)


POLYNOMIAL = (
    coupled("tip", "left", "0.1 -2 0.7 0 0", "bend")
    + coupled("right", "tip", "0.01 0.05 0 0 0", "chain")
    + coupled("lift", "right", "0 1 0 0 0", "off").replace("/>", ' active="false"/>')
)


@pytest.mark.parametrize("ref", [0.0, 0.4])
def test_a_joint_that_the_model_couples_needs_no_column(ref):
    """Curved couplings, of which one follows a follower, against MuJoCo."""
    log = read_log({**LOG, "left_position": GRIP, "left_torque": np.cos(T)}, arm(POLYNOMIAL, ref=ref))
    assert leaders(log) == {"tip": "left", "right": "left"}
    tip = 0.1 - 2 * (GRIP - ref) + 0.7 * (GRIP - ref) ** 2
    np.testing.assert_allclose(log.followers["tip"].value(GRIP), tip, atol=1e-12)
    np.testing.assert_allclose(log.followers["right"].value(GRIP), 0.01 + 0.05 * tip, atol=1e-12)
    mech = prepared(arm(POLYNOMIAL, ref=ref), log, filters=False).mechanism
    lift, left = (ANGLE, 2.1 * np.cos(3 * T), 0.2 * T), (GRIP, 1.5 * np.cos(5 * T), 0.1 - T)
    every = {"lift": lift, "left": left}
    for name, lead in log.followers.items():
        every[name] = lead.states(*every[lead.joint])
    states = (np.stack([every[name][k] for name in ("lift", "left", "tip", "right")]) for k in range(3))
    Y = ident.joint_torque_regressor(mech.tree, *np.stack([lift, left], axis=2), gravity=mech.gravity)
    expected = generalized(xml(ref=ref), log.followers, *states)
    np.testing.assert_allclose(Y[..., : len(mech.known)] @ mech.known, expected, atol=1e-10)


def test_a_torque_of_a_joint_that_follows_by_a_curve_is_refused():
    columns = {"time": T, "lift_position": ANGLE, "left_position": GRIP, "right_position": GRIP, "tip_torque": ANGLE}
    curve = arm(coupled("tip", "left", "0.1 -2 0.7 0 0", "bend"))
    message = "Loops make 'tip' depend on left: its torque or command cannot be used"
    with pytest.raises(LogError, match=message):
        prepared(curve, read_log(columns, curve), filters=False)
    followed = read_log({name: x for name, x in columns.items() if name != "tip_torque"}, curve)
    with pytest.raises(LogError, match=message):
        prepared(curve, replace(followed, measured={**followed.measured, "tip_torque": ANGLE}), filters=False)


def test_commands_read_such_logs_also_with_columns_of_both_joints(tmp_path):
    (tmp_path / "arm.xml").write_text(xml(coupled("tip", "left", "0 -1 0 0 0", "pair")))
    columns = {"time": T, "lift_position": ANGLE, "left_position": GRIP, "right_position": GRIP, "left_torque": GRIP}
    ready = prepare(tmp_path / "arm.xml", write_csv(tmp_path / "log.csv", columns), filters=False)
    assert ready.recording.followers.keys() == {"tip"} and ready.equations.channels == ("left",)
    both = write_csv(tmp_path / "own.csv", {**columns, "tip_position": -GRIP})
    own = prepare(tmp_path / "arm.xml", both, filters=False)
    assert own.mechanism.tree.dependent == ("tip",) and own.equations.channels == ("left",)
    assert own.equations.parameters.names == ready.equations.parameters.names
    fixed = mechanism(tmp_path / "arm.xml", fix={"left": 0.1})
    assert not fixed.mimics and fixed.tree.joints == ("lift", "right")


@pytest.mark.parametrize(
    ("more", "message"),
    [
        ({"left": {"torque": "force"}, "tip": {"torque": "force"}}, "'force' is mapped to .* it can be one only"),
        ({"left": {"torque": "gripper"}}, "'gripper' is mapped to .* it can be one only"),
        ({"left": {"torque": "force"}, "tip": {"torque": "own", "torque_std": 0.1}}, "joint 'tip' follows 'left':"),
        ({"left": {"torque": "force"}, "tip": {"command": "own", "kp": 2.0}}, "joint 'tip' follows 'left': state comm"),
    ],
)
def test_what_cannot_be_shared_is_refused(more, message):
    with pytest.raises(LogError, match=message):
        read_shared(more)


def test_commands_that_come_more_rarely_than_positions_are_noted():
    t, notes = np.arange(100) / 100, []
    leg = Mechanism(Tree((Body("leg", -1, np.eye(4), np.eye(6)[4], "hip"),)), np.array([0, 0, -9.81]))
    for rare, number in ((t[::5], 1), (t, 0)):
        recording = Recording.from_streams({"hip_position": (t, np.sin(t)), "hip_command": (rare, np.sin(rare))})
        notes.clear()
        with_servos(recording, {"hip": Servo(50.0)}, leg, notes)
        assert len(notes) == number and all("'hip' come every 0.05 s, more rarely than" in note for note in notes)
