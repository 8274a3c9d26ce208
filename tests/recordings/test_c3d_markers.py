"""Markers of C3D files, against what ezc3d writes."""

import sys

import numpy as np
import pytest

from ident.errors import LogError
from ident.recordings.marker_files import read_markers


def test_without_the_extra_a_sentence_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "ezc3d", None)
    (tmp_path / "a.c3d").write_bytes(b"")
    with pytest.raises(LogError, match=r"needs the extra 'c3d': pip install multicontact\[c3d\]"):
        read_markers(tmp_path / "a.c3d")


def test_markers_are_read(tmp_path):
    ezc3d = pytest.importorskip("ezc3d", reason="needs the extra 'c3d'")
    x = np.random.default_rng(0).normal(size=(5, 2, 3)).astype(np.float32)
    x[3, 1] = np.nan
    file = ezc3d.c3d()
    file["parameters"]["POINT"]["RATE"]["value"] = [50]
    file["parameters"]["POINT"]["LABELS"]["value"] = ["KNEE", "HIP"]
    file["parameters"]["POINT"]["UNITS"]["value"] = ["mm"]
    file["data"]["points"] = np.concatenate([1e3 * x.transpose(2, 1, 0), np.ones((1, 2, 5))])
    file.write(str(tmp_path / "a.c3d"))
    found = read_markers(tmp_path / "a.c3d")
    assert found.labels == ("KNEE", "HIP")
    np.testing.assert_allclose(found.positions, x, rtol=1e-6)
    np.testing.assert_allclose(np.diff(found.time), 0.02)


def test_damaged_files_are_refused(tmp_path):
    pytest.importorskip("ezc3d", reason="needs the extra 'c3d'")
    (tmp_path / "a.c3d").write_bytes(b"\x02\x50" + 600 * b"\x00")
    with pytest.raises(LogError, match=r"ezc3d cannot read|POINT"):
        read_markers(tmp_path / "a.c3d")
