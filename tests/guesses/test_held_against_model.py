"""Guesses give way to the model and the file: orders, units, gains, and joints that are absent."""

from dataclasses import replace

import numpy as np
import pytest
from guesses.driver_logs import noise, stamped, states
from guesses.odd_logs import DEG, arm, recording, text, torques
from guesses.robots import FINGERS, seven, ur

import ident
import sim
from experiments.guesses.guess import believed
from experiments.guesses.written import table, write_mapping

STEPS = ("position", "velocity", "torque")


def believed_of(folder, robot, columns, mechanism=None):
    path = folder / "log.csv"
    path.write_text(text(columns), encoding="utf-8")
    return believed(mechanism or robot.mechanism, [path])


def test_an_order_that_explains_nothing_is_not_likely(tmp_path):
    robot = ur()
    order = [3, 0, 5, 1, 4, 2]
    columns = stamped(robot) | states(replace(robot, q=robot.q[:, order]), "actual_q_{}", "", "tau_{}")
    belief = believed_of(tmp_path, robot, columns)
    assert belief.of("position") == {} and belief.of("torque") == {}
    assert not any(" likely" in line for line in table(belief)[1:])
    assert belief.open[0].startswith(
        "The columns of the positions of shoulder_pan_joint to wrist_3_joint are open. With"
    )
    assert belief.undecided == set(robot.joints) and len(belief.open) == 1


def test_exact_names_that_explain_little_are_pointed_out(tmp_path):
    robot = seven("joint{}")
    columns = states(replace(robot, q=robot.q[:, ::-1]), "joint{}_position", "", "joint{}_torque", first=1)
    belief = believed_of(tmp_path, robot, stamped(robot) | columns)
    assert belief.complete
    assert any("named like positions the model explains" in sentence for sentence in belief.notes)


def test_without_wrench_and_torque_numbers_that_fit_are_taken_and_others_asked(tmp_path):
    for robot, taken in ((seven(), True), (ur(), False)):
        belief = believed_of(tmp_path, robot, stamped(robot) | states(robot, "q_{}", "dq_{}", ""))
        assert belief.complete == taken and bool(belief.open) != taken
        assert all("nothing in the log can confirm" in x.why[0] for x in belief.of("position").values())


def test_joints_turned_around_are_aligned_all_the_same(tmp_path):
    robot = seven()
    turned = replace(robot, q=robot.q * [1, -1, 1, 1, -1, 1, 1], dq=robot.dq * [1, -1, 1, 1, -1, 1, 1])
    belief = believed_of(tmp_path, robot, stamped(robot) | states(turned, "q_{}", "dq_{}", "tau_{}"))
    assert [belief.of("position")[joint].column for joint in robot.joints] == [f"q_{k}" for k in range(7)]
    assert [belief.of("position")[joint].gain for joint in robot.joints] == [1, -1, 1, 1, -1, 1, 1]


def test_fixing_the_fingers_as_advised_leaves_nothing_open(tmp_path):
    hand = seven(fingers=True)
    columns = stamped(hand) | states(hand, "q_{}", "dq_{}", "tau_{}")
    belief = believed_of(tmp_path, hand, columns)
    (sentence,) = belief.open
    assert all(f"--fix {name}" in sentence for name in FINGERS) and len(belief.of("position")) == 7
    model = tmp_path / "hand.xml"
    sim.write_model(model, hand.mechanism, hand.mechanism.known)
    fixed = sim.mechanism(model, base="base", fix={name: [] for name in FINGERS})
    belief = believed_of(tmp_path, hand, columns, fixed)
    assert belief.open == [] and belief.complete


@pytest.mark.parametrize("name", ["may", "in", "position"])
def test_no_name_of_a_joint_hides_that_it_is_absent(tmp_path, name):
    mechanism = arm()
    bodies = [
        replace(body, joint={"joint1": "first", "joint2": name}.get(body.joint, body.joint))
        for body in mechanism.tree.bodies
    ]
    renamed = replace(mechanism, tree=replace(mechanism.tree, bodies=tuple(bodies)), drives={})
    r = recording()
    columns = {"time": r.time, "first_motor": r["joint1_position"], "first_load": r["joint1_position"]}
    belief = believed_of(tmp_path, None, columns | {"room": np.sin(r.time)}, renamed)
    assert any("'first' may be in first_motor or in first_load" in sentence for sentence in belief.open)
    assert any(f"No column looks like the position of '{name}'" in sentence for sentence in belief.open)


