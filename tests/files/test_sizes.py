"""Small files that unpack to much, and malicious archives: one sentence before they take memory."""

import bz2
import gzip
import io
import json
import struct
import sys
import tracemalloc
import zipfile
from pathlib import Path

import numpy as np
import pytest
from commands import refusal
from written_formats import write_bag

import scenes
from experiments import identify
from experiments.runs.workers import Checkpoint
from ident.errors import InputError, LogError
from ident.estimate import Estimate
from ident.files import csv_file
from ident.files.bag import largest_chunk
from ident.files.readers import read_clocks, read_tables
from ident.mechanism.body import Body
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.recordings.log import read_log
from ident.recordings.recording import Recording

LIMIT = 2_000_000


def peak(path, limit=LIMIT, read=read_tables):
    """Tables of a file, or the sentence that refuses it; `peak.bytes` is the most memory that it took."""
    tracemalloc.start()
    try:
        return list(read(path, limit=limit))
    except LogError as error:
        return str(error)
    finally:
        peak.bytes = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()


def packed(path, text):
    with gzip.open(path, "wb") as stream:
        stream.write(text)
    return path


@pytest.mark.parametrize("text", [b"%s", b"# %s", b"time,q\n0,%s", b"nRows=1\n%s"])
@pytest.mark.parametrize("end", ["csv", "csv.gz", "mot", "trc"])
def test_one_line_is_not_read_whole(tmp_path, monkeypatch, text, end):
    monkeypatch.setattr(csv_file, "LONGEST", 1000)
    path = tmp_path / f"log.{end}"
    content = text % (10_000_000 * b"1")
    packed(path, content) if end.endswith("gz") else path.write_bytes(content)
    number = 1 + text.count(b"\n")
    assert peak(path, 10**8) == f"row {number} is longer than 1000 characters, which no row of a log is."
    assert peak.bytes < 3_000_000


@pytest.mark.parametrize("block", [3, 4096])
def test_columns_are_the_same_however_they_are_read(tmp_path, monkeypatch, block):
    monkeypatch.setattr(csv_file, "BLOCK", block)
    rows = ["time;q;note;gap", *(f"{k};{k / 8};{'x' if k == 7 else k};{'' if k in (2, 5) else k}" for k in range(10))]
    (tmp_path / "log.csv").write_text("\n".join(rows))
    (table,) = read_tables(tmp_path / "log.csv")
    np.testing.assert_array_equal(table.column("q"), np.arange(10) / 8)
    gap = table.column("gap", gaps=True)
    assert np.flatnonzero(np.isnan(gap)).tolist() == [2, 5] and list(table.rows) == list(range(2, 12))
    with pytest.raises(LogError, match="row 9, column 'note' needs a number, got 'x'"):
        table.column("note")


def lying(path, old, new):
    """Replaces a count in the footer of a parquet file by another one."""

    def thrift(number, length):
        digits = [2 * number >> shift & 127 for shift in range(0, 7 * length, 7)]
        return bytes([128 | each for each in digits[:-1]] + digits[-1:])

    data = path.read_bytes()
    at = len(data) - 8 - struct.unpack("<I", data[-8:-4])[0]
    length = (2 * old).bit_length() // 7 + 1
    path.write_bytes(data[:at] + data[at:].replace(thrift(old, length), thrift(new, length)))


@pytest.mark.parametrize("true", [True, False])
@pytest.mark.parametrize("kind", ["list", "fixed", "numbers"])
def test_values_of_parquet_count_as_their_pages_say(tmp_path, kind, true):
    pyarrow = pytest.importorskip("pyarrow", reason="pyarrow is in the extra 'parquet'")
    from pyarrow import parquet

    from ident.files.arrays import size_of

    n = 3_000_000
    values = pyarrow.array(np.zeros(n))
    columns = {
        "list": lambda: pyarrow.ListArray.from_arrays(pyarrow.array([0, n]), values),
        "fixed": lambda: pyarrow.FixedSizeListArray.from_arrays(values, n),
        "numbers": lambda: values,
    }
    path = tmp_path / "log.parquet"
    parquet.write_table(pyarrow.table({"x.y": columns[kind]()}), path, row_group_size=n)
    assert path.stat().st_size < 20_000
    if not true:
        lying(path, n, 10)
    with path.open("rb") as stream:
        file = parquet.ParquetFile(stream)
        assert file.metadata.row_group(0).column(0).num_values == (n if true else 10)
        assert size_of(stream, file.metadata, ["x.y"]) >= 8 * n and size_of(stream, file.metadata, ["x"]) >= 8 * n
        assert size_of(stream, file.metadata, ["y"]) == size_of(stream, file.metadata, ["x.y"], []) == 0
    if kind != "list":
        assert "takes 24 MB in memory where at most 2 MB" in peak(path) and peak.bytes < 1_000_000


