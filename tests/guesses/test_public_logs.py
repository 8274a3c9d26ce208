"""Logs as public data sets and drivers write them: numbered wrenches, percentages, arrays, namespaces and mirrors."""

import json
from importlib.resources import files

import mujoco
import numpy as np
import pytest
import wrist
from guesses.odd_logs import DEG, text
from guesses.test_laboratory_names import ARM, JOINTS, TAU, TIME, Q, belief_of, columns_of, mapped

import ident
import scenes
import sim
from experiments.guesses.belief import DOUBTFUL, LIKELY
from experiments.guesses.guess import believed
from experiments.guesses.written import write_mapping
from ident.recordings.wrench_names import wrench_groups

WRENCH = ("fx", "fy", "fz", "mx", "my", "mz")
SIX = ["FT{}", "ft.{}", "F/T {}", "wrench[{}]", "/wrist/wrench/data[{}]", "actual_TCP_force_{}", "force_torque_{}"]


@pytest.mark.parametrize("pattern", SIX)
@pytest.mark.parametrize("first", [0, 1])
def test_six_numbered_columns_of_a_sensor_are_a_wrench(pattern, first):
    names = [pattern.format(k + first) for k in range(6)]
    (group,) = wrench_groups(["time", *columns_of("q_{}", Q), *names]).values()
    assert group == dict(zip([(kind, x) for kind in ("force", "torque") for x in "xyz"], names, strict=True))


@pytest.mark.parametrize(
    "names", [[f"force_{k}" for k in range(6)], ["torque_0", "torque_1", "torque_2"], ["FT1", "FT3"]]
)
def test_numbered_columns_of_joints_are_no_wrench(names):
    assert wrench_groups(names) == {}


