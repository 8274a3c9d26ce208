"""Bases that move: carriers of payloads, with and without loops, and mechanisms free in a plane."""

import mujoco
import numpy as np
import pytest
import sagittal_walker
import walker
import wrist
from looped import CRANK, GRIPPER_EQUALITY, GRIPPER_LINKS, ROCKER, body, closed, text
from mechanisms import sines
from scipy.spatial.transform import Rotation

import ident
import scenes
import sim
from ident.errors import ModelError
from ident.geometry.se3 import coAd, inverse, pose
from ident.mechanism.mechanism import out_of_plane, plane_normal
from ident.model.regressor import base_wrench_regressor

ARM = sim.mechanism(mujoco.MjSpec.from_string(wrist.model()))
TOOL = ARM.beyond("tool")


def test_the_wrench_of_a_tool_is_what_mujocos_sensor_reads():
    _, *states = wrist.motion()
    base = TOOL.carrier.motion(*states)
    none = np.zeros((len(states[0]), 0))
    Y = base_wrench_regressor(TOOL.tree, none, none, none, gravity=TOOL.gravity, base=base)
    in_sensor = Y @ TOOL.known @ coAd(inverse(wrist.sensors()["wrist"].pose)).T
    np.testing.assert_allclose(in_sensor, wrist.read(wrist.model()), atol=1e-13)


def test_poses_are_those_of_the_tree_and_rates_their_derivatives():
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.normal(size=(3, 7))
    motion, h = TOOL.carrier.motion(q, dq, ddq), 1e-5
    np.testing.assert_allclose(motion.T, ARM.tree.poses(q)[ARM.tree.names.index("tool")], atol=1e-13)
    near = [TOOL.carrier.motion(q + s * h * dq + (s * h) ** 2 / 2 * ddq, dq + s * h * ddq, ddq) for s in (-1, 1)]
    np.testing.assert_allclose((near[1].V - near[0].V) / (2 * h), motion.dV, atol=1e-7)
    slope = inverse(motion.T) @ (near[1].T - near[0].T) / (2 * h)
    np.testing.assert_allclose(slope[:3, 3], motion.V[:3], atol=1e-8)
    np.testing.assert_allclose([slope[2, 1], slope[0, 2], slope[1, 0]], motion.V[3:], atol=1e-8)


def test_what_cannot_be_carried_is_refused():
    with pytest.raises(ident.InputError, match="no body 'hand' to be carried; the bodies are link1, "):
        ARM.beyond("hand")
    with pytest.raises(ident.InputError, match="from the whole mechanism"):
        TOOL.beyond("tool")
    still = '<mujoco><worldbody><body name="a"><geom size="1"/></body></worldbody></mujoco>'
    with pytest.raises(ident.InputError, match="No joint moves 'a'"):
        read(still).beyond("a")


HAND = """<body name="hand" pos="0.3 0 0.12">
<inertial mass="0.9" pos="0.02 0.01 -0.05" diaginertia="2e-3 3e-3 2e-3"/></body>"""
_ROD = '<body name="rod" pos="0 0 0.1">'
PALLETIZER = text(
    body("turret", "yaw", "0 0 0.05", 1, CRANK.replace(_ROD, _ROD + HAND) + ROCKER, axis="0.3 0 0.954"),
    '<connect name="pin" body1="rod" body2="rocker" anchor="0.25 0 0.07"/>',
)
HOLDING = text(body("upper", "lift", "0 0 0.2", 1.0, GRIPPER_LINKS), GRIPPER_EQUALITY)
T = np.arange(600) / 100


def swings(a, b):
    """A sum of sines and its derivatives (N,)."""
    return sines(T, np.array([0.6, 0.2]), np.array([a, b]), 0.0)


def read(model, **options):
    return sim.mechanism(mujoco.MjSpec.from_string(model), **options)


def motions():
    """States of the driven joints, and of all joints, by name (3, N)."""
    arm = read(PALLETIZER).closed(("rod", "rocker"), ("yaw", "crank"))
    own = {"yaw": swings(1.1, 3.7), "crank": swings(1.7, 4.9)}
    states = [np.stack([own[joint][k] for joint in arm.tree.joints], axis=1) for k in range(3)]
    others = arm.tree.dependent_states(*states)
    return own, own | {joint: [x[:, k] for x in others] for k, joint in enumerate(arm.tree.dependent)}


