import numpy as np
import pytest
from scipy import ndimage

from ident.recordings import runs as module
from ident.recordings.runs import running_median, runs


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
