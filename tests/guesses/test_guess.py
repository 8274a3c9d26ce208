"""Odd logs are mapped as by a person, and ambiguous quantities stay open."""

from dataclasses import replace

import numpy as np
import pytest
from guesses.odd_logs import GAINS, LOGS, arm, belief_of, motors, read_as_guessed, recording, vector, write
from scipy.spatial.transform import Rotation

import ident
from experiments.guesses.belief import write_mapping
from experiments.guesses.guess import believed
from experiments.guesses.words import words, wrench_groups
from ident import Body, Mechanism, Tree
from ident.mechanism.body import ball_twist

JOINTS = ("joint1", "joint2")
Q1, Q2 = (recording()[f"{joint}_position"] for joint in JOINTS)
WRENCH = recording().wrench("ground").values
HIP = Body("leg", -1, np.eye(4), ball_twist(np.zeros(3)), "hip")
KNEE = Body("shank", 0, np.eye(4), np.eye(6)[4], "knee")
TURNS = Rotation.from_rotvec(np.random.default_rng(1).normal(size=(40, 3))).as_quat(scalar_first=True)
PLACES = np.random.default_rng(2).normal(size=(40, 3))
PLATE = [f"1_ground_force_v{axis}" for axis in "xyz"]


@pytest.mark.parametrize("log", LOGS, ids=lambda log: log.__name__)
def test_the_guessed_mapping_reads_as_the_true_one(tmp_path, log):
    path, true = write(tmp_path, log)
    belief, columns = believed(arm(), [path]), tmp_path / "guessed.toml"
    write_mapping(columns, belief)
    assert belief.open == []
    recording, expected = (ident.read_log(path, arm(), mapping) for mapping in (columns, true))
    assert recording.measured.keys() == expected.measured.keys() and recording.sensors.keys() == expected.sensors.keys()
    for name, sensor in expected.sensors.items():
        np.testing.assert_allclose(recording.sensors[name].pose, sensor.pose, atol=1e-9)
        assert recording.sensors[name].applied_to_link == sensor.applied_to_link
    for name, x in expected.measured.items():
        # Gains of motors are regressed on the model.
        close = 0.03 if log is motors and name.endswith("torque") else 1e-9
        np.testing.assert_allclose(recording[name], x, rtol=close, atol=1e-9)
    for joint, gain in zip(JOINTS, GAINS, strict=True) if log is motors else ():
        torque = belief.quantities[f"joints.{joint}.torque"]
        deviation = float(torque.why[-1].split("±")[1].split()[0])
        assert abs(torque.gain - gain) < max(3 * deviation, 5e-4 * abs(gain)) and deviation < 0.1 * abs(gain)


def guessed_of(tmp_path, columns, wrench=WRENCH):
    """The belief of some columns beside the ground's wrench (N, 6), and the log as it is read by it."""
    belief = belief_of(tmp_path, columns | vector("F{}", wrench[:, :3]) | vector("M{}", wrench[:, 3:]), arm())
    return belief, read_as_guessed(tmp_path, belief, arm())


def test_what_is_named_like_a_rate_but_is_none_is_left_out(tmp_path):
    noise = np.random.default_rng(0).normal(size=len(Q1))
    belief, read = guessed_of(tmp_path, {"q_joint1": Q1, "q_joint2": Q2, "dq_joint1": noise})
    assert belief.quantities["joints.joint1.velocity"].column == "" and "dq_joint1" in belief.unused
    assert any("named like the velocity of 'joint1'" in sentence for sentence in belief.notes)
    assert "joint1_velocity" not in read.measured


