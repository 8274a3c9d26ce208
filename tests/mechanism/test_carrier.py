"""Bases that move: carriers of payloads, with and without loops, and mechanisms free in a plane."""

from dataclasses import replace

import numpy as np
import pytest
import sagittal_walker
import walker
import wrist
from looped import CRANK, GRIPPER_EQUALITY, GRIPPER_LINKS, ROCKER, body, closed, read, text
from mechanisms import by_joint, sines, unhat
from scipy.spatial.transform import Rotation

import ident
import scenes
import sim
from ident.errors import ModelError
from ident.geometry.se3 import coAd, inverse, pose
from ident.mechanism.mechanism import out_of_plane, plane_normal
from ident.model.regressor import base_wrench_regressor

ARM = read(wrist.model())
TOOL = ARM.beyond("tool")


def test_the_wrench_of_a_tool_is_what_mujocos_sensor_reads():
    _, *states = wrist.motion()
    none, base = np.zeros((len(states[0]), 0)), TOOL.carrier.motion(*states)
    Y = base_wrench_regressor(TOOL.tree, none, none, none, gravity=TOOL.gravity, base=base)
    in_sensor = Y @ TOOL.known @ coAd(inverse(wrist.sensors()["wrist"].pose)).T
    np.testing.assert_allclose(in_sensor, wrist.read(wrist.model()), atol=1e-13)


def test_poses_are_those_of_the_tree_and_rates_their_derivatives():
    q, dq, ddq = np.random.default_rng(0).normal(size=(3, 7))
    motion, h = TOOL.carrier.motion(q, dq, ddq), 1e-5
    np.testing.assert_allclose(motion.T, ARM.tree.poses(q)[ARM.tree.names.index("tool")], atol=1e-13)
    before, after = (TOOL.carrier.motion(q + h * dq + h**2 / 2 * ddq, dq + h * ddq, ddq) for h in (-h, h))
    np.testing.assert_allclose((after.V - before.V) / (2 * h), motion.dV, atol=1e-7)
    np.testing.assert_allclose(unhat(inverse(motion.T) @ (after.T - before.T) / (2 * h)), motion.V, atol=1e-8)


def test_what_cannot_be_carried_is_refused():
    still = read('<mujoco><worldbody><body name="a"><geom size="1"/></body></worldbody></mujoco>')
    for arm, name, message in (
        (ARM, "hand", "no body 'hand' to be carried; the bodies are link1, "),
        (TOOL, "tool", "from the whole mechanism"),
        (still, "a", "No joint moves 'a'"),
    ):
        with pytest.raises(ident.InputError, match=message):
            arm.beyond(name)


HAND = """<body name="hand" pos="0.3 0 0.12">
<inertial mass="0.9" pos="0.02 0.01 -0.05" diaginertia="2e-3 3e-3 2e-3"/></body>"""
_ROD = '<body name="rod" pos="0 0 0.1">'
PALLETIZER = text(
    body("turret", "yaw", "0 0 0.05", 1, CRANK.replace(_ROD, _ROD + HAND) + ROCKER, axis="0.3 0 0.954"),
    '<connect name="pin" body1="rod" body2="rocker" anchor="0.25 0 0.07"/>',
)
T = np.arange(600) / 100


@pytest.fixture(scope="module")
def palletizer():
    """The arm, states of the driven joints, and of all joints, by name (3, N)."""
    arm, size = read(PALLETIZER), np.array([0.6, 0.2])
    own = {"yaw": sines(T, size, np.array([1.1, 3.7]), 0.0), "crank": sines(T, size, np.array([1.7, 4.9]), 0.0)}
    tree = arm.closed(("rod", "rocker"), ("yaw", "crank")).tree
    others = tree.dependent_states(*states_of(tree.joints, own))
    return arm, own, own | {joint: [x[:, k] for x in others] for k, joint in enumerate(tree.dependent)}


def states_of(joints, own):
    return [np.stack([own[joint][k] for joint in joints], axis=1) for k in range(3)]


@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
def test_a_carrier_with_loops_moves_as_one_whose_joints_are_all_logged(palletizer):
    arm, own, every = palletizer
    carrier = arm.beyond("hand").carrier
    assert {*carrier.joints} == {"yaw", "crank", "rod", "rocker"}
    moving = replace(carrier, tree=carrier.constraints.closing(carrier.tree, ("rod", "rocker")))
    assert moving.joints == ("yaw", "crank") and carrier.constraints.closing(carrier.tree, ()) is carrier.tree
    first = moving.motion(*states_of(moving.joints, own))
    second = carrier.motion(*states_of(carrier.joints, every))
    for computed, expected in zip((first.T, first.V, first.dV), (second.T, second.V, second.dV), strict=True):
        np.testing.assert_allclose(computed, expected, atol=1e-9)


