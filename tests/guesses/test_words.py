"""What names say."""

import numpy as np
import pytest

from experiments.guesses.clock import clock_of
from experiments.guesses.words import LIKE, likeness, words
from ident.errors import LogError
from ident.recordings.wrench_names import wrench_groups


@pytest.mark.parametrize(
    ("name", "kind", "unit", "core"),
    [
        ("Timestamp [ms]", "time", "ms", ()),
        ("Joint 1 angle [deg]", "position", "deg", ("1",)),
        ("left_knee_vel (rad/s)", "velocity", "rad", ("left", "knee")),
        ("ddq_elbow", "acceleration", "", ("elbow",)),
        ("kneeAngle_L", "position", "", ("knee", "left")),
        ("tau_j03_Nmm", "torque", "N mm", ("3",)),
        ("motor_current_2 [mA]", "current", "mA", ("motor", "2")),
        ("hip_flexion_r_moment", "torque", "", ("hip", "flexion", "right")),
        ("room temperature", "", "", ("room", "temperature")),
    ],
)
def test_names_say_quantity_unit_and_whose(name, kind, unit, core):
    said = words(name)
    assert (said.kind, said.unit, said.core) == (kind, unit, core)


@pytest.mark.parametrize(
    ("column", "joint", "alike"),
    [
        ("knee_r_angle", "RightKnee", True),
        ("knee_l_angle", "knee_r", False),
        ("q1", "joint1", True),
        ("q2", "joint1", False),
        ("q12", "joint1", False),
        ("/jointset/hip_r/hip_flexion_r/value", "hip_flexion_r", True),
        ("temperature", "elbow", False),
    ],
)
def test_likeness_needs_numbers_and_sides(column, joint, alike):
    assert (likeness(words(column), words(joint)) >= LIKE) == alike


def test_what_was_commanded_is_less_like():
    joint = words("knee")
    assert likeness(words("knee_cmd"), joint) < likeness(words("knee_pos"), joint)


def test_components_of_one_wrench_belong_together():
    names = [f"1_ground_force_{p}{a}" for p in "vp" for a in "xyz"] + [f"1_ground_torque_{a}" for a in "xyz"]
    (group,) = wrench_groups([*names, "time", "knee_angle_r", "fuzzy"]).values()
    assert set(group.values()) == set(names) and group["point", "y"] == "1_ground_force_py"


@pytest.mark.parametrize(("step", "unit"), [(0.01, "s"), (0.001, "s"), (10.0, "ms"), (1000.0, "us"), (1e6, "ns")])
def test_steps_tell_the_unit_of_times(step, unit):
    rng, t = np.random.default_rng(0), step * (17 + np.arange(200.0))
    found = clock_of({"counter": np.arange(200.0), "x": rng.normal(size=200), "stamp": t})
    assert (found.column, found.unit) == ("stamp", unit)


def test_without_times_or_with_two_clocks_a_sentence_says_so():
    rng, t = np.random.default_rng(0), np.arange(200) / 100
    with pytest.raises(LogError, match="no column of it grows as times do, of x"):
        clock_of({"x": rng.normal(size=200)})
    late = t + np.cumsum(rng.uniform(0, 0.02, 200))
    with pytest.raises(LogError, match="its times may be any of clock_a, clock_b"):
        clock_of({"clock_a": t, "clock_b": late})