@pytest.mark.parametrize("name", ["log.bag", "log_mcap"])
def test_chunks_of_bags_are_not_unpacked_above_the_limit(tmp_path, name):
    pytest.importorskip("rosbags", reason="rosbags is in the extra 'ros'")
    path, time = tmp_path / name, np.arange(20) / 100
    write_bag(path, {"/x": (time, np.zeros((20, 50_000)))}, packed=True)
    files = [path] if path.is_file() else sorted(path.glob("*.mcap"))
    assert sum(file.stat().st_size for file in files) < 100_000
    assert largest_chunk(path) > 500_000
    assert "MB in memory where at most 0 MB" in peak(path, 400_000, read_clocks)
    assert peak.bytes < 400_000
    (table,) = read_clocks(path, limit=50_000_000)
    assert len(table.rows) == 20


def packed_chunk(kind, content):
    """Content, packed in one of the ways of chunks."""
    if kind == "bz2":
        return bz2.compress(content)
    if kind == "lz4":
        return pytest.importorskip("lz4.frame").compress(content)
    zstd = pytest.importorskip("compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd")
    half = len(content) // 2
    return zstd.compress(content[:half]) + zstd.compress(content[half:])


def chunk(path, kind, content, stated):
    """A bag of one chunk that states another size than it has."""
    packed = packed_chunk(kind, content)
    if path.suffix == ".mcap":
        body = struct.pack("<QQQI", 0, 0, stated, 0) + struct.pack("<I", len(kind)) + kind.encode()
        body += struct.pack("<Q", len(packed)) + packed
        path.write_bytes(b"\x89MCAP0\r\n" + struct.pack("<BQ", 6, len(body)) + body)
    else:
        fields = (b"op=\x05", b"compression=" + kind.encode(), b"size=" + struct.pack("<I", stated))
        header = b"".join(struct.pack("<I", len(each)) + each for each in fields)
        record = struct.pack("<I", len(header)) + header + struct.pack("<I", len(packed)) + packed
        path.write_bytes(b"#ROSBAG V2.0\n" + record)
    return path


PENDULUM = Path(scenes.__file__).parent / "double_pendulum.xml"


def npy(array):
    stream = io.BytesIO()
    np.lib.format.write_array(stream, array)
    return stream.getvalue()


X = npy(np.arange(40.0))


def with_header(text):
    """An array of 40 numbers with this text as its header."""
    header = text.encode() + b" " * (-len(text) % 64) + b"\n"
    return b"\x93NUMPY\x02\x00" + struct.pack("<I", len(header)) + header + X[-320:]


