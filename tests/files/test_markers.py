"""Files of markers: written files are read, and damaged ones give one sentence."""

import numpy as np
import pytest
from written_formats import write_c3d

from ident.errors import LogError
from ident.files.readers import read_markers

pytestmark = pytest.mark.extras

TIME = np.arange(4) / 100
LABELS = ("KNEE", "HIP")
X = np.random.default_rng(0).normal(size=(4, 2, 3))
X[2, 1] = np.nan


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("t,A.x,A.y,A.z\n0,1,2,3\n", "markers need a column 'time'"),
        ("time,A.x,A.y\n0,1,2\n", "marker 'A' lacks the column 'A.z'"),
        ("time,A\n0,1\n", "need columns LABEL.x, LABEL.y and LABEL.z"),
        ("time,A.w\n0,1\n", "need columns LABEL.x, LABEL.y and LABEL.z"),
        ("time,A.x,A.y,A.z\n0,1,,3\n1,1,2,3\n", "frame 1: marker 'A' has some of x, y and z only"),
        ("time,A.x,A.y,A.z\n1,1,2,3\n0,1,2,3\n", "times of frames must be finite and increase; frame 2"),
        ("time,A.x,A.y,A.z\n", "needs frames, it has none"),
        ("time,A.x,A.y,A.z\n0,1,1e30,3\n", "frame 1: marker 'A' needs positions below"),
    ],
)
def test_damaged_tables_are_refused(tmp_path, text, expected):
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(LogError, match=expected):
        read_markers(tmp_path / "a.csv")


def test_markers_of_c3d_files_are_read(tmp_path):
    pytest.importorskip("ezc3d", reason="ezc3d is in the extra 'c3d'")
    write_c3d(tmp_path / "a.c3d", 50.0, dict(zip(LABELS, X.swapaxes(0, 1), strict=True)), angles=("HIP",))
    markers = read_markers(tmp_path / "a.c3d")
    assert markers.labels == ("KNEE",)
    np.testing.assert_allclose(markers.positions[:, 0], X[:, 0], atol=1e-6)
    np.testing.assert_allclose(markers.time, np.arange(4) / 50)
    write_c3d(tmp_path / "b.c3d", 50.0, {"HIP": X[:, 1]}, angles=("HIP",))
    with pytest.raises(LogError, match="0 markers in 4 frames need positions"):
        read_markers(tmp_path / "b.c3d")
