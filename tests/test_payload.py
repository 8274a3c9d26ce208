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
from ident.geometry.inertia import parameter_transform, parameters_from_com, symmetric
from ident.payload.beyond_sensor import identify_payload
from ident.payload.identified_payload import described
from ident.recordings.wrench import Sensor

pytestmark = pytest.mark.slow

TRUTH = np.array([wrist.TOOL["mass"], *wrist.TOOL["com"], *wrist.TOOL["inertia"]])
GIVEN = {"body": "tool", "sensor": "wrist"}


@cache
def arm(**options):
    return sim.mechanism(mujoco.MjSpec.from_string(wrist.model(**options)))


@cache
def heavy_hand():
    """A heavier model of the tool than the true one."""
    return sim.mechanism(mujoco.MjSpec.from_string(wrist.model(tool={**wrist.TOOL, "mass": 0.25})))


@cache
def light(seed):
    """Estimate of the light tool."""
    return identify_payload(heavy_hand(), wrist.log(seed, seconds=8.0), **GIVEN)


def test_mass_and_centre_of_a_light_tool_are_found_and_covered():
    distances = []
    for seed in range(2):
        payload = light(seed)
        body = payload.in_frame()
        assert abs(body.values[0] - TRUTH[0]) < 0.002
        assert np.linalg.norm(body.values[1:4] - TRUTH[1:4]) < 0.003
        assert body.identifiable[:4].all() and payload.verdict().usable
        assert (body.std_setup >= body.std).all()
        distances.append((body.values - TRUTH) / body.std)
    assert (np.abs(distances) < 1.96).mean() > 0.85
    assert np.isclose(payload.model[0], 0.25)


def test_a_late_sensor_is_found_and_named():
    payload = identify_payload(arm(), wrist.log(seconds=8.0, delay=4), **GIVEN)
    delay = next(each for each in payload.sensor_parameters if each.name == "delay(wrist)")
    assert [*delay.to_dict().values()] == [*delay[:4]]
    assert delay.taken_out and abs(delay.value - 0.04) < 4 * delay.std
    (finding,) = coded(payload, "setup_delay")
    assert finding.values["of"] == "wrist" and finding.values["value"] == delay.value
    assert finding.place.wrenches == ("wrist",) and finding.text.startswith("The wrench 'wrist' is ")


def test_without_a_model_of_the_tool_its_inertia_is_likely_or_else_told():
    """Slow turns do not determine inertias; fast turns of a heavy tool do."""
    payload = identify_payload(arm(stated=False), wrist.log(seconds=8.0), **GIVEN)
    body = payload.in_frame()
    assert not body.identifiable[4:].all() and payload.model is None
    assert payload.verdict().inertia_within is None and coded(payload, "payload_inertia_unknown")
    assert (np.abs(body.values - TRUTH) < 4 * body.std_setup).all()
    heavy = {"mass": 3.0, "com": (0.01, 0.02, 0.1), "inertia": (0.03, 0.025, 0.01, 1e-3, 1e-3, -1e-3)}
    log = wrist.log(text=wrist.model(tool=heavy), seconds=8.0, size=1.5)
    body = identify_payload(arm(stated=False), log, **GIVEN).in_frame()
    assert body.identifiable.all()
    assert (np.abs(body.values - [3.0, *heavy["com"], *heavy["inertia"]]) < 4 * body.std_setup).all()


def test_bodies_welded_to_the_tool_count_and_the_robot_gets_them():
    inertial = '<inertial mass="0.05" pos="0 0 0.01" diaginertia="2e-5 2e-5 1e-5"/>'
    cap = f'<body name="cap" pos="0 0.02 0.08">{inertial}</body>'
    robot = arm(beyond=cap)
    payload = identify_payload(robot, wrist.log(text=wrist.model(beyond=cap), seconds=8.0), **GIVEN)
    T = np.eye(4)
    T[:3, 3] = 0, 0.02, 0.08
    total = parameters_from_com(TRUTH[0], TRUTH[1:4], symmetric(TRUTH[4:]))
    total = total + parameter_transform(T) @ parameters_from_com(0.05, [0, 0, 0.01], np.diag([2e-5, 2e-5, 1e-5]))
    np.testing.assert_array_less(np.abs(payload.in_frame().values - described(total)), 4 * payload.in_frame().std)
    np.testing.assert_allclose(payload.phi_of_robot()[:70], robot.known[:70])
    np.testing.assert_allclose(payload.phi_of_robot()[[70, 80]].sum(), payload.in_frame().values[0])