HEADER = "{'descr': '<f8', 'fortran_order': False, 'shape': %s, }"
FLOATS = HEADER % "(40,)"
EVIL = [
    (with_header(HEADER % "(40,("), "Cannot parse header|EOF in multi-line"),
    (with_header(HEADER % ("(" * 3000)), ""),
    (with_header(HEADER % "(10000000000000000,)"), ""),
    (with_header(HEADER % "(4611686018427387904, 16)"), ""),
    (with_header(HEADER % "(0, 400000000)"), ""),
    (with_header(HEADER % "(-40,)"), ""),
    (with_header(FLOATS.replace("<f8", "<q9")), ""),
    (with_header(FLOATS + " " * 20_000), ""),
    (X.replace(b"NUMPY\x01", b"NUMPY\x03"), "header of version 1 or 2, it has version 3"),
    (X[:-8], r"array of \(40,\) float64 has another size than its 312 bytes"),
    (X + b"more", r"array of \(40,\) float64 has another size than its 324 bytes"),
    (X[:40], "reading array header"),
    (npy(np.array([{}] * 40, object)), "needs real numbers in one or two dimensions, it holds object"),
    (npy(np.ones(40, complex)), "holds complex128"),
    (npy(np.array(["1"] * 40)), "holds <U1"),
    (npy(np.ones((40, 1, 1))), r"one or two dimensions, it holds float64 \(40, 1, 1\)"),
    (npy(np.array(1.0)), r"one or two dimensions, it holds float64 \(\)"),
    (b"text", "magic string"),
    (b"", "magic string"),
    (X, "", zipfile.ZIP_LZMA),
    (X, "", zipfile.ZIP_BZIP2),
]


def archive(path, content, compression=zipfile.ZIP_STORED):
    """A file that can be read as log, recording and both kinds of saved results."""
    members = {"time": npy(np.arange(40) / 100), "metadata": npy(np.array("{}")), "identity": npy(np.array("{}"))}
    with zipfile.ZipFile(path, "w") as out:
        for name, data in (members | {"done": npy(np.array(1))}).items():
            out.writestr(f"{name}.npy", data)
        for name in ("measured/elbow_position", "outcomes", "objects"):
            out.writestr(f"{name}.npy", content, compression)
    return path


ELBOW = Body("arm", -1, np.eye(4), np.array([0, 0, 0, 0, 1, 0]), "elbow")
READERS = {
    "log": lambda path: read_log(path, Mechanism(Tree((ELBOW,)), np.zeros(3))),
    "recording": Recording.load,
    "pieces": lambda path: next(Recording.chunks(path, 7)),
    "outcomes": lambda path: Checkpoint("runs", path, {}).done(),
    "estimate": Estimate.load,
}
OURS = ("recording", "pieces")


@pytest.mark.parametrize("reader", READERS)
def test_whatever_is_wrong_with_a_member_is_one_sentence(tmp_path, reader):
    for content, message, *compression in EVIL:
        path = archive(tmp_path / "evil.npz", content, *compression)
        named = rf": member 'measured/elbow_position' cannot be read \(.*({message})" if reader in OURS else ""
        with pytest.raises(InputError, match=rf"evil\.npz{named}") as raised:
            READERS[reader](path)
        assert "\n" not in str(raised.value) and len(str(raised.value)) < 500, content[:200]


def unpacking(path, size, stated):
    """An archive with a channel that unpacks to so many bytes, and a directory that states another number."""
    archive(path, npy(np.zeros(size // 8 - 16)), zipfile.ZIP_DEFLATED)
    path.write_bytes(path.read_bytes().replace(struct.pack("<I", size), struct.pack("<I", stated)))
    return path


@pytest.mark.parametrize("stated", [100, 1000, 700_000_000])
def test_a_small_file_is_not_unpacked_to_a_large_one(tmp_path, stated):
    path = unpacking(tmp_path / "bomb.npz", 16_000_000, stated)
    for name, read in READERS.items():
        tracemalloc.start()
        try:
            with pytest.raises(InputError, match=r"bomb\.npz"):
                read(path)
            assert tracemalloc.get_traced_memory()[1] < 2_000_000, name
        finally:
            tracemalloc.stop()


def test_the_limit_is_raised_by_an_option(tmp_path, capsys):
    channels = {"time": np.arange(2000) / 100, "measured/wide": np.zeros((2000, 600))}
    np.savez_compressed(tmp_path / "wide.npz", metadata=json.dumps({}), **channels)
    given = [str(PENDULUM), str(tmp_path / "wide.npz"), "--out", str(tmp_path / "out")]
    sentence = (
        "takes 10 MB in memory where at most 9 MB are expected of it; if it may be so large, say so (--max-size)."
    )
    assert sentence in refusal(identify.main, [*given, "--max-size", "9"], capsys)
    assert sentence[:20] not in refusal(identify.main, given, capsys)
