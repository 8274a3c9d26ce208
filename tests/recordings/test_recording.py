"""Recordings in files, read whole and piece by piece."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from commands import sentence_of
from hypothesis import given, settings
from hypothesis import strategies as st
from same_recording import assert_same_recording

from ident import Body, LogError, Mechanism, Recording, Sensor, Tree, read_log
from ident.geometry import se3
from ident.mechanism.body import Follower
from ident.recordings.stated import Servo, Tracker

RNG = np.random.default_rng(0)
CHANNELS = {
    "elbow_position": RNG.normal(size=20),
    "elbow_velocity": RNG.normal(size=20) * 1e-17,
    "elbow_acceleration": RNG.normal(size=20) * 1e300,
    "arm_orientation": RNG.normal(size=(20, 4)),
    'i;"m\tu': RNG.normal(size=20),
    "imu": RNG.normal(size=(20, 6)),
    "plate_force": RNG.normal(size=(20, 3)) * [1, np.nan, 1],
    "plate_torque": RNG.normal(size=(20, 3)),
}
LINKS = (("upper", "shoulder"), ("fore", "elbow"), ("hand", "wrist"))
SCREW = np.array([0.1, 0.2, 0.3, 0, 0.6, 0.8])
PLATE = Sensor("arm", se3.exp(SCREW, 0.7), applied_to_link=False)
STATED = {
    "setup": {"gain": 0.0, "delay": 0.02},
    "known": {"mass": 0.1},
    "known_bodies": {"fore": {"center": 0.2}},
    "held": True,
    "base_rpy_deg": (0.0, 10.0, 0.0),
    "loaded": "fore",
    "still": True,
    "scales": {"elbow": 0.1},
    "couplings": {"motor": {"shoulder": 1.0, "elbow": 0.5}},
    "followers": {"wrist": Follower("elbow", (0.0, 2.0), (-1.0, 1.5))},
    "servos": {"shoulder": Servo(50.0, 1.0)},
    "provenance": {"scene": 'arm, and "more"', "seed": 3, "nested": {"a": [1, 2.5, None]}},
}
UNITS, NOISE = {"plate_force": "N", "elbow_position": "rad"}, {"plate_force": 0.1, "elbow_position": 0.01}
MORE = {"units": UNITS, "noise": NOISE, "notes": ["one", "two, three"], "unused": ["remark"]}
TRUE = {name: x + 1 for name, x in CHANNELS.items()}
BASE = se3.exp(SCREW, RNG.normal(size=20))
RECORDING = Recording(np.arange(20) / 3, CHANNELS, TRUE, sensors={"plate": PLATE}, base=BASE, **STATED, **MORE)


@pytest.mark.parametrize("suffix", ["npz", "csv"])
def test_saving_and_loading_lose_nothing(tmp_path, suffix):
    for recording in (RECORDING, Recording(RECORDING.time, CHANNELS)):
        recording.save(tmp_path / f"r.{suffix}")
        assert_same_recording(Recording.load(tmp_path / f"r.{suffix}"), recording)
        assert [p.name for p in tmp_path.iterdir()] == [f"r.{suffix}"]


@pytest.mark.parametrize("suffix", ["npz", "csv"])
def test_a_saved_recording_is_read_as_a_log_with_what_it_states(tmp_path, suffix):
    bodies = [Body(name, k - 1, np.eye(4), np.eye(6)[4], joint) for k, (name, joint) in enumerate(LINKS)]
    arm, path = Mechanism(Tree(tuple(bodies)), np.array([0, 0, -9.81])), tmp_path / f"r.{suffix}"
    x = np.linspace(0, 1, 50)
    measured = {"shoulder_position": x, "elbow_position": x**2, "elbow_torque": x, "shoulder_command": x + 0.01}
    measured |= {"hand_position": np.zeros((50, 3)), "hand_orientation": np.tile(np.eye(4)[0], (50, 1))}
    base, trackers = np.tile(se3.exp(SCREW, 0.7), (50, 1, 1)), {"hand": Tracker("hand")}
    Recording(np.arange(50.0), measured, measured, **STATED, base=base, trackers=trackers).save(path)
    log = read_log(path, arm)
    assert {name: getattr(log, name) for name in STATED} == STATED
    np.testing.assert_array_equal(log.base, base)
    assert log.trackers["hand"].body == "hand" and {*log.measured} == {*measured} and not log.unused
    stated = read_log(path, arm, {"setup": {"gain": 0.01, "lag": 0.0}, "base": {"rpy_deg": [0, 0, 0]}})
    assert stated.setup == {"gain": 0.01, "delay": 0.02, "lag": 0.0}
    assert stated.base_rpy_deg == (0, 0, 0) and stated.held


def test_missing_channels_are_named_with_those_there_are():
    with pytest.raises(LogError, match="'knee_position'; it has arm_orientation, elbow_acceleration"):
        RECORDING.joint_states(["knee"])
    wrench = {"plate_force": [[1.0, 2, 3]], "plate_torque": [[1.0, 2, 3]]}
    with pytest.raises(LogError, match=r"'plate' needs to be known by .* \(`with_sensors`\); known are ground, grip"):
        Recording([0.0], wrench).with_sensors({"grip": PLATE}).wrench("plate")


def test_a_recording_keeps_copies_of_mappings_and_channels():
    given = {name: {} for name in ("units", "noise", "provenance", "sensors", "true")}
    recording = Recording([0.0, 1], measured := {"a": np.zeros(2)}, **given)
    measured["b"] = np.zeros(2)
    for name, mapping in given.items():
        mapping["a"] = 1.0
        assert not getattr(recording, name), name
    assert list(recording.measured) == ["a"]


ROWS = "time,a\n" + "".join(f"{k},{k}\n" for k in range(9))
LATE = [
    ("9,oops", "row 11, column 'a' needs a number, got 'oops'"),
    ("9,inf", "row 11, column 'a' needs a finite number, got inf"),
    ("9", "row 11 has 1 cells where the header has 2"),
    ("8,1", "row 11, column 'time' needs to increase"),
]
FAULTS = [
    ("a,b\n1,2\n", "needs a column 'time'; the file has a, b"),
    ("time,a.x,a.z\n0,1,2\n", "channel 'a' needs the components 0, 1, it has x, z"),
    ("time,a\n", "a recording needs samples, it has none"),
    ("# units: {oops\ntime\n0\n", "row 1 needs 'units' in JSON"),
    ('# sensors: {"a": {"body": 3}}\ntime\n0\n', "sensors.a.body needs a text, got 3"),
    ("base:pose.0,base:pose.1,time\n1,2,3\n", r"A moving base needs poses \(1, 4, 4\), got \(1, 2\)"),
    ("time,true:a\n0,1\n", "True values need the same channels"),
]


@pytest.mark.parametrize(("text", "message"), FAULTS)
def test_bad_files_name_the_place(tmp_path, text, message):
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(LogError, match=f"bad.csv.*{message}"):
        Recording.load(tmp_path / "bad.csv")


@pytest.mark.parametrize(("row", "message"), LATE)
@pytest.mark.parametrize("samples", [1, 100])
def test_a_late_fault_is_found_when_its_piece_is_due(tmp_path, row, message, samples):
    (tmp_path / "r.csv").write_text(f"{ROWS}{row}\n20,20")
    pieces = Recording.chunks(tmp_path / "r.csv", samples)
    for _ in range(9 // samples):
        next(pieces)
    assert f"r.csv: {message}" in sentence_of(next, pieces)


def test_files_that_are_no_recordings(tmp_path):
    (tmp_path / "r.npz").write_text("not a zip")
    for name in ("r.npz", "missing.csv", "r.mat"):
        assert name in sentence_of(Recording.load, tmp_path / name)
    assert "as .npz or .csv, got 'r.mat'" in sentence_of(RECORDING.save, tmp_path / "r.mat")
    for more, message in (
        ({}, "a recording needs a column 'time'; the file has a."),
        ({"time": np.arange(4.0)}, "arrays need the same number of samples, 'time' has 4 and 'meas"),
    ):
        np.savez(tmp_path / "r.npz", metadata="{}", **{"measured/a": np.ones(5)}, **more)
        assert f"r.npz: {message}" in sentence_of(Recording.load, tmp_path / "r.npz")


@pytest.mark.parametrize("name", ["time", "a,b", "a.b", "true:a", "base:a", "#a", " a", "a\n", "", "12"])
def test_names_that_a_file_could_not_hold_are_refused(name):
    with pytest.raises(ValueError, match="name cannot be"):
        Recording([0.0], {name: [1.0]}).save("r.csv")


@pytest.mark.parametrize("odd", ["1", "\u0661", " 7 "])
def test_a_cell_is_the_number_that_python_reads(tmp_path, odd):
    cells = ["1", "-0.0", "1e-400", "5e-324", "0.1", "1.7976931348623157e308", "9007199254740993", odd]
    rows = [f"{k},{cell}\n" for k, cell in enumerate(cells)]
    (tmp_path / "r.csv").write_text(f"time,a\n{''.join(rows)}", encoding="utf-8")
    assert Recording.load(tmp_path / "r.csv")["a"].tobytes() == np.array(list(map(float, cells))).tobytes()


def random_recording(samples, with_truth=False, seed=0):
    rng = np.random.default_rng(seed)
    scale, shapes = 10.0 ** rng.integers(-300, 300, samples), {"a": (), "force": (3,), "imu": (6,)}
    measured = {name: (rng.normal(size=(samples, *shape)).T * scale).T for name, shape in shapes.items()}
    true = {name: -x for name, x in measured.items()} if with_truth else {}
    return Recording(np.cumsum(rng.uniform(0.1, 1, samples)), measured, true, units={"a": "rad"}, noise={"a": 0.1})


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 30), st.integers(1, 40), st.sampled_from(["csv", "npz"]), st.booleans(), st.integers(0, 2**32))
def test_pieces_put_together_are_the_whole(tmp_path_factory, length, samples, suffix, with_truth, seed):
    path = tmp_path_factory.getbasetemp() / f"whole.{suffix}"
    original = random_recording(length, with_truth, seed)
    original.save(path)
    pieces = list(Recording.chunks(path, samples))
    assert [len(p.time) for p in pieces] == [min(samples, length - k) for k in range(0, length, samples)]
    measured, true = (
        {name: np.concatenate([getattr(piece, kind)[name] for piece in pieces]) for name in getattr(original, kind)}
        for kind in ("measured", "true")
    )
    whole = replace(pieces[0], time=np.concatenate([piece.time for piece in pieces]), measured=measured, true=true)
    for read in (whole, Recording.load(path)):
        assert_same_recording(read, original)


def test_memory_does_not_grow_with_the_text(tmp_path):
    peaks, path = [], tmp_path / "r.csv"
    for length in (500, 1_500, 3_000):
        random_recording(length).save(path)
        tracemalloc.start()
        assert sum(len(piece.time) for piece in Recording.chunks(path, 250)) == length
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[2] < 1.1 * peaks[1] and peaks[2] < path.stat().st_size / 2
