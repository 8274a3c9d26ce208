"""Guesses give way to the model and the file: orders, units, gains, and joints that are absent."""

from dataclasses import replace

import numpy as np
import pytest
from guesses.driver_logs import stamped, states
from guesses.odd_logs import arm, recording, text
from guesses.robots import seven, ur

from experiments.guesses.guess import believed


def believed_of(folder, robot, columns, mechanism=None):
    path = folder / "log.csv"
    path.write_text(text(columns), encoding="utf-8")
    return believed(mechanism or robot.mechanism, [path])


def test_without_wrench_and_torque_numbers_that_fit_are_taken_and_others_asked(tmp_path):
    for robot, taken in ((seven(), True), (ur(), False)):
        belief = believed_of(tmp_path, robot, stamped(robot) | states(robot, "q_{}", "dq_{}", ""))
        assert belief.complete == taken and bool(belief.open) != taken
        assert all("nothing in the log can confirm" in x.why[0] for x in belief.of("position").values())


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


def test_torques_of_two_families_that_are_as_good_are_asked_about(tmp_path):
    robot = seven()
    raw = replace(robot, tau=robot.tau + 1e-3 * np.ptp(robot.tau, axis=0) * np.sin(30 * robot.time)[:, None])
    columns = stamped(robot) | states(robot, "q_{}", "", "tau_{}") | states(raw, "", "", "tau_raw_{}")
    belief = believed_of(tmp_path, robot, columns)
    assert belief.complete and belief.of("torque") == {}
    assert any(sentence.startswith("The torques may be those of tau_") for sentence in belief.open)
