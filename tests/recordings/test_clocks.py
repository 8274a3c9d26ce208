"""Recordings of channels with times of their own, in one file or several."""

import numpy as np
import pytest
from commands import sentence_of
from guesses.odd_logs import arm, recording, vector
from malformed_logs import PLAIN, N, Q, T, read, text
from written_formats import DEG, write_csv, write_mot

import ident
from ident import LogError, read_log
from ident.geometry import se3
from ident.geometry.se3 import pose
from ident.recordings.times import Sampled, interpolated_poses, side_by_side

FAST = np.arange(0.05, 0.5, 1 / 250)


def slow(time):
    """A channel (N, 3) that linear interpolation follows."""
    return np.outer(time, [1, -2, 3]) + 1


def test_channels_of_several_clocks_meet_at_uniform_times():
    jittered = T + np.random.default_rng(0).uniform(-2e-3, 2e-3, N)
    streams = {"hip_position": (jittered, 3 * jittered), "ground_force": (FAST, slow(FAST))}
    recording = ident.Recording.from_streams(streams, units={"ground_force": "N"})
    assert recording.rate == pytest.approx(100, rel=0.01) and recording.units == {"ground_force": "N"}
    assert (recording.time[0], recording.time[-1]) == (FAST[0], pytest.approx(jittered[-1], abs=0.011))
    np.testing.assert_allclose(np.diff(recording.time), 1 / recording.rate, rtol=1e-9)
    np.testing.assert_allclose(recording["hip_position"], 3 * recording.time)
    np.testing.assert_allclose(recording["ground_force"], slow(recording.time))
    for name, (time, values) in streams.items():
        own = recording.as_measured(name)
        np.testing.assert_array_equal(own.time, time)
        np.testing.assert_array_equal(own.values, values)
        with pytest.raises(ValueError, match="read-only"):
            own.values[0] = 0
    assert len(ident.Recording.from_streams(streams, rate=20).time) == 7
    alone = recording.without_streams
    assert not alone.streams and alone.as_measured("hip_position").time is alone.time


def test_streams_beside_each_other_have_the_times_of_all():
    one, two = Sampled(T[::2], T[::2]), Sampled(T[1:4], slow(T[1:4]))
    time, values = side_by_side([one, two])
    np.testing.assert_array_equal(time, np.unique(np.r_[T[::2], T[1:4]]))
    np.testing.assert_array_equal(values[np.isfinite(values[:, 0]), 0], T[::2])
    np.testing.assert_array_equal(values[1:4, 1:], slow(T[1:4]))
    assert np.isnan(values[[0, 4, 5], 1:]).all() and side_by_side([one, one]).time is one.time


def test_a_log_may_have_gaps_where_that_is_said(tmp_path):
    columns = PLAIN | {"ground_fz": np.where(T < 0.015, np.nan, T)} | {"q_hip": np.where(T == 0.2, np.nan, Q[:, 1])}
    kept = (T < 0.1) | (T > 0.15)
    log = read(tmp_path, text({name: x[kept] for name, x in columns.items()}), gaps=True)
    np.testing.assert_allclose(log.time, T[2:], atol=1e-12)
    own = log.as_measured("hip_position")
    np.testing.assert_allclose(own.time, T[kept], atol=1e-12)
    np.testing.assert_array_equal(own.values, columns["q_hip"][kept])
    assert np.isfinite(log["hip_position"]).all()
    assert [note.split(".")[0] for note in log.notes[1:]] == [
        "Column 'ground_fz' (wrenches",
        "Times in column 'time' have gaps: 1, the longest of 0",
    ]
    cells = read(tmp_path, text(columns), gaps=True)
    assert cells.streams.keys() == {"hip_position", "ground_force"}
    assert not any("jitter" in note for note in (*log.notes, *cells.notes))
    with pytest.raises(LogError, match="at least 10 samples that all columns cover, it has 5"):
        read(tmp_path, text(columns | {"ground_fz": np.where(T < 0.345, np.nan, T)}), gaps=True)


def angles():
    """Columns of the file of angles, at 100 Hz."""
    r = recording()
    return {"time": r.time, "joint1": r["joint1_position"], "joint2": r["joint2_position"]}


def forces():
    """Columns of the file of forces, at their own rate."""
    r = recording()
    columns = {"time": r.time, **vector("ground_f{}", r["ground_force"]), **vector("ground_m{}", r["ground_torque"])}
    return {name: x[1::2] for name, x in columns.items()}


def pair(tmp_path, first=None, second=None):
    """Writes both files, and returns their log."""
    write_csv(tmp_path / "joints.csv", first or angles())
    write_csv(tmp_path / "wrench.csv", second or forces())
    return f"{tmp_path / 'joints.csv'}+{tmp_path / 'wrench.csv'}"


