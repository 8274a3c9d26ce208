import numpy as np
import pytest
from malformed_logs import DQ, JOINTS, LEG, PLAIN, WRENCH, N, Q, T, leg, read, retimed, text
from scipy.spatial.transform import Rotation

from ident.errors import LogError
from ident.recordings.channels import suggested_mapping
from ident.recordings.log import read_log, read_log_pieces
from ident.recordings.recording import Recording


def positions(log):
    return log.of_joints(JOINTS, "position")


def assert_plain(log, exact=True):
    np.testing.assert_allclose(log.time, T, atol=1e-12)
    np.testing.assert_allclose(positions(log), Q, rtol=0 if exact else 1e-12, atol=0 if exact else 1e-12)


@pytest.mark.parametrize(
    "content",
    [
        text(PLAIN),
        text(PLAIN, end="\r\n"),
        text(PLAIN, end="\r"),
        text(PLAIN).rstrip(),
        text(PLAIN, ";"),
        text(PLAIN, ";", ","),
        text(PLAIN, "\t"),
        text(PLAIN, "\t", ","),
        "\ufeff" + text(PLAIN),
        text(PLAIN).encode("utf-16"),
        text(PLAIN).replace(",", " , "),
        text(PLAIN).replace("\n", ",\n"),
        text(PLAIN).replace("q_hip", '"q_hip"'),
        "# a comment\n\n" + text(PLAIN) + "\n\n",
        text({"time": T, "remark": T, "q_hip": Q[:, 1], "q_ankle": Q[:, 0]}).replace("\n0.01,0.01,", "\n0.01,ouch,"),
    ],
)
def test_what_spreadsheets_write_is_read(tmp_path, content):
    log = read(tmp_path, content)
    assert_plain(log)
    assert list(log.measured) == ["ankle_position", "hip_position"]
    assert (log.torques(JOINTS), log.base, log.wrenches, log.notes) == (None, None, (), [])
    assert np.isclose(log.rate, 100)


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


def mapped():
    turns = Rotation.from_rotvec(np.outer(9 * T, [0, 0, 1])).as_quat(scalar_first=True)
    columns = {"t": 1000 * T, "winkel": np.rad2deg(Q[:, 0]), "rate": np.rad2deg(DQ[:, 0]), "h": Q[:, 1], "dh": DQ[:, 1]}
    columns |= {"h_moment": 1000 * T} | {f"p{k + 1}": WRENCH[:, k] for k in range(6)}
    columns |= {f"h{k + 1}": -WRENCH[:, k] for k in range(3)} | dict(zip("xyz", 1000 * WRENCH.T))  # noqa: B905
    return columns | dict(zip(("qw", "qx", "qy", "qz"), turns.T * (-1) ** np.arange(N))), turns  # noqa: B905


def test_a_mapping_names_converts_and_places(tmp_path):
    columns, turns = mapped()
    log = read(tmp_path, text(columns), MAPPING)
    assert_plain(log, exact=False)
    np.testing.assert_allclose(log.of_joints(JOINTS, "velocity"), DQ, atol=1e-12)
    np.testing.assert_allclose(log["hip_torque"], T, atol=1e-12)
    units = {"ankle_position": "rad", "ankle_velocity": "rad/s", "hip_torque": "N m"}
    assert log.units == units | {"ground_force": "N", "ground_torque": "N m"}
    ground, handle = log.wrench("ground"), log.wrench("handle")
    np.testing.assert_allclose(ground.values[:, :3], 1000 * WRENCH[:, :3])
    np.testing.assert_allclose(ground.values[:, 4], WRENCH[:, 4] / 1000)
    assert np.isnan(ground.values[:, [3, 5]]).all()
    np.testing.assert_allclose(ground.pose, [[0, -1, 0, 0.1], [1, 0, 0, 0], [0, 0, 1, -0.2], [0, 0, 0, 1]], atol=1e-12)
    assert not ground.applied_to_link
    assert handle.body == "torso"
    assert handle.applied_to_link
    np.testing.assert_allclose(handle.pose[:3, :3], [[0, 0, 1], [1, 0, 0], [0, 1, 0]], atol=1e-12)
    np.testing.assert_allclose(log.base[:, :3, 3], WRENCH[:, :3])
    expected = Rotation.from_quat(turns, scalar_first=True).as_matrix()
    np.testing.assert_allclose(log.base[:, :3, :3], expected, atol=1e-12)


@pytest.mark.parametrize("suffix", ["csv", "npz"])
def test_a_log_that_was_saved_is_read_as_the_same_recording(tmp_path, suffix):
    log = read(tmp_path, text(mapped()[0]), MAPPING)
    log.save(tmp_path / f"saved.{suffix}")
    for again in (Recording.load(tmp_path / f"saved.{suffix}"), read_log(tmp_path / f"saved.{suffix}", LEG)):
        assert again.measured.keys() == log.measured.keys() and again.sensors.keys() == log.sensors.keys()
        for name, x in {"base": log.base, "time": log.time, **log.measured}.items():
            values = getattr(again, name) if name in ("base", "time") else again[name]
            np.testing.assert_allclose(values, x, rtol=0, atol=1e-12 * (name == "time"))
        for name in log.sensors:
            np.testing.assert_array_equal(again.wrench(name).pose, log.wrench(name).pose)
            assert again.wrench(name).applied_to_link == log.wrench(name).applied_to_link