@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
def test_a_carrier_with_loops_moves_as_one_whose_joints_are_all_logged():
    own, every = motions()
    carrier = read(PALLETIZER).beyond("hand").carrier
    assert {*carrier.joints} == {"yaw", "crank", "rod", "rocker"}
    moving = carrier.closed(("rod", "rocker"))
    assert moving.joints == ("yaw", "crank") and carrier.closed(()) is carrier
    first = moving.motion(*(np.stack([own[joint][k] for joint in moving.joints], axis=1) for k in range(3)))
    second = carrier.motion(*(np.stack([every[joint][k] for joint in carrier.joints], axis=1) for k in range(3)))
    for computed, expected in zip((first.T, first.V, first.dV), (second.T, second.V, second.dV), strict=True):
        np.testing.assert_allclose(computed, expected, atol=1e-9)


@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
@pytest.mark.slow
def test_a_payload_is_weighed_beyond_a_loop():
    arm, (own, every), rng = read(PALLETIZER), motions(), np.random.default_rng(0)
    part = arm.beyond("hand")
    carried = part.carrier.motion(*(np.stack([every[j][k] for j in part.carrier.joints], axis=1) for k in range(3)))
    none = np.zeros((3, len(T), 0))
    wrench = base_wrench_regressor(part.tree, *none, gravity=part.gravity, base=carried) @ (1.5 * part.known)
    wrench += rng.normal(size=wrench.shape) * [0.05, 0.05, 0.05, 0.003, 0.003, 0.003]
    log = {"time": T} | {f"{joint}_position": x[0] + 1e-4 * rng.normal(size=len(T)) for joint, x in own.items()}
    log |= dict(zip([f"tool_{letter}{x}" for letter in "fm" for x in "xyz"], wrench.T, strict=True))
    of_tool = {"body": "hand", "force": list(log)[-6:-3], "torque": list(log)[-3:]}
    recording = ident.read_log(log, arm, {"wrenches": {"tool": of_tool}})
    found = ident.identify_payload(arm, recording, body="hand", sensor="tool").in_frame()
    true = np.array([1.35, 0.02, 0.01, -0.05, 3e-3, 4.5e-3, 3e-3])
    assert (abs(found.values[:7] - true) < 4 * found.std_setup[:7]).all() and abs(found.values[0] - 1.35) < 0.02


@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
def test_what_loops_hold_rests_with_the_joints_that_are_fixed():
    arm = read(HOLDING).fixed({"left_driver": [0.2]})
    assert arm.tree.joints == ("lift",) and len(arm.tree.still) == 6
    gripper = closed("gripper").tree
    poses = dict(zip(gripper.names, gripper.poses(np.array([0.2])), strict=True))
    upper = np.linalg.inv(arm.tree.poses(np.zeros(1))[arm.tree.names.index("upper")])
    for name, own in zip(arm.tree.names, arm.tree.poses(np.zeros(1)), strict=True):
        if name in gripper.names[1:]:
            np.testing.assert_allclose(upper @ own, poses[name], atol=1e-9)
    with pytest.raises(ModelError, match="cannot be closed in the model's posture"):
        read(HOLDING).fixed({"left_driver": [2.5]})


AT_REST = np.eye(4)


def turned(*rpy_deg):
    return pose(Rotation.from_euler("xyz", rpy_deg, degrees=True).as_matrix(), np.array([0.3, 0.1, -0.2]))


def test_a_sagittal_model_cannot_explain_what_is_sideways():
    person = sagittal_walker.mechanism()
    np.testing.assert_allclose(np.abs(plane_normal(person)), [0, 0, 1], atol=1e-12)
    assert out_of_plane(person, AT_REST) == (2, 3, 4)


def test_components_are_those_in_the_sensors_axes():
    person = sagittal_walker.mechanism()
    assert out_of_plane(person, turned(0, 0, 30)) == (2, 3, 4)
    assert out_of_plane(person, turned(90, 0, 0)) == (1, 3, 5)
    assert out_of_plane(person, turned(0, -90, 0)) == (0, 4, 5)
    assert out_of_plane(person, turned(10, 0, 0)) == ()


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
    assert plane_normal(person) is None and out_of_plane(person, AT_REST) == ()