@pytest.mark.extras
def test_the_order_of_the_files_and_their_formats_do_not_matter(tmp_path):
    expected = read_log(pair(tmp_path), arm())
    write_mot(tmp_path / "ik.mot", {name: x * (1 if name == "time" else DEG) for name, x in angles().items()})
    for first, second in (("wrench.csv", "joints.csv"), ("ik.mot", "wrench.csv"), ("wrench.csv", "ik.mot")):
        read = read_log(f"{tmp_path / first}+{tmp_path / second}", arm())
        assert read.streams.keys() == expected.streams.keys()
        for channel, x in expected.measured.items():
            np.testing.assert_allclose(read[channel], x, atol=1e-12)


@pytest.mark.extras
def test_common_times_are_those_of_the_fastest_joint(tmp_path):
    first, second = ({name: x for name, x in angles().items() if name != own} for own in ("joint2", "joint1"))
    log = read_log(pair(tmp_path, first, {name: x[::2] for name, x in second.items()}), arm())
    assert log.rate == pytest.approx(100) and log.streams.keys() == {"joint1_position", "joint2_position"}


PLATE = 'frame = "plate"\nposition = [0, 0, 0]\nforce = ["ground_fx", "ground_fy", "ground_fz"]\n'
FREE = 'point = ["x", 0.0, 0.0]\nfree_moment = ["", "", "ground_mz"]'
TIME = angles()["time"]
CONTRADICTIONS = [
    ({}, {"time": TIME[1::2] + 1.7e9}, "", "clock, but they begin on different days"),
    ({}, {"time": TIME[1::2] + 60}, "", "need a time that all of them cover"),
    ({}, {"joint2": TIME[1::2]}, "", "joint 'joint2' needs a column of its positions"),
    ({}, {"t": TIME[1::2]}, "", "wrench.csv: it needs one column of times, time or t"),
    ({}, {}, 'time = ["t", "t", "t"]', "describes 3 files (time), but this log has 2"),
    ({}, {}, 3 * "[[file]]\n", "describes 3 files ([[file]]), but this log has 2"),
    ({}, {}, 'time = "stamp"', "joints.csv: it needs times in a column 'stamp'"),
    ({}, {}, "time = []", "time needs the column of times of each file"),
    ({}, {}, "[select]\nrows = [1, 50]", "[select] rows are those of one table"),
    (
        {"Fx": TIME},
        {},
        '[wrenches.ground]\nforce = ["Fx", "", "ground_fz"]',
        "'Fx' and 'ground_fz' have times",
    ),
    ({"x": TIME}, {}, f"[wrenches.ground]\n{PLATE}{FREE}", "columns of the same times, its point has its own"),
]


@pytest.mark.extras
@pytest.mark.parametrize(("first", "second", "mapping", "sentence"), CONTRADICTIONS, ids=[x[3] for x in CONTRADICTIONS])
def test_what_contradicts_itself_ends_with_a_sentence(tmp_path, first, second, mapping, sentence):
    (tmp_path / "columns.toml").write_text(mapping, encoding="utf-8")
    log = pair(tmp_path, angles() | first, forces() | second)
    assert sentence in sentence_of(read_log, log, arm(), tmp_path / "columns.toml")


@pytest.mark.extras
def test_files_that_cannot_be_put_together(tmp_path):
    joints, _ = pair(tmp_path).split("+")
    for name, columns, sentence in (
        (f"{joints}+{joints}", None, "is made of different files, but joints.csv is given twice"),
        (f"{joints}+{tmp_path / 'none.csv'}", None, "none.csv: there is no such file"),
        (f"{joints}+", None, "joints.csv+: there is no such file"),
        (f"{joints}+{tmp_path / 'run.bag'}", None, "a bag counts its times from its first message"),
        (joints, {"file": [{}, {}]}, "describes 2 files ([[file]]), but this log has 1"),
        (joints, {"time": ["time", "time"]}, "describes 2 files (time), but this log has 1"),
    ):
        assert sentence in sentence_of(read_log, name, arm(), columns)


def test_poses_between_samples_turn_at_a_constant_rate_and_stay_at_the_ends():
    own, time = np.array([1.0, 2.0, 4.0]), np.array([0.0, 1.5, 3.0, 5.0])
    poses = pose(se3.exp(np.eye(6)[5], 0.4 * own)[:, :3, :3], np.outer(own, [1, 2, 3]))
    T = interpolated_poses(Sampled(own, poses.reshape(3, 16)), time)
    inside = np.clip(time, 1, 4)
    np.testing.assert_allclose(T[:, :3, :3], se3.exp(np.eye(6)[5], 0.4 * inside)[:, :3, :3], atol=1e-12)
    np.testing.assert_allclose(T[:, :3, 3], np.outer(inside, [1, 2, 3]), atol=1e-12)
