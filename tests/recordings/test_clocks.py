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
R = recording()
ANGLES = {"time": R.time, "joint1": R["joint1_position"], "joint2": R["joint2_position"]}
FORCES = {"time": R.time} | vector("ground_f{}", R["ground_force"]) | vector("ground_m{}", R["ground_torque"])
FORCES = {name: x[1::2] for name, x in FORCES.items()}
PLATE = {"frame": "plate", "position": [0, 0, 0], "force": ["ground_fx", "ground_fy", "ground_fz"]}
FREE = {"point": ["x", 0.0, 0.0], "free_moment": ["", "", "ground_mz"]}


def slow(time):
    """A channel (N, 3) that linear interpolation follows."""
    return np.outer(time, [1, -2, 3]) + 1


def test_channels_of_several_clocks_meet_at_uniform_times():
    jittered = T + np.random.default_rng(0).uniform(-2e-3, 2e-3, N)
    streams = {"hip_position": (jittered, 3 * jittered), "ground_force": (FAST, slow(FAST))}
    streams["knee_position"] = T[::2], np.sin(T[::2])  # The fastest joint's rate is that of all.
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
    one, two = Sampled(T[:6:2], T[:6:2]), Sampled(T[1:4], slow(T[1:4]))
    time, values = side_by_side([one, two])
    np.testing.assert_array_equal(time, T[:5])
    np.testing.assert_array_equal(values[:, 0], np.where(np.arange(5) % 2, np.nan, T[:5]))
    np.testing.assert_array_equal(values[:, 1:], np.vstack([[np.nan] * 3, slow(T[1:4]), [np.nan] * 3]))
    assert side_by_side([one, one]).time is one.time


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


@pytest.fixture
def pair(tmp_path):
    """A function that writes a file of angles at 100 Hz and one of forces at 50 Hz, and returns their log."""

    def write(angles=ANGLES, forces=FORCES):
        return "+".join(str(write_csv(tmp_path / f"{name}.csv", x)) for name, x in (("q", angles), ("f", forces)))

    return write


@pytest.mark.extras
def test_the_order_of_the_files_and_their_formats_do_not_matter(tmp_path, pair):
    expected = read_log(pair(), arm())
    write_mot(tmp_path / "ik.mot", {name: x * (1 if name == "time" else DEG) for name, x in ANGLES.items()})
    for first, second in (("f.csv", "q.csv"), ("ik.mot", "f.csv"), ("f.csv", "ik.mot")):
        read = read_log(f"{tmp_path / first}+{tmp_path / second}", arm())
        assert read.streams.keys() == expected.streams.keys()
        for channel, x in expected.measured.items():
            np.testing.assert_allclose(read[channel], x, atol=1e-12)


@pytest.mark.extras
def test_common_times_are_those_of_the_fastest_joint(pair):
    first, second = ({name: x for name, x in ANGLES.items() if name != own} for own in ("joint2", "joint1"))
    log = read_log(pair(first, {name: x[::2] for name, x in second.items()}), arm())
    assert log.rate == pytest.approx(100) and log.streams.keys() == {"joint1_position", "joint2_position"}


@pytest.mark.extras
def test_files_that_contradict_each_other_are_one_sentence(pair):
    for more, more_forces, mapping, sentence in (
        ({}, {"time": FORCES["time"] + 1.7e9}, {}, "clock, but they begin on different days"),
        ({}, {"time": FORCES["time"] + 60}, {}, "need a time that all of them cover"),
        ({}, {"joint2": FORCES["time"]}, {}, "joint 'joint2' needs a column of its positions"),
        ({}, {"t": FORCES["time"]}, {}, "f.csv: it needs one column of times, time or t"),
        ({}, {}, {"time": ["t", "t", "t"]}, "describes 3 files (time), but this log has 2"),
        ({}, {}, {"time": "stamp"}, "q.csv: it needs times in a column 'stamp'"),
        ({}, {}, {"time": []}, "time needs the column of times of each file"),
        ({}, {}, {"select": {"rows": [1, 50]}}, "[select] rows are those of one table"),
        ({"x": R.time}, {}, {"wrenches": {"ground": {"force": ["x", "", "ground_fz"]}}}, "'ground_fz' have times"),
        ({"x": R.time}, {}, {"wrenches": {"ground": PLATE | FREE}}, "of the same times, its point has its own"),
    ):
        assert sentence in sentence_of(read_log, pair(ANGLES | more, FORCES | more_forces), arm(), mapping)


@pytest.mark.extras
def test_files_that_cannot_be_put_together(tmp_path, pair):
    joints, _ = pair().split("+")
    for name, columns, sentence in (
        (f"{joints}+{joints}", None, "is made of different files, but q.csv is given twice"),
        (f"{joints}+{tmp_path / 'none.csv'}", None, "none.csv: there is no such file"),
        (f"{joints}+", None, "q.csv+: there is no such file"),
        (f"{joints}+{tmp_path / 'run.bag'}", None, "a bag counts its times from its first message"),
        (joints, {"file": [{}, {}]}, "describes 2 files ([[file]]), but this log has 1"),
    ):
        assert sentence in sentence_of(read_log, name, arm(), columns)


def test_poses_between_samples_turn_at_a_constant_rate_and_stay_at_the_ends():
    own, time = np.array([1.0, 2.0, 4.0]), np.array([0.0, 1.5, 3.0, 5.0])
    poses = pose(se3.exp(np.eye(6)[5], 0.4 * own)[:, :3, :3], np.outer(own, [1, 2, 3]))
    T = interpolated_poses(Sampled(own, poses.reshape(3, 16)), time)
    inside = np.clip(time, 1, 4)
    np.testing.assert_allclose(T[:, :3, :3], se3.exp(np.eye(6)[5], 0.4 * inside)[:, :3, :3], atol=1e-12)
    np.testing.assert_allclose(T[:, :3, 3], np.outer(inside, [1, 2, 3]), atol=1e-12)