@pytest.mark.parametrize(
    ("patterns", "unit"), [(["FT{}"], "N"), (["force_{}", "torque_{}"], "N"), (["wrench[{}]"], "mN")]
)
def test_a_numbered_wrist_sensor_leads_to_its_body(tmp_path, patterns, unit):
    robot = sim.mechanism(mujoco.MjSpec.from_string(wrist.model()))
    recording, path = wrist.log(seconds=6.0), tmp_path / "log.csv"
    both = np.hstack([recording["wrist_force"], recording["wrist_torque"]]) * (1e3 if unit == "mN" else 1)
    names = [p.format(k) for p in patterns for k in range(6 // len(patterns))]
    columns = {"time": recording.time} | {f"{j}_position": recording[f"{j}_position"] for j in wrist.JOINTS}
    path.write_text(text(columns | dict(zip(names, both.T, strict=True))), encoding="utf-8")
    belief = believed(robot, [path])
    (group,) = belief.groups.values()
    assert (group.entries["body"].value, group.entries["unit"].value, belief.open) == ("tool", unit, [])
    write_mapping(tmp_path / "c.toml", belief)
    read = ident.read_log(path, robot, tmp_path / "c.toml")
    np.testing.assert_allclose(read[f"{group.name}_force"], recording["wrist_force"], atol=1e-5)


@pytest.mark.parametrize(
    ("name", "size"), [("observation.state.{n}.pos", 95.0), ("{n} pos [%]", 40.0), ("{n}_percent", 9.0)]
)
def test_percentages_of_a_range_are_no_degrees(tmp_path, name, size):
    belief = belief_of(tmp_path, columns_of(name, size / np.abs(Q).max() * Q))
    assert mapped(belief, "position") == {} and "percentages of calibrated ranges" in belief.open[0]
    assert {x.sure for x in belief.quantities.values()} == {DOUBTFUL}


def test_positions_beyond_a_percentage_are_degrees(tmp_path):
    belief = belief_of(tmp_path, columns_of("observation.state.{n}.pos", 130 / np.abs(Q).max() * Q))
    assert {(x.unit, x.sure) for x in belief.of("position").values()} == {("deg", LIKELY)}


def test_an_angle_whose_unit_others_state_is_not_sure(tmp_path):
    belief = belief_of(tmp_path, columns_of("{n}_position", Q * [DEG, 1, 1]) | columns_of("{n}_torque", TAU))
    assert {j: x.sure for j, x in belief.of("position").items()} == dict.fromkeys(JOINTS, LIKELY)


def test_a_mirrored_command_gets_a_gain(tmp_path):
    belief = belief_of(tmp_path, columns_of("{n}_pos", Q * [1, -1, 1]) | columns_of("{n}_goal", Q + 0.05 * TAU))
    assert {j: x.gain for j, x in belief.of("command").items()} == {"pan": 1, "lift": -1, "elbow": 1}


def test_a_mirrored_component_of_a_wrench_gets_a_gain(tmp_path):
    arm = sim.mechanism(scenes.load("arm"), base="base")
    columns = ident.read_log(str(files(scenes) / "arm.csv"), arm).measured
    wrench = np.hstack([columns["ground_force"], columns["ground_torque"]])
    belief = belief_of(
        tmp_path,
        {f"{joint}_position": columns[f"{joint}_position"] for joint in arm.joints}
        | dict(zip([f"plate_{x}" for x in WRENCH], (wrench * [1, -1, 1, 1, 1, 1]).T, strict=True)),
        arm,
    )
    write_mapping(tmp_path / "c.toml", belief)
    read = ident.read_log(tmp_path / "log.csv", arm, tmp_path / "c.toml")
    np.testing.assert_allclose(read["ground_force"], wrench[:, :3], atol=1e-5)


@pytest.mark.parametrize("prefix", ["/robot1/joint_states/{n}/", "/left_arm/joint_states/left_arm_{n}/"])
def test_a_robots_namespace_is_no_part_of_its_joints(tmp_path, prefix):
    quantities = {"position": Q, "velocity": np.gradient(Q, TIME, axis=0), "effort": TAU}
    columns = {k: x for kind, own in quantities.items() for k, x in columns_of(prefix + kind, own).items()}
    belief = belief_of(tmp_path, columns)
    for kind, own in {"position": "position", "velocity": "velocity", "torque": "effort"}.items():
        assert mapped(belief, kind) == {n: prefix.format(n=n) + own for n in JOINTS}
    assert not any(x.why[0].startswith("in the") for x in belief.quantities.values())


def test_computed_torques_are_not_measured_ones(tmp_path):
    columns = columns_of("joint_positions_{}", Q) | columns_of("joint_torques_computed_{}", TAU)
    belief = belief_of(tmp_path, columns)
    assert mapped(belief, "torque") == {}
    measured = {name.replace("computed", "measured"): x for name, x in columns.items()}
    assert len(mapped(belief_of(tmp_path, measured), "torque")) == 3


@pytest.mark.parametrize("stamp", [False, True])
@pytest.mark.parametrize("torque", ["effort", "torque"])
def test_json_lines_of_three_joints_are_no_vectors(tmp_path, stamp, torque):
    rows = zip(TIME, Q, TAU, strict=True)
    clock = (
        (lambda t: {"header": {"stamp": {"sec": int(t), "nanosec": round(t % 1 * 1e9)}}})
        if stamp
        else lambda t: {"t": t}
    )
    lines = [
        json.dumps({**clock(t), "name": JOINTS, "position": q.tolist(), torque: tau.tolist()}) for t, q, tau in rows
    ]
    (tmp_path / "log.jsonl").write_text("\n".join(lines))
    belief = believed(ARM, [tmp_path / "log.jsonl"])
    assert mapped(belief, "position") == {n: f"position.{x}" for n, x in zip(JOINTS, "xyz", strict=True)}
    assert mapped(belief, "torque") == {n: f"{torque}.{x}" for n, x in zip(JOINTS, "xyz", strict=True)}
    write_mapping(tmp_path / "c.toml", belief)
    read = ident.read_log(tmp_path / "log.jsonl", ARM, tmp_path / "c.toml")
    np.testing.assert_allclose(read["lift_torque"], TAU[:, 1], atol=1e-6)


@pytest.mark.parametrize("pose", [("tool_pos_{}", "tool_quat_{}"), ("/tool/position/{}", "/tool/orientation/{}")])
def test_a_lone_body_has_pose_and_wrench(tmp_path, pose):
    spec = '<mujoco><worldbody><body name="tool"><freejoint/><geom size=".1" pos="0 0 .1"/></body></worldbody></mujoco>'
    turn = np.column_stack([np.cos(TIME), np.sin(TIME), 0 * TIME, 0 * TIME])
    columns = {pose[0].format(x): own for x, own in zip("xyz", Q.T, strict=True)}
    columns |= {pose[1].format(x): own for x, own in zip("wxyz", turn.T, strict=True)}
    columns |= dict(zip(WRENCH, np.hstack([Q, TAU]).T, strict=True))
    path = tmp_path / "log.csv"
    path.write_text(text({"time": TIME} | columns))
    belief = believed(sim.mechanism(mujoco.MjSpec.from_string(spec), base="tool"), [path], base="tool")
    entries = belief.poses["base"].entries
    assert entries["position"].value == [pose[0].format(x) for x in "xyz"]
    assert entries["quaternion"].value == [pose[1].format(x) for x in "wxyz"]


def test_a_unit_that_the_model_prefers_by_a_hair_is_no_sure_one(tmp_path):
    """The angle of a pendulum and its rotor: both units explain all but a hundredth."""
    spec = mujoco.MjSpec.from_string(
        '<mujoco><worldbody><body name="rod"><joint name="hinge" axis="0 1 0"/><inertial mass="1" pos="0 0 -.3" '
        'diaginertia=".01 .01 .01"/></body></worldbody></mujoco>'
    )
    q = 0.3 * np.sin(2 * TIME)
    torque = 2.943 * np.sin(q) + 0.01 * np.random.default_rng(0).normal(size=q.shape)
    belief = belief_of(tmp_path, {"hinge_position": q, "hinge_torque": torque}, sim.mechanism(spec))
    assert (belief.of("position")["hinge"].unit, belief.of("position")["hinge"].sure) == ("rad", LIKELY)


def test_a_wrench_that_no_model_could_place_is_asked_about(tmp_path):
    columns = columns_of("{n}_position", Q[:17]) | dict(zip(WRENCH, np.hstack([Q, TAU])[:17].T, strict=True))
    belief = belief_of(tmp_path, columns)
    assert "ground" not in belief.groups and "It is open where" in belief.open[0]


def test_poses_without_times_are_told_how_they_are_read(tmp_path):
    (tmp_path / "log.csv").write_text(text(columns_of("{n}_position", np.random.default_rng(0).normal(size=(17, 3)))))
    with pytest.raises(ident.LogError, match="still poses need none where the columns file has poses = true"):
        believed(ARM, [tmp_path / "log.csv"])


def test_a_joint_of_two_words_is_quoted_in_its_option(tmp_path):
    spec = (
        '<mujoco><worldbody><body><joint name="Schulter 1"/><geom size=".1" pos=".1 0 0"/></body></worldbody></mujoco>'
    )
    (tmp_path / "log.csv").write_text(text({"time": TIME, "x": TIME}))
    with pytest.raises(ident.LogError, match=r"--fix 'Schulter 1' \[VALUE\]"):
        ident.read_log(tmp_path / "log.csv", sim.mechanism(mujoco.MjSpec.from_string(spec)))