@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
@pytest.mark.slow
def test_a_payload_is_weighed_beyond_a_loop(palletizer):
    (arm, own, every), rng = palletizer, np.random.default_rng(0)
    part = arm.beyond("hand")
    carried, none = part.carrier.motion(*states_of(part.carrier.joints, every)), np.zeros((3, len(T), 0))
    wrench = base_wrench_regressor(part.tree, *none, gravity=part.gravity, base=carried) @ (1.5 * part.known)
    wrench += rng.normal(size=wrench.shape) * [0.05, 0.05, 0.05, 0.003, 0.003, 0.003]
    q, names = states_of(own, own)[0], [f"tool_{letter}{x}" for letter in "fm" for x in "xyz"]
    log = {"time": T} | by_joint(own, position=q + 1e-4 * rng.normal(size=q.shape))
    log |= dict(zip(names, wrench.T, strict=True))
    of_tool = {"body": "hand", "force": names[:3], "torque": names[3:]}
    recording = ident.read_log(log, arm, {"wrenches": {"tool": of_tool}})
    weighed = ident.identify_payload(arm, recording, body="hand", sensor="tool").in_frame()
    true = np.array([1.35, 0.02, 0.01, -0.05, 3e-3, 4.5e-3, 3e-3])
    assert (abs(weighed.values[:7] - true) < 4 * weighed.std_setup[:7]).all() and abs(weighed.values[0] - 1.35) < 0.02


@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
def test_what_loops_hold_rests_with_the_joints_that_are_fixed():
    holding = read(text(body("upper", "lift", "0 0 0.2", 1.0, GRIPPER_LINKS), GRIPPER_EQUALITY))
    arm, gripper = holding.fixed({"left_driver": [0.2]}).tree, closed("gripper").tree
    assert arm.joints == ("lift",) and len(arm.still) == 6
    held, own = arm.poses(np.zeros(1)), gripper.poses(np.array([0.2]))
    for name, expected in zip(gripper.names[1:], own[1:], strict=True):
        place = inverse(held[arm.names.index("upper")]) @ held[arm.names.index(name)]
        np.testing.assert_allclose(place, expected, atol=1e-9)
    with pytest.raises(ModelError, match="cannot be closed in the model's posture"):
        holding.fixed({"left_driver": [2.5]})


@pytest.mark.parametrize(
    ("rpy_deg", "components"),
    [
        ((0, 0, 0), (2, 3, 4)),
        ((0, 0, 30), (2, 3, 4)),
        ((90, 0, 0), (1, 3, 5)),
        ((0, -90, 0), (0, 4, 5)),
        ((10, 0, 0), ()),
    ],
)
def test_a_sagittal_model_cannot_explain_what_is_sideways_in_the_sensors_axes(rpy_deg, components):
    person = sagittal_walker.mechanism()
    np.testing.assert_allclose(np.abs(plane_normal(person)), [0, 0, 1], atol=1e-12)
    turn = Rotation.from_euler("xyz", rpy_deg, degrees=True).as_matrix()
    assert out_of_plane(person, pose(turn, np.array([0.3, 0.1, -0.2]))) == components


@pytest.mark.parametrize(
    "person",
    [
        read(sagittal_walker.text(gravity="0 0 -9.81")),
        read(sagittal_walker.text(gravity="0 -9.7 -1")),
        read(sagittal_walker.text(knee="0.1 0 1")),
        read(sagittal_walker.text(), fix={"tx": [0.0]}),
        read(sagittal_walker.text(), fix={"tilt": [0.2]}),
        read(sagittal_walker.text(), base="pelvis"),
        sagittal_walker.mechanism().beyond("foot_r"),
        walker.mechanism(),
        sim.mechanism(scenes.load("double_pendulum"), base="base"),
    ],
    ids=("seen_from_above", "slope", "oblique_knee", "held_in_x", "upright", "posed", "a_foot", "in_space", "arm"),
)
def test_of_all_others_every_component_counts(person):
    assert plane_normal(person) is None and out_of_plane(person, np.eye(4)) == ()
