"""Poses of a tracked flange: channels as MuJoCo has them, and an arm's geometry, zeros and inertias in one estimate."""

import re
from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from coded import coded
from commands import sentence_of
from mechanisms import by_joint, sines
from scipy.spatial.transform import Rotation

import ident
import sim
from ident import Equations, Motion
from ident.estimation.measurement import Measurement
from ident.estimation.recorded_motion import aligned, check_tracked, measured_poses
from ident.geometry.se3 import inverse, pose
from ident.recordings.stated import Tracker
from ident.recordings.times import Sampled

JOINTS = ("turn", "lift", "bend", "roll", "tilt")
PLACES = np.array([[0, 0, 0.1], [0, 0.05, 0.3], [0.4, 0, 0.02], [0.1, 0.03, 0], [0.3, 0, 0]])
AXES = ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0")
INERTIALS = (
    'mass="4" pos="0 .02 .1" diaginertia=".03 .03 .02"',
    'mass="3" pos=".2 0 .01" diaginertia=".01 .05 .05"',
    'mass="1.5" pos=".05 .01 0" diaginertia=".003 .006 .006"',
    'mass="1" pos=".15 .02 .01" diaginertia=".002 .01 .01"',
    'mass=".8" pos=".06 .01 .03" diaginertia=".002 .003 .002"',
)
MARKERS = ((0.12, 0.01, 0.02), (0.3, -0.5, 1.1))  # Place of the markers on the last body, m, and Euler angles, rad.
WORLD = Rotation.from_rotvec([0.5, -1.0, 2.0]), np.array([1.0, 2.0, -0.5])
"""Turn and place of the base in the tracker's frame."""

NOISE = 1e-4, np.radians(0.01)  # Noise of positions, m, and of orientations, rad.


def text(places=PLACES):
    bodies = "".join(
        f'<body name="b{k}" pos="{" ".join(map(str, place))}"><joint name="{joint}" axis="{axis}"/><inertial {own}/>'
        for k, (place, joint, axis, own) in enumerate(zip(places, JOINTS, AXES, INERTIALS, strict=True))
    )
    place, turn = (" ".join(map(str, x)) for x in MARKERS)
    of_site = 'objtype="site" objname="flange"'
    return f"""<mujoco><compiler angle="radian"/><worldbody>{bodies}<site name="flange" pos="{place}" euler="{turn}"/>
      {"</body>" * 5}</worldbody><sensor><framepos {of_site}/><framequat {of_site}/></sensor></mujoco>"""


@cache
def mechanism():
    return sim.mechanism(mujoco.MjSpec.from_string(text()))


def motion(rng, time):
    pulsation, phase = 2 * np.pi * 0.15 * np.arange(1, 7), rng.uniform(0, 6.3, (5, 6))
    return sines(time, rng.uniform(0.08, 0.28, (5, 6)), pulsation, phase + np.pi / 2)


def in_mujoco(states, places=PLACES):
    """Torques, positions and orientations of the flange in the tracker's frame, its Jacobians in the base's."""
    model = mujoco.MjModel.from_xml_string(text(places))
    data, out = mujoco.MjData(model), []
    for data.qpos[:], data.qvel[:], data.qacc[:] in zip(*states, strict=True):
        mujoco.mj_inverse(model, data)
        jacobian = np.zeros((2, 3, 5))
        mujoco.mj_jacSite(model, data, *jacobian, 0)
        out.append((data.qfrc_inverse.copy(), data.sensordata.copy(), jacobian))
    torques, poses, jacobians = map(np.array, zip(*out, strict=True))
    turn, place = WORLD
    orientations = turn * Rotation.from_quat(poses[:, 3:], scalar_first=True)
    return torques, turn.apply(poses[:, :3]) + place, orientations, jacobians


def poses_of(name, positions, orientations):
    return {f"{name}_position": positions, f"{name}_orientation": orientations.as_quat(scalar_first=True)}


