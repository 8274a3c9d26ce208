"""Logs in tables of text: layouts, mappings, jitter, suspected units, and pieces."""

import numpy as np
import pytest
from malformed_logs import DQ, JOINTS, PLAIN, WRENCH, N, Q, T, leg, read, retimed, text
from scipy.spatial.transform import Rotation

from ident import LogError
from ident.recordings.channels import unmapped

OUCH = {"time": T, "remark": T, "q_hip": Q[:, 1], "q_ankle": Q[:, 0]}


@pytest.mark.parametrize(
    "content",
    [
        *(text(PLAIN, end=end) for end in ("\n", "\r\n", "\r")),
        *(text(PLAIN, *layout) for layout in (";", ";,", "\t", "\t,")),
        text(PLAIN).rstrip(),
        "\ufeff" + text(PLAIN),
        *(text(PLAIN).encode(encoding) for encoding in ("utf-16", "utf-16-le", "utf-16-be")),
        text(PLAIN).replace(",", " , "),
        text(PLAIN).replace("\n", ",\n"),
        text(PLAIN).replace("q_hip", '"q_hip"'),
        "# a comment\n\n" + text(PLAIN) + "\n\n",
        text(OUCH).replace("\n0.01,0.01,", "\n0.01,ouch,"),
    ],
)
def test_what_spreadsheets_write_is_read(tmp_path, content):
    log = read(tmp_path, content)
    np.testing.assert_allclose(log.time, T, atol=1e-12)
    np.testing.assert_array_equal(log.of_joints(JOINTS, "position"), Q)
    assert list(log.measured) == ["ankle_position", "hip_position"] and log.rate == pytest.approx(100)
    assert (log.torques(JOINTS), log.base, log.wrenches, log.notes) == (None, None, (), [])


MAPPING = """
time = { column = "t", unit = "ms" }
[joints.ankle]
position = { column = "winkel", unit = "deg" }
velocity = { column = "rate", unit = "deg/s" }
[joints.hip]
position = "h"
velocity = "dh"
torque = { column = "h_moment", unit = "N mm" }
[wrenches.ground]
force = ["p1", "p2", "p3"]
torque = ["", "p5", ""]
unit = "kN"
torque_unit = "N mm"
position = [0.1, 0, -0.2]
rpy_deg = [0, 0, 90]
applied_to_link = false
[wrenches.handle]
force = ["h1", "h2", "h3"]
body = "torso"
quaternion = [0.5, 0.5, 0.5, 0.5]
[base]
position = ["x", "y", "z"]
quaternion = ["qw", "qx", "qy", "qz"]
unit = "mm"
"""
TURNS = Rotation.from_rotvec(np.outer(9 * T, [0, 0, 1]))
COLUMNS = {"t": 1000 * T, "winkel": np.rad2deg(Q[:, 0]), "rate": np.rad2deg(DQ[:, 0]), "h": Q[:, 1], "dh": DQ[:, 1]}
COLUMNS |= {"h_moment": 1000 * T} | {f"p{k + 1}": WRENCH[:, k] for k in range(6)}
COLUMNS |= {f"h{k + 1}": -WRENCH[:, k] for k in range(3)} | {axis: 1000 * WRENCH[:, k] for k, axis in enumerate("xyz")}
COLUMNS |= {f"q{c}": x * (-1) ** np.arange(N) for c, x in zip("wxyz", TURNS.as_quat(scalar_first=True).T, strict=True)}


def test_a_mapping_names_converts_and_places(tmp_path):
    log = read(tmp_path, text(COLUMNS), MAPPING)
    ground, handle = log.wrench("ground"), log.wrench("handle")
    for own, expected in (
        (log.time, T),
        (log.of_joints(JOINTS, "position"), Q),
        (log.of_joints(JOINTS, "velocity"), DQ),
        (log["hip_torque"], T),
        (ground.values[:, :3], 1000 * WRENCH[:, :3]),
        (ground.values[:, 4], WRENCH[:, 4] / 1000),
        (ground.pose, [[0, -1, 0, 0.1], [1, 0, 0, 0], [0, 0, 1, -0.2], [0, 0, 0, 1]]),
        (handle.pose[:3, :3], [[0, 0, 1], [1, 0, 0], [0, 1, 0]]),
        (log.base[:, :3, 3], WRENCH[:, :3]),
        (log.base[:, :3, :3], TURNS.as_matrix()),
    ):
        np.testing.assert_allclose(own, expected, rtol=1e-12, atol=1e-12)
    assert np.isnan(ground.values[:, [3, 5]]).all()
    assert (ground.applied_to_link, handle.applied_to_link, handle.body) == (False, True, "torso")
    units = {"ankle_position": "rad", "ankle_velocity": "rad/s", "hip_torque": "N m"}
    assert log.units == units | {"ground_force": "N", "ground_torque": "N m"}


def test_jitter_is_resampled_and_told(tmp_path):
    time = T + np.r_[0, np.random.default_rng(0).uniform(-0.0008, 0.0008, N - 2), 0]
    log = read(tmp_path, text({"time": time, "ankle": 3 * time, "hip": 1 - time}))
    expected = np.stack([3 * log.time, 1 - log.time], axis=1)
    np.testing.assert_allclose(log.of_joints(JOINTS, "position"), expected, atol=1e-12)
    np.testing.assert_allclose(np.diff(log.time), log.time[-1] / (len(log.time) - 1))
    (note,) = log.notes
    assert "jitter" in note and "resampled linearly" in note


def test_forces_far_below_the_weight_are_suspected(tmp_path):
    content = text(PLAIN | {"ground_fz": 0.6 + 0 * T, "ground_mx": T})
    assert "may be kN" in read(tmp_path, content, mechanism=leg(600.0)).notes[0]
    assert read(tmp_path, content, mechanism=leg(60.0)).notes == []
    stated = '[wrenches.ground]\nforce = ["", "", "ground_fz"]\nunit = "N"\n'
    assert read(tmp_path, content, stated, mechanism=leg(600.0)).notes == []


def test_columns_that_are_not_mapped_are_named():
    assert "it has the columns emg, theta; none is mapped as a wrench" in unmapped(["emg", "theta"])
    assert "it has no columns;" in unmapped([]) and "`multicontact columns MODEL LOG` writes" in unmapped([])


@pytest.mark.parametrize("sign", [1, -1])
def test_the_largest_time_and_the_largest_number(tmp_path, sign):
    """No clock exceeds 1e30, and no channel 1e8 of its SI unit, in any unit."""
    seconds = 'time = { column = "time", unit = "s" }'
    with pytest.raises(LogError, match=r"row 2, column 'time' needs numbers below 1e\+30"):
        read(tmp_path, retimed(1.1e30 * sign + 10 * T), seconds)
    kilo = '[wrenches.ground]\nforce = ["", "", "ground_fz"]\nunit = "kN"'
    for mapping, limit in ((None, 1e8), (kilo, 1e5)):
        near, beyond = (text(PLAIN | {"ground_fz": share * sign * limit + T}) for share in (0.9, 1.1))
        np.testing.assert_allclose(read(tmp_path, near, mapping).wrench("ground").values[0, 2], 0.9e8 * sign)
        with pytest.raises(LogError, match=r"row 2, column 'ground_fz' needs numbers below"):
            read(tmp_path, beyond, mapping)
