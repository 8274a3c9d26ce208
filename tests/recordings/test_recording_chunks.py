"""Recordings read piece by piece: equal to whole ones, in little memory, and with the same checks."""

import io
import tracemalloc
import zipfile

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ident.errors import LogError
from ident.recordings.recording import Recording

METADATA = {"units": {"a": "rad"}, "noise": {"a": 0.1}, "provenance": {"seed": 3, "nested": [1, None]}}


def recording(samples, with_truth=False, seed=0):
    rng = np.random.default_rng(seed)
    shapes = {"a": (samples,), "force": (samples, 3), "pose": (samples, 4), "imu": (samples, 6)}
    scale = 10.0 ** rng.integers(-300, 300, samples)
    measured = {name: (rng.normal(size=shape).T * scale).T for name, shape in shapes.items()}
    true = {name: -x for name, x in measured.items()} if with_truth else {}
    return Recording(np.cumsum(rng.uniform(0.1, 1, samples)), measured, true, **METADATA)


def channels(pieces):
    """All channels of the pieces, joined."""
    kinds = [{"time": p.time, **p.measured, **{f"true:{k}": x for k, x in p.true.items()}} for p in pieces]
    assert len({tuple(kind) for kind in kinds}) == 1
    return {name: np.concatenate([kind[name] for kind in kinds]) for name in kinds[0]}


@settings(max_examples=30, deadline=None)
@given(
    st.integers(1, 30), st.integers(1, 40), st.sampled_from(["csv", "npz"]), st.booleans(), st.integers(0, 2**32 - 1)
)
def test_pieces_put_together_are_the_whole(tmp_path_factory, length, samples, suffix, with_truth, seed):
    path = tmp_path_factory.getbasetemp() / f"whole.{suffix}"
    original = recording(length, with_truth, seed)
    original.save(path)
    pieces, whole = list(Recording.chunks(path, samples)), Recording.load(path)
    assert [len(p.time) for p in pieces] == [min(samples, length - k) for k in range(0, length, samples)]
    expected = channels([original])
    for read in (channels(pieces), channels([whole])):
        assert list(read) == list(expected)
        assert all(read[name].tobytes() == x.tobytes() for name, x in expected.items())
    for piece in pieces:
        assert {name: getattr(piece, name) for name in METADATA} == METADATA


def archive(path, metadata="{}", compression=zipfile.ZIP_STORED, **members):
    """An npz file of arrays, or of bytes for malformed members; double underscores stand for slashes."""
    with zipfile.ZipFile(path, "w", compression) as out:
        for name, content in {"metadata": np.array(metadata), **members}.items():
            stream = io.BytesIO()
            if isinstance(content, bytes):
                stream.write(content)
            else:
                np.lib.format.write_array(stream, content)
            out.writestr(f"{name.replace('__', '/')}.npy", stream.getvalue())
    return path


NPY = io.BytesIO()
np.lib.format.write_array(NPY, np.arange(5.0))


@pytest.mark.parametrize(
    ("member", "message"),
    [
        (np.array([None] * 5), "needs real numbers in one or two dimensions, it holds object"),
        (np.ones(5, complex), "holds complex128"),
        (np.array(["1"] * 5), "holds <U1"),
        (np.ones((5, 1, 1)), r"one or two dimensions, it holds float64 \(5, 1, 1\)"),
        (np.array(1.0), r"one or two dimensions, it holds float64 \(\)"),
        (NPY.getvalue()[:-8], r"array of \(5,\) float64 has another size than its 32 bytes"),
        (NPY.getvalue() + b"more", r"array of \(5,\) float64 has another size than its 44 bytes"),
        (NPY.getvalue()[:40], "reading array header"),
        (NPY.getvalue().replace(b"(5,)", b"(5,("), "Cannot parse header|EOF in multi-line"),
        (NPY.getvalue().replace(b"NUMPY\x01", b"NUMPY\x03"), "header of version 1 or 2, it has version 3"),
        (b"", "magic string"),
    ],
)
def test_a_member_that_is_no_channel_is_named(tmp_path, member, message):
    path = archive(tmp_path / "r.npz", time=np.arange(5.0), measured__b=np.ones(5), measured__a=member)
    for read in (Recording.load, lambda path: next(Recording.chunks(path, 2))):
        with pytest.raises(LogError, match=rf"r\.npz: member 'measured/a' cannot be read \(.*({message})"):
            read(path)


def test_an_archive_without_times_is_none_of_ours(tmp_path):
    with pytest.raises(ValueError, match=r"r\.npz: a recording needs a column 'time'; the file has a\."):
        Recording.load(archive(tmp_path / "r.npz", measured__a=np.ones(5)))
    with pytest.raises(ValueError, match=r"r\.npz: arrays need the same number of samples, 'time' has 4 and 'meas"):
        Recording.load(archive(tmp_path / "r.npz", measured__a=np.ones(5), time=np.arange(4.0)))


@pytest.mark.parametrize(
    ("row", "message"),
    [
        ("9,oops", "row 11, column 'a' needs a number, got 'oops'"),
        ("9,inf", "row 11, column 'a' needs a finite number, got inf"),
        ("9", "row 11 has 1 cells where the header has 2"),
        ("8,1", "row 11, column 'time' needs to increase"),
        ("9,", "row 11, column 'a' is empty or NaN, as are 1 of"),
    ],
)
@pytest.mark.parametrize("samples", [1, 3, 5, 100])
def test_a_late_fault_is_found_when_its_piece_is_due(tmp_path, row, message, samples):
    rows = [f"{k},{k}" for k in range(9)]
    (tmp_path / "r.csv").write_text("\n".join(["time,a", *rows, row, "20,20"]))
    pieces = Recording.chunks(tmp_path / "r.csv", samples)
    for _ in range(9 // samples):
        next(pieces)
    with pytest.raises(LogError, match=rf"r\.csv: {message}"):
        next(pieces)


@pytest.mark.parametrize("suffix", ["csv", "npz"])
def test_memory_does_not_grow_with_the_file(tmp_path, suffix):
    peaks = []
    for length in (500, 3_000, 12_000):
        recording(length).save(tmp_path / f"r.{suffix}")
        tracemalloc.start()
        assert sum(len(piece.time) for piece in Recording.chunks(tmp_path / f"r.{suffix}", 500)) == length
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert peaks[2] < 1.1 * peaks[1]
    assert peaks[2] < (tmp_path / f"r.{suffix}").stat().st_size / 4