@cache
def recorded(seed=0, seconds=4.0, displaced=0.0, zeros=0.0):
    """Recording at 100 Hz, displacements of joints, m (5, 3), and errors of zeros, rad (5,), of some sizes."""
    rng, time = np.random.default_rng(seed), np.arange(round(100 * seconds)) / 100
    shifts, off, states = displaced * rng.normal(size=(5, 3)), zeros * rng.normal(size=5), motion(rng, time)
    shifts[0] = 0
    torques, positions, orientations, _ = in_mujoco(states, PLACES + shifts)
    positions = positions + NOISE[0] * rng.normal(size=positions.shape)
    orientations = orientations * Rotation.from_rotvec(NOISE[1] * rng.normal(size=positions.shape))
    q = states[0] + off + 2e-4 * rng.normal(size=states[0].shape)
    torques = torques + 0.025 * np.array([3, 4, 2, 0.4, 0.4]) * rng.normal(size=torques.shape)
    measured = by_joint(JOINTS, position=q, torque=torques) | poses_of("flange", positions, orientations)
    return ident.Recording(time, measured, trackers={"flange": Tracker("b4")}), shifts, off


def identified(recording, **setup):
    return ident.identify(mechanism(), recording, drive=[], holdout=0.0, known=False, setup={"axis": 0.0, **setup})


def results(estimate):
    """Values and standard deviations of the set-up parameters that were fitted, by name."""
    fit, std = estimate.trajectory.fit, np.sqrt(np.diag(estimate.trajectory.fit.covariance))
    return {fit.names[k]: (fit.theta[k], std[k]) for k in estimate.trajectory.setup if fit.free[k]}


def test_channels_and_derivatives_are_those_of_mujoco():
    """The turn of the flange as small angles in its own axes; frames as the alignment recovers them."""
    time, arm = np.arange(100) / 20, mechanism()
    states = motion(np.random.default_rng(1), time)
    _, positions, orientations, jacobians = in_mujoco(states)
    poses = poses_of("flange", positions, orientations)
    recording = ident.Recording(time, poses, trackers={"flange": Tracker("b4")})
    (flange,) = aligned(arm, recording, Motion(*states)).values()
    np.testing.assert_allclose(flange.frame[:3, :3], WORLD[0].inv().as_matrix(), atol=1e-9)
    np.testing.assert_allclose(flange.markers[:3, 3], MARKERS[0], atol=1e-9)
    m = Measurement(Equations.of_wrench(arm), (), False, np.eye(4), tuple(range(6)), {}, {"flange": flange})
    poses, theta = measured_poses(recording, "flange").values, np.zeros(len(m.names))
    halves = poses[:, 6:].reshape(-1, 2, 6)
    np.testing.assert_allclose(m.values(np.array(states), halves, theta)[6:].T, poses[:, :6], atol=1e-9)
    _, by_states, _ = m.derivatives(np.array(states), halves, theta, np.arange(0))
    R, turn = orientations.as_matrix(), WORLD[0].as_matrix()
    np.testing.assert_allclose(by_states[6:9, 0].transpose(2, 0, 1), turn @ jacobians[:, 0], atol=1e-9)
    expected = R.swapaxes(1, 2) @ turn @ jacobians[:, 1]
    np.testing.assert_allclose(by_states[9:, 0].transpose(2, 0, 1), expected, atol=1e-9)
    assert not by_states[6:, 1:].any()


def test_stated_frames_are_kept_and_several_bodies_share_an_unknown_one():
    time = np.arange(60) / 15
    states = motion(np.random.default_rng(2), time)
    _, positions, orientations, _ = in_mujoco(states)
    world = pose(WORLD[0].as_matrix(), WORLD[1])
    frame, elbow = inverse(world), world @ mechanism().tree.poses(states[0])[:, 2]
    measured = poses_of("flange", positions, orientations)
    measured |= poses_of("elbow", elbow[:, :3, 3], Rotation.from_matrix(elbow[:, :3, :3]))
    for trackers in (
        {"elbow": Tracker("b2", markers=np.eye(4)), "flange": Tracker("b4")},
        {"elbow": Tracker("b2"), "flange": Tracker("b4", frame=frame)},
    ):
        tracked = aligned(mechanism(), ident.Recording(time, measured, trackers=trackers), Motion(*states))
        for name, place in (("elbow", np.zeros(3)), ("flange", MARKERS[0])):
            np.testing.assert_allclose(tracked[name].frame, frame, atol=1e-6)
            np.testing.assert_allclose(tracked[name].markers[:3, 3], place, atol=1e-6)


