"""Words of column names."""

import pytest

from experiments.guesses.words import words
from ident.recordings.channels import wrench_groups


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


@pytest.mark.parametrize("whose", ["1", "foot_r", "calcn_l"])
@pytest.mark.parametrize("moment", ["force_{}_m{}", "moment_{}_m{}", "torque_{}_{}"])
def test_moments_of_plates_belong_to_their_forces(whose, moment):
    patterns = ("ground_force_{}_v{}", "ground_force_{}_p{}", f"ground_{moment}")
    names = [pattern.format(whose, axis) for pattern in patterns for axis in "xyz"]
    (group,) = wrench_groups([*names, "knee_angle_r"]).values()
    kinds = ("force", "point", "torque")
    assert group == dict(zip([(kind, axis) for kind in kinds for axis in "xyz"], names, strict=True))
