import numpy as np
import pytest
from scipy import ndimage

from ident.recordings import faults as module
from ident.recordings.faults import INTERPOLATED, covered, longest_step, running_median, runs, stretches
from ident.recordings.recording import Recording
from ident.recordings.sampled import Sampled


@pytest.mark.parametrize("pattern", ["0", "1", "000", "111", "1010", "0110", "1101", "0011101"])
def test_runs_are_those_of_scipy(pattern):
    mask = np.array([c == "1" for c in pattern], bool)
    labels, number = ndimage.label(mask)
    expected = [[span.start, span.stop] for (span,) in ndimage.find_objects(labels, number)]
    assert runs(mask).tolist() == expected


@pytest.mark.parametrize("size", [1, 4, 57])
@pytest.mark.parametrize("width", [1, 2, 5, 10, 11])
def test_running_medians_are_those_of_scipy(size, width, monkeypatch):
    # Several blocks of windows, the last of which is shorter.
    monkeypatch.setattr(module, "AT_ONCE", 7 * width)
    x = np.random.default_rng(size + width).normal(size=size)
    expected = ndimage.median_filter(x, width, mode="nearest")
    np.testing.assert_array_equal(running_median(x, width), expected)
    some = np.flatnonzero(x > 0)
    np.testing.assert_array_equal(running_median(x, width, some), expected[some])


def recorded(*gaps, rate=100.0, plate=100.0):
    """Angles without samples in some spans, and a plate's wrench with one component missing."""
    clocks = {"hip_position": np.arange(0, 10, 1 / rate), "ground_force": np.arange(0, 10, 1 / plate)}
    streams = {"hip_position": (t := clocks["hip_position"], np.sin(t))}
    streams["ground_force"] = (t := clocks["ground_force"], np.stack([t, np.full_like(t, np.nan), t], axis=1))
    for first, last in gaps:
        time, x = streams["hip_position"]
        kept = (time <= first) | (time >= last)
        streams["hip_position"] = time[kept], x[kept]
    return Recording.from_streams(streams, rate=100.0)


def test_a_slow_stream_has_no_gaps_between_its_samples():
    recording = recorded(plate=8.0)
    assert covered(recording, ("ground_force",)).all()
    assert longest_step(recording.streams["ground_force"]) == 0.25
    assert longest_step(Sampled(np.zeros(1), np.zeros(1))) == INTERPOLATED


def test_stretches_end_at_gaps_and_where_times_jump():
    time = np.r_[np.arange(10), np.arange(20, 30)] / 100
    assert stretches(time, np.ones(20, bool)) == [slice(0, 10), slice(10, 20)]
    inside = np.ones(20, bool)
    inside[[0, 4, 5]] = False
    assert stretches(time, inside) == [slice(1, 4), slice(6, 10), slice(10, 20)]
    assert stretches(time, np.zeros(20, bool)) == []
