"""Files of markers: written files are read, and damaged ones give one sentence."""

import numpy as np
import pytest
from commands import refusal
from marked import trc
from written_formats import write_c3d

from experiments.angles import main
from ident.errors import LogError
from ident.files.readers import read_markers

pytestmark = pytest.mark.extras

TIME = np.arange(4) / 100
LABELS = ("KNEE", "HIP")
X = np.random.default_rng(0).normal(size=(4, 2, 3))
X[2, 1] = np.nan
TEXT = trc(TIME, LABELS, X)


@pytest.mark.parametrize(("unit", "factor"), [("mm", 1e3), ("m", 1.0), ("cm", 100.0)])
def test_trc_files_are_read(tmp_path, unit, factor):
    (tmp_path / "a.trc").write_text(trc(TIME, LABELS, X, unit, factor))
    markers = read_markers(tmp_path / "a.trc")
    assert markers.labels == LABELS
    np.testing.assert_allclose(markers.positions, X, rtol=1e-14)
    np.testing.assert_array_equal(markers.time, TIME)
    np.testing.assert_array_equal(markers.visible, np.isfinite(X[..., 0]))


def damaged(row, old, new):
    lines = TEXT.split("\n")
    assert old in lines[row - 1]
    lines[row - 1] = lines[row - 1].replace(old, new, 1)
    return "\n".join(lines)


DAMAGED = {
    "empty": ("", "begins with PathFileType, and has four more rows"),
    "cut off": ("\n".join(TEXT.split("\n")[:-2]), "promises 4 as NumFrames, the file has 3"),
    "no count": (damaged(3, "\t2\t", "\ttwo\t"), "promises two as NumMarkers, the file has 2"),
    "no frames": (damaged(4, "Frame#", "Image"), "row 4 .* begins with Frame# and Time, got 'Image'"),
    "infinite": (damaged(8, "0.01\t", "0.01\tinf\t").replace("\tinf\t", "\tinf", 1), "row 8 needs finite numbers"),
    "half a marker": (damaged(9, "\t\t", "\t3.5\t"), "frame 3: marker 'HIP' has some of x, y and z only"),
    "back in time": (damaged(9, "0.02", "0.005"), "times of frames must be finite and increase; frame 3 does not"),
    "far away": (trc(TIME, LABELS, np.where(np.isnan(X), 1e30, X)), "frame 3: marker 'HIP' needs positions below"),
    "binary": (b"PathFileType\xff\xfe", "needs to be text in UTF-8, a byte 0xff is not"),
}


@pytest.mark.parametrize("name", DAMAGED)
def test_damaged_trc_files_are_refused_in_a_sentence(tmp_path, capsys, name):
    content, expected = DAMAGED[name]
    path = tmp_path / "damaged.trc"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(LogError, match=expected):
        read_markers(path)
    (tmp_path / "m.xml").write_text("<mujoco><worldbody/></mujoco>")
    message = refusal(main, [str(tmp_path / "m.xml"), str(path), "--out", str(tmp_path / "out")], capsys)
    assert message.count("\n") == 1 and str(path) in message and not (tmp_path / "out").exists()


def table(text, tmp_path):
    (tmp_path / "a.csv").write_text(text)
    return tmp_path / "a.csv"


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
    ],
)
def test_damaged_tables_are_refused(tmp_path, text, expected):
    with pytest.raises(LogError, match=expected):
        read_markers(table(text, tmp_path))


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