def test_unknown_frames_are_aligned_to_the_noise_where_bodies_hardly_turn():
    rng, time = np.random.default_rng(3), np.arange(200) / 50
    states = [0.05 * x for x in motion(rng, time)]
    _, positions, orientations, _ = in_mujoco(states)
    orientations *= Rotation.from_rotvec(1e-3 * rng.normal(size=(200, 3)))
    measured = {"flange_position": positions, "flange_orientation": orientations.as_quat(scalar_first=True)}
    recording = ident.Recording(time, measured, trackers={"flange": Tracker("b4")})
    (flange,) = aligned(mechanism(), recording, Motion(*states)).values()
    poses = np.linalg.inv(flange.frame) @ mechanism().tree.poses(states[0])[:, -1] @ flange.markers
    errors = (orientations.inv() * Rotation.from_matrix(poses[:, :3, :3])).magnitude()
    assert np.sqrt((errors**2).mean()) < 2e-3 and abs(poses[:, :3, 3] - positions).max() < 1e-3


def test_a_tracked_flange_calibrates_the_arm_within_the_estimate():
    recording, shifts, zeros = recorded(seconds=6.0, displaced=1e-3, zeros=np.radians(0.5))
    estimate = identified(recording)
    own, alone = results(estimate), identified(replace(recording, trackers={}))
    for name, true in (("centre_x(lift)", shifts[1, 0]), ("centre_x(bend)", shifts[2, 0])):
        assert abs(own[name][0] - true) < 3 * own[name][1] < 3e-4, name
    assert abs(own["zero(roll)"][0] - zeros[3]) < 3 * own["zero(roll)"][1] < np.radians(0.02)
    # A shift of the elbow across its link is a turn of the link.
    assert own["zero(lift)"][1] > np.radians(0.1) and own["centre_z(bend)"][1] > 0.5e-3
    noise = estimate.trajectory.fit.channel_noise[5:]
    np.testing.assert_allclose(noise, np.repeat(NOISE, 3), rtol=0.1)
    assert estimate.trajectory.fit.channel_noise.shape == (11,) and len(estimate.channels) == 5
    told = {each.name: each for each in estimate.setup}
    assert "farther from the joint 'lift' than in the model" in told["centre_x(bend)"].text
    assert not any(name.startswith("tracker") for name in told)
    assert set(told) <= {name for name, (value, std) in own.items() if abs(value) > 3 * std}
    assert (estimate.held_out.ratio < 1.05 * alone.held_out.ratio).all()
    truth, std = estimate.base.regroup(mechanism().known), estimate.std_setup
    assert (abs(estimate.psi - truth) < 4 * std).all() and np.median(std / alone.std_setup) < 0.9


def test_a_late_tracker_that_sees_no_markers_at_times_is_estimated():
    recording, *_ = recorded(zeros=np.radians(0.5))
    usual, hidden = identified(recording, centre=0.0), np.arange(2, len(recording.time))[:, None] % 100 < 30
    seen = ((name, recording[name][:-2]) for name in ("flange_position", "flange_orientation"))
    streams = {name: Sampled(recording.time[2:], np.where(hidden, np.nan, x)) for name, x in seen}
    late = identified(replace(recording, streams=streams), centre=0.0)
    (finding,) = coded(late, "setup_tracker_delay")
    assert re.match(r"The poses of tracked bodies are (19\.9|20\.0)\d* ± 0\.0\d+ ms late\.", finding.text)
    assert not any(each.doubt for each in coded(late, "tracked_poses"))
    (finding,) = coded(usual, "tracked_poses")
    assert not finding.doubt and finding.place.bodies == ("b4",)
    assert re.fullmatch(r"The poses 'flange' have noise of 0\.(098|099|1) mm and 0\.01°\.", finding.text)
    own, whole = results(late), results(usual)
    assert abs(own["tracker_delay"][0] - 0.02) < 4 * own["tracker_delay"][1]
    for name in ("zero(lift)", "zero(roll)"):
        assert abs(own[name][0] - whole[name][0]) < 2 * own[name][1] < np.radians(0.03)


def test_a_saved_recording_keeps_its_trackers(tmp_path):
    recording, *_ = recorded(seconds=1.0)
    frames = recording.trackers, {"flange": Tracker("b4", frame=np.eye(4))}
    for name, trackers in zip(("run.npz", "run.csv"), frames, strict=True):
        replace(recording, trackers=trackers).save(tmp_path / name)
        (tracker,) = ident.Recording.load(tmp_path / name).trackers.values()
        assert tracker.body == "b4" and np.array_equal(tracker.frame, trackers["flange"].frame)


def test_poses_that_do_not_fit_are_a_doubt():
    recording = replace(recorded(seconds=1.0)[0], trackers={"flange": Tracker("b2")})
    (finding,) = coded(identified(recording, centre=0.0), "tracked_poses")
    assert finding.doubt and finding.place.bodies == ("b2",)