def test_jitter_is_resampled_and_told(tmp_path):
    time = T + np.r_[0, np.random.default_rng(0).uniform(-0.0008, 0.0008, N - 2), 0]
    q = np.stack([3 * time, 1 - time], axis=1)
    log = read(tmp_path, text({"time": time, "ankle": q[:, 0], "hip": q[:, 1]}))
    np.testing.assert_allclose(positions(log), np.stack([3 * log.time, 1 - log.time], axis=1), atol=1e-12)
    np.testing.assert_allclose(np.diff(log.time), log.time[-1] / (len(log.time) - 1))
    (note,) = log.notes
    assert "jitter" in note
    assert "resampled linearly" in note
    assert "doubt the clock" not in note


def test_forces_far_below_the_weight_are_suspected(tmp_path):
    content = text(PLAIN | {"ground_fz": 0.6 + 0 * T, "ground_mx": T})
    assert "may be kN" in read(tmp_path, content, mechanism=leg(600.0)).notes[0]
    assert read(tmp_path, content, mechanism=leg(60.0)).notes == []
    stated = '[wrenches.ground]\nforce = ["", "", "ground_fz"]\nunit = "N"\n'
    assert read(tmp_path, content, stated, mechanism=leg(600.0)).notes == []


@pytest.mark.parametrize(
    ("columns", "lines"),
    [
        (
            ("Fx", "Fy", "Fz", "Mx", "My", "Mz", "remark"),
            ["[wrenches.ground]", 'force = ["Fx", "Fy", "Fz"]', 'torque = ["Mx", "My", "Mz"]'],
        ),
        (
            ("1_ground_force_vx", "1_ground_force_vy", "1_ground_force_vz", "1_ground_force_px", "1_ground_torque_y"),
            [
                "[wrenches.ground]",
                'force = ["1_ground_force_vx", "1_ground_force_vy", "1_ground_force_vz"]',
                'torque = ["", "1_ground_torque_y", ""]',
            ],
        ),
        (("grf z", "COPx", "Fz2", "Mx2"), ["[wrenches.ground]", 'force = ["", "", "Fz2"]', 'torque = ["Mx2", "", ""]']),
        (("grf z",), ["[wrenches.ground]", 'force = ["", "", "grf z"]', 'torque = ["", "", ""]']),
        (("Hip Moment (Nm)", "emg"), ["[joints.hip]", 'torque = "Hip Moment (Nm)"']),
        (("tau1", "tau2"), ["[joints.ankle]", 'torque = "tau1"', "[joints.hip]", 'torque = "tau2"']),
        (("emg", "theta", "temperature_x"), []),
        ((), []),
    ],
)
def test_what_looks_like_a_wrench_or_a_torque_is_suggested(columns, lines):
    sentence, *suggested = suggested_mapping(columns, JOINTS).split("\n")
    assert suggested == lines
    assert all(name in sentence for name in columns)


@pytest.mark.parametrize("sign", [1, -1])
def test_the_largest_time_and_the_largest_number(tmp_path, sign):
    """No clock exceeds 1e12 s, and no channel 1e8 of its SI unit, in any unit."""
    read(tmp_path, retimed(9e11 * sign + 10 * T), 'time = { column = "time", unit = "s" }')
    with pytest.raises(LogError, match=r"row 2, column 'time' needs numbers below 1e\+12"):
        read(tmp_path, retimed(1.1e12 * sign + 10 * T), 'time = { column = "time", unit = "s" }')
    kilo = '[wrenches.ground]\nforce = ["", "", "ground_fz"]\nunit = "kN"'
    for mapping, limit in ((None, 1e8), (kilo, 1e5)):
        force = text(PLAIN | {"ground_fz": 0.9 * sign * limit + T})
        np.testing.assert_allclose(read(tmp_path, force, mapping).wrench("ground").values[0, 2], 0.9e8 * sign)
        with pytest.raises(ValueError, match=r"row 2, column 'ground_fz' needs numbers below"):
            read(tmp_path, text(PLAIN | {"ground_fz": 1.1 * sign * limit + T}), mapping)


def joined(pieces):
    """Pieces, joined."""
    pieces = list(pieces)
    assert all(piece.units == pieces[0].units and piece.unused == pieces[0].unused for piece in pieces)
    channels = [{"time": p.time, **p.measured} | ({} if p.base is None else {"base": p.base}) for p in pieces]
    return {name: np.concatenate([c[name] for c in channels]) for name in channels[0]}


@pytest.mark.parametrize("suffix", ["csv", "npz"])
@pytest.mark.parametrize("samples", [10, 13, 39, 40, 100])
def test_pieces_of_a_log_put_together_are_the_whole(tmp_path, suffix, samples):
    columns, _ = mapped()
    keep = np.sort(np.r_[np.arange(N), 9, 10, 10, 12, 25])
    columns = {name: x[keep] for name, x in columns.items()}
    (tmp_path / "log.csv").write_text(text(columns, ";", ","))
    np.savez(tmp_path / "log.npz", **columns)
    (tmp_path / "c.toml").write_text(MAPPING)
    arguments = tmp_path / f"log.{suffix}", LEG, tmp_path / "c.toml"
    whole, pieces = read_log(*arguments), list(read_log_pieces(*arguments, samples))
    assert len(whole.time) == N and (len(pieces) > 1) == (samples < len(keep))
    for name, x in joined([whole]).items():
        np.testing.assert_allclose(joined(pieces)[name], x, rtol=1e-12, atol=1e-12)
    assert pieces[0].wrench("handle").body == pieces[-1].wrench("handle").body == "torso"