def test_a_mirrored_joint_before_a_turned_plate_stays_open(tmp_path):
    turn = np.kron(np.eye(2), [[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    belief, read = guessed_of(tmp_path, {"joint1": Q1, "joint2": -Q2}, WRENCH @ turn.T)
    assert belief.open[0].startswith("One of joint1, joint2 has the opposite sign")
    np.testing.assert_allclose(read["joint2_position"], -Q2, atol=1e-9)
    assert read.sensors["ground"].applied_to_link
    np.testing.assert_array_equal(read.sensors["ground"].pose, np.eye(4))


def test_a_size_that_no_unit_explains_is_said_and_no_unit_is_made_up(tmp_path):
    belief, _ = guessed_of(tmp_path, {"joint1": Q1, "joint2": Q2}, 1e-9 * WRENCH)
    assert not {"unit", "torque_unit"} & belief.groups["ground"].entries.keys()
    assert sum("which no other unit explains" in note for note in belief.notes) == 2


def same_turns(turns):
    own = Rotation.from_matrix(turns) if turns.ndim == 3 else Rotation.from_quat(turns, scalar_first=True)
    return (own * Rotation.from_quat(TURNS, scalar_first=True).inv()).magnitude().max() < 1e-6


def test_ball_joints_are_found_by_their_names(tmp_path):
    mechanism = Mechanism(Tree((HIP, KNEE)), np.zeros(3))
    for pattern in ("hip_position.{}", "Hip quat {}", "hip_q{}"):
        columns = vector(pattern, TURNS, "wxyz") | {"knee_angle": PLACES[:, 0]}
        belief = belief_of(tmp_path, columns, mechanism)
        log = read_as_guessed(tmp_path, belief, mechanism)
        np.testing.assert_allclose(log["knee_position"], PLACES[:, 0])
        assert same_turns(log["hip_position"]) and belief.open == [] and belief.complete
    belief = belief_of(tmp_path, vector("q{}", TURNS, "wxyz") | {"knee_angle": PLACES[:, 0]}, mechanism)
    assert belief.open == ["No column looks like the position of 'hip'; --fix hip leaves out what rests."]


def test_poses_of_a_base_are_found_by_their_names(tmp_path):
    mechanism = Mechanism(Tree((replace(KNEE, parent=-1),)), np.zeros(3))
    for turn, place, factor in (("pelvis_q{}", "pelvis_p{}", 1), ("trunk rot {}", "trunk pos {} [mm]", 1000)):
        columns = vector(turn, TURNS, "wxyz") | vector(place, factor * PLACES) | {"knee_angle": PLACES[:, 0]}
        belief = belief_of(tmp_path, columns, mechanism, base="pelvis")
        log = read_as_guessed(tmp_path, belief, mechanism)
        np.testing.assert_allclose(log.base[:, :3, 3], PLACES, atol=1e-9)
        assert same_turns(log.base[:, :3, :3]) and belief.unused == []
        assert belief_of(tmp_path, columns, mechanism).poses == {}, "without --base the world rests"


def test_names_say_quantity_unit_and_whose():
    for name, kind, unit, core in (
        ("Timestamp [ms]", "time", "ms", ()),
        ("Joint 1 angle [deg]", "position", "deg", ("1",)),
        ("left_knee_vel (rad/s)", "velocity", "rad", ("left", "knee")),
        ("ddq_elbow", "acceleration", "", ("elbow",)),
        ("kneeAngle_L", "position", "", ("knee", "left")),
        ("tau_j03_Nmm", "torque", "N mm", ("3",)),
        ("motor_current_2 [mA]", "current", "mA", ("motor", "2")),
        ("joint1_current_A", "current", "A", ("1",)),
        ("current_A", "current", "", ("a",)),
        ("hip_flexion_r_moment", "torque", "", ("hip", "flexion", "right")),
        ("q1rad", "position", "rad", ("1",)),
        ("position_rad_1", "position", "rad", ("1",)),
        ("knee_deg_s2", "acceleration", "deg", ("knee",)),
        ("speed_rad_per_s knee", "velocity", "rad", ("knee",)),
        ("Achse3 Drehmoment mNm", "torque", "N mm", ("3",)),
        ("jointpos1", "position", "", ("1",)),
        ("x_axis_force", "force", "", ("x",)),
        ("room temperature", "", "", ("room", "temperature")),
    ):
        meaning = words(name)
        assert (meaning.kind, meaning.unit, meaning.core) == (kind, unit, core)


def test_names_of_components_of_a_wrench():
    for columns, force, torque in (
        (["Fx", "Fy", "Fz", "Mx", "My", "Mz", "remark"], ["Fx", "Fy", "Fz"], ["Mx", "My", "Mz"]),
        ([*PLATE, "1_ground_force_px", "1_ground_torque_y"], PLATE, ["", "1_ground_torque_y", ""]),
        (["COPx", "Fz2", "Mx2"], ["", "", "Fz2"], ["Mx2", "", ""]),
        (["grf z"], ["", "", "grf z"], ["", "", ""]),
    ):
        best = max(wrench_groups(columns).values(), key=len)
        assert [best.get(("force", axis), "") for axis in "xyz"] == force
        assert [best.get(("torque", axis), "") for axis in "xyz"] == torque