def test_a_sensor_may_be_on_what_carries_the_tool_and_the_flange_is_any_frame_beside_it():
    log = wrist.log(seconds=8.0, sign=-1)
    place = wrist.sensors()["wrist"].pose.copy()
    place[2, 3] += 0.107
    upstream = replace(log, sensors={"wrist": Sensor("link7", place, False)})
    on_tool = replace(log, sensors=wrist.sensors(applied_to_link=False))
    on_link = replace(log, sensors={"wrist": Sensor("link7", place, True)})
    first, second = (identify_payload(arm(), each, **GIVEN) for each in (on_link, on_tool))
    np.testing.assert_allclose(first.in_frame().values, second.in_frame().values, rtol=1e-6)
    with pytest.raises(ident.InputError, match="they have the opposite sign"):
        identify_payload(arm(), upstream, **GIVEN)
    at_flange = first.in_frame(first.place_of("link7"))
    np.testing.assert_allclose(at_flange.values - first.in_frame().values, [0, 0, 0, 0.107, *6 * [0]], atol=1e-9)
    np.testing.assert_allclose(first.place_of("wrist"), wrist.sensors()["wrist"].pose, atol=1e-12)
    with pytest.raises(ident.InputError, match="'link5' is on 'link5', which does not move with 'tool'"):
        first.place_of("link5")


@pytest.mark.parametrize(("scale", "doubt"), [(1e3, False), (1e6 / 3.8, True)], ids=["mN", "counts"])
def test_a_payload_above_the_robot_s_mass_is_in_another_unit(scale, doubt):
    log = wrist.log(seconds=4.0)
    log = replace(log, measured={k: x * (scale if "wrist" in k else 1) for k, x in log.measured.items()})
    payload = identify_payload(arm(), log, **GIVEN)
    (finding,) = coded(payload, "payload_mass_unlikely")
    assert finding.doubt == doubt and finding.values["robot"] == pytest.approx(arm().mass)
    assert (payload.verdict().outcome.value == "not") == doubt and "In mN it would be" in finding.text
    # Without a model of the robot's masses, what the strongest robots carry is the limit.
    without = replace(payload, robot=replace(payload.robot, prior=None))
    assert [each.doubt for each in coded(without, "payload_mass_unlikely")] == ([True] if scale > 1e3 else [])


def test_a_weight_that_the_controller_has_taken_out_is_no_payload():
    """The rest of it weighs something, but neither weight nor motion explain the forces."""
    log, bare = wrist.log(seconds=8.0), wrist.log(seconds=8.0, text=wrist.model(tool={**wrist.TOOL, "mass": 0.08}))
    rng, wander = np.random.default_rng(0), np.cumsum(np.random.default_rng(1).normal(size=(len(log.time), 3)), axis=0)
    force = log["wrist_force"] - bare["wrist_force"] + 0.3 * wander / wander.std(axis=0)
    log = replace(log, measured={**log.measured, "wrist_force": force + 0.01 * rng.normal(size=force.shape)})
    payload = identify_payload(arm(), log, **GIVEN)
    (finding,) = coded(payload, "payload_forces_unexplained")
    assert finding.doubt and set(finding.values["ratios"]) <= {"Fx", "Fy", "Fz"}
    assert payload.verdict().outcome.value == "not" and "payload to 0 kg" in finding.text


@pytest.mark.parametrize("euler", [(30, -50, 140), (180, 0, 0)])
def test_a_sensor_in_other_axes_than_stated_is_refused_with_those_it_seems_to_have(euler):
    log = wrist.log(seconds=8.0)
    sensor = log.sensors["wrist"]
    wrong = sensor.pose.copy()
    wrong[:3, :3] = sensor.pose[:3, :3] @ Rotation.from_euler("xyz", euler, degrees=True).as_matrix()
    with pytest.raises(ident.InputError, match="far better in axes turned by") as refused:
        identify_payload(arm(), replace(log, sensors={"wrist": Sensor("tool", wrong)}), **GIVEN)
    quaternion = [float(x) for x in str(refused.value).split("[")[1].split("]")[0].split(",")]
    looks_like = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    np.testing.assert_allclose(looks_like, sensor.pose[:3, :3], atol=0.1)


def swaying(log):
    T = np.tile(np.eye(4), (len(log.time), 1, 1))
    T[:, 2, 3] = 0.01 * np.sin(log.time)
    return T


def test_what_cannot_be_a_payload_is_refused():
    log = wrist.log(seconds=8.0)
    finger = '<body name="finger"><joint name="grip"/><geom size="0.01"/></body>'
    still = wrist.log(seconds=8.0, size=1e-3)
    for robot, recording, given, error, message in (
        (arm(), log, {"body": "hand"}, ident.InputError, "no body 'hand'"),
        (arm(), log, {"sensor": "foot"}, ident.LogError, "needs the wrench 'foot', its wrenches are 'wrist'"),
        (arm(beyond=finger), log, {}, ident.InputError, r"hold them where they stand \(--fix grip\)"),
        (arm(), still, {}, ident.ExcitationError, "keeps its direction to gravity"),
        (arm(), [], {}, ident.InputError, "at least one recording"),
        (arm(), replace(log, base=swaying(log)), {}, ident.InputError, "moving base"),
        (arm(), replace(log, sensors={"wrist": Sensor("link3")}), {}, ident.InputError, "'wrist' is on 'link3'"),
        (arm(), replace(log, sensors={"wrist": Sensor("hand")}), {}, ident.InputError, "no body 'hand' for the wrench"),
    ):
        with pytest.raises(error, match=message):
            identify_payload(robot, recording, **{**GIVEN, **given})
