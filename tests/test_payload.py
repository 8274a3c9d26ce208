"""A robot's payload beyond a wrist sensor, from readings of MuJoCo's sensors on a simulated arm."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
import wrist
from coded import coded
from scipy.spatial.transform import Rotation

import ident
import sim
from ident import Sensor, identify_payload
from ident.geometry.inertia import parameters_from_com, symmetric
from ident.payload import described

pytestmark = pytest.mark.slow

TRUTH = np.array([wrist.TOOL["mass"], *wrist.TOOL["com"], *wrist.TOOL["inertia"]])
GIVEN = {"body": "tool", "sensor": "wrist"}


@cache
def arm(**options):
    return sim.mechanism(mujoco.MjSpec.from_string(wrist.model(**options)))


@cache
def log(**faults):
    return wrist.log(seconds=8.0, **faults)


@cache
def usual():
    return identify_payload(arm(), log(), **GIVEN)


def test_mass_and_centre_of_a_light_tool_are_found_and_covered():
    heavier = sim.mechanism(mujoco.MjSpec.from_string(wrist.model(tool={**wrist.TOOL, "mass": 0.25})))
    payload = identify_payload(heavier, log(seed=1), **GIVEN)
    bodies = usual().in_frame(), payload.in_frame()
    for body in bodies:
        assert abs(body.values[0] - TRUTH[0]) < 0.002 and np.linalg.norm(body.values[1:4] - TRUTH[1:4]) < 0.003
        assert body.identifiable[:4].all() and (body.std_setup >= body.std).all()
    assert np.mean([np.abs(body.values - TRUTH) < 1.96 * body.std for body in bodies]) > 0.85
    assert payload.verdict().usable and np.isclose(payload.model[0], 0.25)


def test_a_late_sensor_is_found_and_named():
    payload = identify_payload(arm(), log(delay=4), **GIVEN)
    delay = next(each for each in payload.sensor_parameters if each.name == "delay(wrist)")
    assert [*delay.to_dict().values()] == [*delay[:4]]
    assert delay.taken_out and abs(delay.value - 0.04) < 4 * delay.std
    (finding,) = coded(payload, "setup_delay")
    assert finding.values["of"] == "wrist" and finding.values["value"] == delay.value
    assert finding.place.wrenches == ("wrist",) and finding.text.startswith("The wrench 'wrist' is ")


HEAVY = {"mass": 3.0, "com": (0.01, 0.02, 0.1), "inertia": (0.03, 0.025, 0.01, 1e-3, 1e-3, -1e-3)}


def test_a_load_beyond_the_last_link_is_no_mirrored_wrench_of_that_link():
    """The model has the link alone, whose centre is on the other side of the sensor."""
    recording, place = log(text=wrist.model(tool=HEAVY), delay=4), wrist.sensors()["wrist"].pose.copy()
    place[2, 3] += 0.107
    link = replace(recording, sensors={"wrist": Sensor("link7", place, True)})
    payload = identify_payload(arm(stated=False), link, body="link7", sensor="wrist")
    (finding,) = coded(payload, "setup_delay")
    assert abs(finding.values["value"] - 0.04) < 4 * finding.values["std"]
    assert not payload.estimate.prepared.left_out
    values, _, std, *_ = payload.in_frame(payload.place_of("tool"))
    assert (np.abs(values - [3.0, *HEAVY["com"], *HEAVY["inertia"]])[:4] < 4 * std[:4]).all()


def test_without_a_model_of_the_tool_its_inertia_is_likely_or_else_told():
    """Slow turns do not determine inertias; fast turns of a heavy tool do."""
    payload = identify_payload(arm(stated=False), log(), **GIVEN)
    body = payload.in_frame()
    assert not body.identifiable[4:].all() and payload.model is None
    assert payload.verdict().inertia_within is None and coded(payload, "payload_inertia_unknown")
    assert (np.abs(body.values - TRUTH) < 4 * body.std_setup).all()
    fast = log(text=wrist.model(tool=HEAVY), size=1.5)
    body = identify_payload(arm(stated=False), fast, **GIVEN).in_frame()
    assert body.identifiable.all()
    assert (np.abs(body.values - [3.0, *HEAVY["com"], *HEAVY["inertia"]]) < 4 * body.std_setup).all()


def test_bodies_welded_to_the_tool_count_and_the_robot_gets_them():
    inertial = '<inertial mass="0.05" pos="0 0 0.01" diaginertia="2e-5 2e-5 1e-5"/>'
    cap = f'<body name="cap" pos="0 0.02 0.08">{inertial}</body>'
    robot = arm(beyond=cap)
    payload = identify_payload(robot, log(text=wrist.model(beyond=cap)), **GIVEN)
    total = parameters_from_com(TRUTH[0], TRUTH[1:4], symmetric(TRUTH[4:]))
    total = total + parameters_from_com(0.05, [0, 0.02, 0.09], np.diag([2e-5, 2e-5, 1e-5]))
    body, phi = payload.in_frame(), payload.phi_of_robot()
    np.testing.assert_array_less(np.abs(body.values - described(total)), 4 * body.std)
    np.testing.assert_allclose(phi[:70], robot.known[:70])
    np.testing.assert_allclose(phi[[70, 80]].sum(), body.values[0])


def test_a_sensor_may_be_on_what_carries_the_tool_and_the_flange_is_any_frame_beside_it():
    place = wrist.sensors()["wrist"].pose.copy()
    place[2, 3] += 0.107
    upstream, on_link = ({"wrist": Sensor("link7", place, sign)} for sign in (False, True))
    first = identify_payload(arm(), replace(log(sign=-1), sensors=on_link), **GIVEN)
    body, other = first.in_frame(), usual().in_frame()
    assert (np.abs(body.values - other.values) < 2 * (body.std + other.std)).all()
    with pytest.raises(ident.InputError, match="they have the opposite sign"):
        identify_payload(arm(), replace(log(sign=-1), sensors=upstream), **GIVEN)
    at_flange = first.in_frame(first.place_of("link7"))
    np.testing.assert_allclose(at_flange.values - first.in_frame().values, [0, 0, 0, 0.107, *6 * [0]], atol=1e-9)
    np.testing.assert_allclose(first.place_of("wrist"), wrist.sensors()["wrist"].pose, atol=1e-12)
    with pytest.raises(ident.InputError, match="'link5' is on 'link5', which does not move with 'tool'"):
        first.place_of("link5")


def test_a_weight_that_the_controller_has_taken_out_is_no_payload():
    """The rest of it weighs something, but neither weight nor motion explain the forces."""
    whole, bare, rng = log(), log(text=wrist.model(tool={**wrist.TOOL, "mass": 0.08})), np.random.default_rng(0)
    wander, noise = rng.normal(size=(2, len(whole.time), 3))
    wander = np.cumsum(wander, axis=0)
    force = whole["wrist_force"] - bare["wrist_force"] + 0.3 * wander / wander.std(axis=0) + 0.01 * noise
    payload = identify_payload(arm(), replace(whole, measured={**whole.measured, "wrist_force": force}), **GIVEN)
    (finding,) = coded(payload, "payload_forces_unexplained")
    assert finding.doubt and set(finding.values["ratios"]) <= {"Fx", "Fy", "Fz"}
    assert payload.verdict().outcome.value == "not" and "payload to 0 kg" in finding.text


def test_a_sensor_in_other_axes_than_stated_is_refused_with_those_it_seems_to_have():
    sensor = log().sensors["wrist"]
    wrong = sensor.pose.copy()
    wrong[:3, :3] = sensor.pose[:3, :3] @ Rotation.from_euler("xyz", (30, -50, 140), degrees=True).as_matrix()
    with pytest.raises(ident.InputError, match="far better in axes turned by") as refused:
        identify_payload(arm(), replace(log(), sensors={"wrist": Sensor("tool", wrong)}), **GIVEN)
    quaternion = [float(x) for x in str(refused.value).split("[")[1].split("]")[0].split(",")]
    looks_like = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    np.testing.assert_allclose(looks_like, sensor.pose[:3, :3], atol=0.1)


def test_what_cannot_be_a_payload_is_refused():
    finger = '<body name="finger"><joint name="grip"/><geom size="0.01"/></body>'
    usual, swaying = log(), np.tile(np.eye(4), (len(log().time), 1, 1))
    swaying[:, 2, 3] = 0.01 * np.sin(usual.time)
    noise = 0.1 * np.random.default_rng(0).normal(size=(len(usual.time), 3))
    upright = replace(usual, measured={**usual.measured, "wrist_force": noise - np.array([0, 0.3, 3.0])})
    on_link, on_hand = (replace(usual, sensors={"wrist": Sensor(name)}) for name in ("link3", "hand"))
    for robot, recording, given, error, message in (
        (arm(), usual, {"body": "hand"}, ident.InputError, "no body 'hand'"),
        (arm(), usual, {"sensor": "foot"}, ident.LogError, "needs the wrench 'foot', its wrenches are 'wrist'"),
        (arm(beyond=finger), usual, {}, ident.InputError, r"hold them where they stand \(--fix grip\)"),
        (arm(), log(size=1e-3), {}, ident.ExcitationError, "keeps its direction to gravity"),
        (arm(), replace(usual, base=swaying), {}, ident.InputError, "moving base"),
        (arm(), upright, {}, ident.InputError, "keep their direction, 3.* N along gravity"),
        (arm(), on_link, {}, ident.InputError, "'wrist' is on 'link3'"),
        (arm(), on_hand, {}, ident.InputError, "no body 'hand' for the wrench"),
    ):
        with pytest.raises(error, match=message):
            identify_payload(robot, recording, **{**GIVEN, **given})
