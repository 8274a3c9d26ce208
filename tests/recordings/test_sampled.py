"""Recordings of channels with times of their own."""

import numpy as np
import pytest
from malformed_logs import PLAIN, N, Q, T, text
from test_log import read

import ident
from ident.errors import LogError
from ident.recordings.sampled import Sampled, side_by_side

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


@pytest.mark.parametrize(
    ("streams", "options", "message"),
    [
        (
            {"a": (T, T[1:])},
            {},
            r"needs times \(N,\) and values \(N,\) or \(N, d\), got \(40,\) and \(39,\)",
        ),
        ({"a": (T[:0], T[:0])}, {}, "stream 'a' needs times"),
        ({"a": T}, {}, "stream 'a' needs a pair of times and values"),
        ({"a": (T, ["x"] * N)}, {}, "stream 'a' needs a pair of times and values"),
        ({"a": (T[::-1], T)}, {}, "times of the stream 'a' must increase; sample 1 does not"),
        ({"a": (np.where(T > 0.2, np.nan, T), T)}, {}, "times of the stream 'a' need finite numbers"),
        ({"a": (T, np.where(T > 0.2, np.inf, T))}, {}, "stream 'a' needs numbers, NaN for a missing one"),
        (
            {"base:pose": (T, slow(T))},
            {},
            r"stream 'base:pose' needs rigid poses \(N, 16\), .* got shape \(40, 3\)",
        ),
        ({"base:pose": (T, np.ones((N, 16)))}, {}, "needs rigid poses"),
        ({"a": (T, T)}, {}, "Streams without joint positions need a rate"),
        ({"a": (T, T)}, {"rate": -1.0}, r"need a positive rate in Hz .*, got -1\.0"),
        ({"a": (T, T * np.nan)}, {"rate": 10.0}, "Streams need samples"),
        (
            {"a_position": (T, T), "b": (T + 1, T)},
            {},
            r"Streams need a time that all of them cover; 'b' begins at 1 s and 'a_position' ends at 0.39 s",
        ),
    ],
)
def test_bad_streams_are_one_sentence(streams, options, message):
    with pytest.raises(LogError, match=message) as error:
        ident.Recording.from_streams(streams, **options)
    assert "\n" not in str(error.value)


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
