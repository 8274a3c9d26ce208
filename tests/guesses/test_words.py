"""Words of column names."""

import pytest

from experiments.guesses.families import families
from experiments.guesses.words import LIKE, likeness, words
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
        ("q1rad", "position", "rad", ("1",)),
        ("kneePosRad", "position", "rad", ("knee",)),
        ("rad_knee", "position", "rad", ("knee",)),
        ("position_rad_1", "position", "rad", ("1",)),
        ("knee (rad/s)", "velocity", "rad", ("knee",)),
        ("knee_deg_s2", "acceleration", "deg", ("knee",)),
        ("speed_rad_per_s knee", "velocity", "rad", ("knee",)),
        ("knee_nm", "torque", "N m", ("knee",)),
        ("Achse3 Drehmoment mNm", "torque", "N mm", ("3",)),
        ("jointpos1", "position", "", ("1",)),
        ("x_axis_force", "force", "", ("x",)),
        ("room temperature", "", "", ("room", "temperature")),
    ],
)
def test_names_say_quantity_unit_and_whose(name, kind, unit, core):
    meaning = words(name)
    assert (meaning.kind, meaning.unit, meaning.core) == (kind, unit, core)


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


@pytest.mark.parametrize(
    ("names", "numbers", "kind"),
    [
        (["actual_q_0", "actual_q_1"], (0, 1), "position"),
        (["position[3]", "position[2]"], (2, 3), "position"),
        (["field.position0", "field.position1"], (0, 1), "position"),
        (["observation.state.0", "observation.state.1"], (0, 1), ""),
        (["A1 [deg]", "A2 [deg]"], (1, 2), "position"),
        (["T1 [Nm]", "T2 [Nm]"], (1, 2), "torque"),
        (["axisTMsr_nr0", "axisTMsr_nr1"], (0, 1), "torque"),
        (["lbr::joint_0::force", "lbr::joint_1::force"], (0, 1), "torque"),
        (["ur10_q_0", "ur10_q_1"], (0, 1), "position"),
        (["I_1 [A]", "I_2 [mA]"], (1, 2), "current"),
    ],
)
def test_families_of_numbered_names(names, numbers, kind):
    (family,) = families([*names, "time", "other"])
    assert (family.numbers, family.kind, family.is_of_joints) == (numbers, kind, True)
    assert family.names == tuple(sorted(names))


@pytest.mark.parametrize("whose", ["1", "foot_r", "calcn_l"])
@pytest.mark.parametrize("moment", ["force_{}_m{}", "moment_{}_m{}", "torque_{}_{}"])
def test_moments_of_plates_belong_to_their_forces(whose, moment):
    patterns = ("ground_force_{}_v{}", "ground_force_{}_p{}", f"ground_{moment}")
    names = [pattern.format(whose, axis) for pattern in patterns for axis in "xyz"]
    (group,) = wrench_groups([*names, "knee_angle_r"]).values()
    kinds = ("force", "point", "torque")
    assert group == dict(zip([(kind, axis) for kind in kinds for axis in "xyz"], names, strict=True))
