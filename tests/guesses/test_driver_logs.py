"""Guesses for logs of ten drivers and tools are right or left open; they give way to the model and the file."""

import re
from collections import Counter
from dataclasses import replace
from itertools import chain
from pathlib import Path

import driven_arm
import numpy as np
import pytest
from guesses.forty_logs import LOGS, columns_of, seven, ur
from guesses.odd_logs import arm, belief_of, read_as_guessed, recording
from mechanisms import by_joint

import experiments
from experiments.guesses.belief import DOUBTFUL
from experiments.guesses.guess import believed
from ident import joint_torque_regressor
from ident.files.table import CURRENT
from ident.recordings.plates import AUTO


def judged(log, folder):
    """Wrong columns, missing columns, and the belief."""
    belief = believed(log.mechanism, [log.write(folder)])
    guesses = {f"{x.joint}.{x.kind}": x for x in belief.quantities.values() if x.column and x.sure != DOUBTFUL}
    wrong, lacking = [], [key for key, truth in log.truth.items() if truth and key not in guesses]
    for key, guess in guesses.items():
        column, factor = log.truth.get(key) or ("no column", 1.0)
        scale = guess.gain * (CURRENT[guess.unit] if guess.unit in CURRENT else belief.factor(guess))
        if guess.column != column or abs(scale / factor - 1) > (0.3 if guess.unit in CURRENT else 1e-6):
            wrong.append(f"{key} ← {scale:g} {guess.column}, not {factor:g} {column}")
    there = {}
    for group in belief.outer.values():
        entries = {key: entry.value for key, entry in group.entries.items()}
        there[tuple(chain(*(entries[k] for k in ("force", "torque", "free_moment") if k in entries)))] = entries
    for columns, body in log.wrenches.items():
        entries = there.pop(columns, None)
        if entries is None:
            lacking.append(columns[0])
            continue
        on = entries["among"] if entries.get("on") == AUTO else [entries.get("on"), entries.get("body")]
        units = {entries.get(key) for key in ("unit", "torque_unit", "point_unit")} - {None, "N", "N m", "m"}
        if (body and body not in on) or {"rpy_deg", "applied_to_link"} & entries.keys() or units:
            wrong.append(f"{columns[0]}: {entries}")
    return wrong + [f"a wrench of {', '.join(columns)}" for columns in there], lacking, belief


FIRST = {log.tool: log for log in reversed(LOGS)}.values()
QUICK = [pytest.param(log, marks=() if log.asked or log in FIRST else pytest.mark.slow) for log in LOGS]
"""All logs; of each tool the first, and those with a question, are fast enough for every run."""


@pytest.mark.parametrize("log", QUICK, ids=lambda log: f"{log.tool}: {log.about}")
def test_what_is_guessed_is_right_or_asked(log, tmp_path):
    wrong, lacking, belief = judged(log, tmp_path)
    is_open = lacking or None in log.truth.values()
    assert not wrong and bool(is_open) == log.asked and (not is_open or belief.open), lacking


def test_the_table_of_the_documentation_counts_them():
    page = Path(experiments.__file__).parents[1] / "docs" / "recordings.md"
    if not page.exists():
        pytest.skip("only a checkout has docs")
    rows = re.findall(r"^\| ([^|]+?) \| (\d+) \| (\d+) \| (\d+) \|", page.read_text(encoding="utf-8"), re.MULTILINE)
    counted, tools = Counter((log.tool, log.asked) for log in LOGS), dict.fromkeys(log.tool for log in LOGS)
    expected = [(tool, str(counted[tool, False]), str(counted[tool, True]), "0") for tool in tools]
    assert rows == [*expected, ("all", *(str(sum(int(row[k]) for row in expected)) for k in (1, 2, 3)))]


def test_without_wrench_and_torque_numbers_that_fit_are_taken_and_others_asked(tmp_path):
    for robot, taken in ((seven(), True), (ur(), False)):
        belief = belief_of(tmp_path, columns_of(robot, "q_{}", "dq_{}")[0], robot.mechanism)
        assert belief.complete == taken and bool(belief.open) != taken
        assert all("nothing in the log can confirm" in x.why[0] for x in belief.of("position").values())


@pytest.mark.parametrize("name", ["may", "position"])
def test_no_name_of_a_joint_hides_that_it_is_absent(tmp_path, name):
    mechanism, r, names = arm(), recording(), {"joint1": "first", "joint2": name}
    bodies = tuple(replace(body, joint=names.get(body.joint, body.joint)) for body in mechanism.tree.bodies)
    renamed = replace(mechanism, tree=replace(mechanism.tree, bodies=bodies), drives={})
    columns = {"time": r.time, "first_motor": r["joint1_position"], "first_load": r["joint1_position"]}
    belief = belief_of(tmp_path, columns | {"room": np.sin(r.time)}, renamed)
    assert any("'first' may be in first_motor or in first_load" in sentence for sentence in belief.open)
    assert any(f"No column looks like the position of '{name}'" in sentence for sentence in belief.open)


def test_no_gain_is_written_that_the_file_contradicts(tmp_path):
    """A wrist whose load differs from the model's; the other joints are right."""
    robot = seven()._replace(tau=seven().tau * [1, 1, 1, 1, 1, 13, 1])
    belief = belief_of(tmp_path, columns_of(robot, "q_{}", "dq_{}", "tau_{}")[0], robot.mechanism)
    assert {(x.gain, x.unit) for x in belief.of("torque").values()} == {(1.0, "N m")}
    assert "but no gain is put for it" in belief.of("torque")["panda_joint6"].why[-1]


def test_torques_of_two_families_that_are_as_good_are_asked_about(tmp_path):
    robot = seven()
    raw = robot._replace(tau=robot.tau + 1e-3 * np.ptp(robot.tau, axis=0) * np.sin(30 * robot.time)[:, None])
    columns = columns_of(robot, "q_{}", "", "tau_{}")[0] | columns_of(raw, "", "", "tau_raw_{}")[0]
    belief = belief_of(tmp_path, columns, robot.mechanism)
    assert belief.complete and belief.of("torque") == {}
    assert any(sentence.startswith("The torques may be those of tau_") for sentence in belief.open)


@pytest.mark.parametrize("rpy", [(180.0, 0.0, 0.0), (0.0, 90.0, 0.0)])
def test_a_base_in_another_orientation_is_written_and_no_sign_is_turned(tmp_path, rpy):
    robot, rng = driven_arm.mechanism(**driven_arm.NONE), np.random.default_rng(1)
    t, q, dq, ddq = driven_arm.motion(rng)
    torques = 1.1 * joint_torque_regressor(robot.tree, q, dq, ddq, gravity=robot.mounted(rpy).gravity) @ robot.known
    torques += 0.3 * np.tanh(dq / 0.01) + rng.normal(scale=0.05, size=torques.shape)
    belief = belief_of(tmp_path, {"time": t} | by_joint(robot.tree.joints, position=q, torque=torques), robot)
    assert read_as_guessed(tmp_path, belief, robot).base_rpy_deg == rpy
    assert all(x.gain == 1 for x in belief.quantities.values())