POSE = {"position": ["x", "y", "z"], "unit": "mm", "rotation_vector": ["rx", "ry", "rz"], "rotation_unit": "deg"}
QUATERNION = {"position": ["x", "y", "z"], "unit": "mm", "quaternion": ["qw", "qx", "qy", "qz"]}


def columns():
    """A recording, and columns of a log of it with poses in millimetres and degrees."""
    recording, *_ = recorded(seconds=1.0)
    quaternion, position = recording["flange_orientation"], 1e3 * recording["flange_position"]
    turns = np.degrees(Rotation.from_quat(quaternion, scalar_first=True).as_rotvec())
    poses = zip(
        ["x", "y", "z", *POSE["rotation_vector"], *QUATERNION["quaternion"]],
        np.hstack([position, turns, quaternion]).T,
        strict=True,
    )
    return recording, {"time": recording.time, **recording.measured, **dict(poses)}


def test_poses_are_read_from_columns_in_any_unit_and_may_be_missing():
    recording, cells = columns()
    cells["y"] = np.where(np.arange(100) < 10, np.nan, cells["y"])
    place = {"position": [0.1, 0, 0], "rpy_deg": [0, 0, 90]}
    for entry in (POSE, QUATERNION):
        stated = {"tracked": {"flange": {"body": "b4", "markers": place, **entry}}}
        read = ident.read_log(cells, mechanism(), stated)
        assert len(read.time) == 100 and read.trackers["flange"].frame is None
        np.testing.assert_allclose(read.trackers["flange"].markers[:3, :2], [[0, -1], [1, 0], [0, 0]], atol=1e-12)
        position = read.as_measured("flange_position").values
        np.testing.assert_allclose(position[10:], recording["flange_position"][10:], rtol=1e-12)
        own, true = (Rotation.from_quat(x["flange_orientation"], scalar_first=True) for x in (read, recording))
        assert np.isnan(position[:10, 1]).all() and (own.inv() * true).magnitude().max() < 1e-12


def test_what_is_wrong_in_an_entry_is_one_sentence():
    given = columns()[1] | {"more": np.full(100, 2.0), "none": np.full(100, np.nan)}
    for entry, message in (
        ({**POSE, "position": ["x", "y"]}, "tracked.flange.position needs a list of 3 columns, got ['x', 'y']."),
        ({**POSE, **QUATERNION}, "[tracked.flange] needs columns of either a quaternion or a rotation_vector"),
        ({**QUATERNION, "quaternion": ["more", "qx", "qy", "qz"]}, "tracked.flange.orientation needs a norm of 1"),
        ({**POSE, "rotation_vector": ["rx", "none", "rz"]}, "column 'none' is empty, but tracked.flange.orientation"),
        ({**POSE, "world": {}}, "[tracked.flange] has no entry 'world'; valid are body, position,"),
    ):
        stated = {"tracked": {"flange": {"body": "b4", **entry}}}
        assert message in sentence_of(ident.read_log, given, mechanism(), stated)


def test_recordings_in_python_are_checked_too():
    recording, *_ = recorded(seconds=1.0)
    turns, places = recording["flange_orientation"], recording["flange_position"]

    def measured(**flange):
        return {"measured": recording.measured | {f"flange_{name}": x for name, x in flange.items()}}

    still = measured(orientation=np.tile(turns[0], (100, 1)), position=np.tile(places[0], (100, 1)))
    hidden = Sampled(recording.time, np.where(np.arange(100)[:, None] < 9, places, np.nan))
    least = (
        "needs at least 10 poses, samples that have both flange_position and flange_orientation, and different ones "
    )
    least += "where joints move 'b4'; got {}."
    for given, message in (
        ({"trackers": {"flange": Tracker("world")}}, "The tracker 'flange' needs a body that joints move, one of b0,"),
        ({"trackers": {"tool": Tracker("b4")}}, "The recording has no channel 'tool_position'; it has bend_position,"),
        (measured(orientation=2 * turns), "'flange_orientation' needs quaternions of norm 1"),
        (measured() | {"streams": {"flange_position": hidden}}, least.format(9)),
        (still, least.format(1)),
    ):
        assert message in sentence_of(identified, replace(recording, **given))
    check_tracked(mechanism(), replace(recording, **still), mechanism().tree.joints)
    with pytest.raises(ident.InputError, match=r"tilt, poses 'flange'; it has turn, .*tilt\.$"):
        identified([recording, replace(recorded(1, seconds=1.0)[0], trackers={})])