@pytest.mark.parametrize(("unit", "name"), [(" [Nm]", "tau_{}"), ("", "tau_{}")])
def test_no_gain_is_written_that_the_file_contradicts(tmp_path, unit, name):
    robot = seven()
    # A wrist whose load differs from the model's; the other joints are right.
    tau = robot.tau * [1, 1, 1, 1, 1, 13, 1]
    columns = stamped(robot) | states(replace(robot, tau=tau), "q_{}", "dq_{}", name + unit)
    belief = believed_of(tmp_path, robot, columns)
    assert {(x.gain, x.unit) for x in belief.of("torque").values()} == {(1.0, "N m")}
    assert "but no gain is put for it" in belief.of("torque")["panda_joint6"].why[-1]


def test_gears_of_all_joints_are_gains_where_nothing_says_the_unit(tmp_path):
    robot = seven()
    gears = np.array([100, 100, 80, 80, 50, 50, 50])
    motors = replace(robot, tau=robot.tau / gears)
    belief = believed_of(tmp_path, robot, stamped(robot) | states(motors, "q_{}", "", "motor_torque_{}"))
    gains = np.array([belief.of("torque")[joint].gain for joint in robot.joints])
    np.testing.assert_allclose(gains, gears, rtol=0.15)


def test_one_torque_alone_gets_no_gain(tmp_path):
    r = recording()
    columns = {"time": r.time, "q_joint1": r["joint1_position"], "q_joint2": r["joint2_position"]}
    belief = believed_of(tmp_path, None, columns | {"tau_joint1": 13 * torques()[:, 0]}, arm())
    assert belief.of("torque")["joint1"].gain == 1


def test_turns_beyond_a_circle_are_radians_if_the_model_says_so(tmp_path):
    robot = ur()
    many = replace(robot, q=robot.q + 6 * np.pi * np.eye(6)[0])
    for factor, unit in ((1.0, "rad"), (DEG, "deg")):
        scaled = replace(many, q=factor * many.q)
        belief = believed_of(tmp_path, robot, stamped(robot) | states(scaled, "actual_q_{}", "", "tau_{}"))
        assert {x.unit for x in belief.of("position").values()} == {unit}


def test_torques_of_two_families_that_are_as_good_are_asked_about(tmp_path):
    robot = seven()
    raw = replace(robot, tau=robot.tau + 1e-3 * np.ptp(robot.tau, axis=0) * np.sin(30 * robot.time)[:, None])
    columns = stamped(robot) | states(robot, "q_{}", "", "tau_{}") | states(raw, "", "", "tau_raw_{}")
    belief = believed_of(tmp_path, robot, columns)
    assert belief.complete and belief.of("torque") == {}
    assert any(sentence.startswith("The torques may be those of tau_") for sentence in belief.open)


def test_headless_commands_beside_positions_are_asked_about(tmp_path):
    robot = seven()
    block = np.hstack([robot.time[:, None], robot.q, robot.q + 1e-5, robot.tau])
    path = tmp_path / "log.csv"
    path.write_text("\n".join(",".join(f"{x:.9g}" for x in row) for row in block))
    belief = believed(robot.mechanism, [path])
    assert belief.of("position") == {} and "which were measured, and which were commanded, is open" in belief.open[0]


def test_numbers_that_are_no_motion_are_not_taken(tmp_path):
    robot = seven()
    columns = stamped(robot) | {f"x_{k}": x for k, x in enumerate(noise(robot, 14).T)}
    belief = believed_of(tmp_path, robot, columns)
    assert belief.quantities == {} and belief.groups == {} and belief.open


def test_the_mapping_of_a_zero_based_log_reads_as_it_should(tmp_path):
    robot = seven()
    belief = believed_of(tmp_path, robot, stamped(robot) | states(robot, "q_{}", "dq_{}", "tau_{}"))
    write_mapping(tmp_path / "c.toml", belief)
    log = ident.read_log(tmp_path / "log.csv", robot.mechanism, tmp_path / "c.toml")
    for k, joint in enumerate(robot.joints):
        for kind, x in zip(STEPS, (robot.q, robot.dq, robot.tau), strict=True):
            np.testing.assert_allclose(log[f"{joint}_{kind}"], x[:, k], atol=1e-9)
