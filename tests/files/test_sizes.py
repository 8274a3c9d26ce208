"""Small files that unpack to much, and malicious archives: one sentence before they take memory."""

import gzip
import io
import json
import struct
import tracemalloc
import zipfile

import numpy as np
import pytest
from commands import refusal, sentence_of
from pages import PENDULUM
from written_formats import write_bag

from experiments import identify
from experiments.runs.workers import Checkpoint
from ident import Body, Estimate, InputError, Mechanism, Recording, Tree, read_log
from ident.files import csv_file
from ident.files.parquet import size_of
from ident.files.readers import read_clocks, read_tables

ELBOW = Body("arm", -1, np.eye(4), np.array([0, 0, 0, 0, 1, 0]), "elbow")
READERS = {
    "log": lambda path: read_log(path, Mechanism(Tree((ELBOW,)), np.zeros(3))),
    "recording": Recording.load,
    "outcomes": lambda path: Checkpoint("runs", path, {}).done(),
    "estimate": Estimate.load,
}


def peak(path, limit=2_000_000, read=read_tables):
    """Tables of a file or the sentence that refuses it, and the most memory that it took."""
    tracemalloc.start()
    try:
        out = list(read(path, limit=limit))
    except InputError as error:
        out = str(error)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return out, most


@pytest.mark.parametrize("text", [b"# %s", b"time,q\n0,%s"])
@pytest.mark.parametrize("end", ["csv", "csv.gz", "mot", "trc"])
def test_one_line_is_not_read_whole(tmp_path, monkeypatch, text, end):
    monkeypatch.setattr(csv_file, "LONGEST", 1000)
    content = text % (10_000_000 * b"1")
    (tmp_path / f"log.{end}").write_bytes(gzip.compress(content, 1) if end.endswith("gz") else content)
    sentence, most = peak(tmp_path / f"log.{end}", 10**8)
    row = 1 + text.count(b"\n")
    assert sentence == f"row {row} is longer than 1000 characters, which no row of a log is."
    assert most < 3_000_000


def test_packed_rows_are_not_unpacked_above_the_limit(tmp_path):
    (tmp_path / "log.csv.gz").write_bytes(gzip.compress(b"time,q\n" + 200_000 * b"0.0,0.0\n"))
    sentence, most = peak(tmp_path / "log.csv.gz", 500_000)
    assert "MB in memory where at most 0 MB are expected" in sentence and most < 2_000_000


@pytest.mark.parametrize("block", [3, 4096])
def test_columns_are_the_same_however_they_are_read(tmp_path, monkeypatch, block):
    monkeypatch.setattr(csv_file, "BLOCK", block)
    rows = ["time;q;note;gap", *(f"{k};{k / 8};{'x' if k == 7 else k};{'' if k in (2, 5) else k}" for k in range(10))]
    (tmp_path / "log.csv").write_text("\n".join(rows))
    (table,) = read_tables(tmp_path / "log.csv")
    np.testing.assert_array_equal(table.column("q"), np.arange(10) / 8)
    gap = table.column("gap", gaps=True)
    assert np.flatnonzero(np.isnan(gap)).tolist() == [2, 5] and list(table.rows) == list(range(2, 12))
    assert "row 9, column 'note' needs a number, got 'x'" in sentence_of(table.column, "note")


def thrift(number, length):
    """An integer as in the footer of a parquet file."""
    digits = [2 * number >> shift & 127 for shift in range(0, 7 * length, 7)]
    return bytes([128 | each for each in digits[:-1]] + digits[-1:])


@pytest.mark.parametrize("stated", [3_000_000, 10])
@pytest.mark.parametrize("kind", ["list", "fixed", "numbers"])
def test_values_of_parquet_count_as_their_pages_say_whatever_the_footer_states(tmp_path, kind, stated):
    pyarrow = pytest.importorskip("pyarrow", reason="pyarrow is in the extra 'parquet'")
    from pyarrow import parquet

    n, path = 3_000_000, tmp_path / "log.parquet"
    values = pyarrow.array(np.zeros(n))
    if kind == "list":
        values = pyarrow.ListArray.from_arrays(pyarrow.array([0, n]), values)
    elif kind == "fixed":
        values = pyarrow.FixedSizeListArray.from_arrays(values, n)
    parquet.write_table(pyarrow.table({"x.y": values}), path, row_group_size=n)
    data, length = path.read_bytes(), (2 * n).bit_length() // 7 + 1
    at = len(data) - 8 - struct.unpack("<I", data[-8:-4])[0]
    path.write_bytes(data[:at] + data[at:].replace(thrift(n, length), thrift(stated, length)))
    with path.open("rb") as stream:
        data = parquet.ParquetFile(stream).metadata
        assert data.row_group(0).column(0).num_values == stated
        assert min(size_of(stream, data, ["x.y"]), size_of(stream, data, ["x"])) >= 8 * n
        assert size_of(stream, data, ["y"]) == 0
    if kind != "list":
        sentence, most = peak(path)
        assert "takes 24 MB in memory where at most 2 MB" in sentence and most < 1_000_000


@pytest.mark.parametrize("name", ["log.bag", "log_mcap"])
def test_chunks_of_bags_are_not_unpacked_above_the_limit(tmp_path, name):
    pytest.importorskip("rosbags", reason="rosbags is in the extra 'ros'")
    path = tmp_path / name
    write_bag(path, {"/x": (np.arange(20) / 100, np.zeros((20, 50_000)))}, packed=True)
    assert sum(file.stat().st_size for file in (path, *path.glob("*.mcap"))) < 100_000
    sentence, most = peak(path, 400_000, read_clocks)
    assert "MB in memory where at most 0 MB" in sentence and most < 400_000
    (table,) = read_clocks(path, limit=50_000_000)
    assert len(table.rows) == 20


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
SHAPES = "(" * 3000, "(10000000000000000,)", "(4611686018427387904, 16)", "(0, 400000000)", "(-40,)"
EVIL = [
    (with_header(HEADER % "(40,("), "Cannot parse header|EOF in multi-line"),
    *((with_header(HEADER % shape), "") for shape in SHAPES),
    (with_header(FLOATS.replace("<f8", "<q9")), ""),
    (with_header(FLOATS + " " * 20_000), ""),
    (X[:-8], "reading array data, expected 320 bytes"),
    (X[:40], "reading array header"),
    (npy(np.array([{}] * 40, object)), "pickled objects are not read"),
    (npy(np.ones(40, complex)), "holds complex128"),
    (npy(np.array(["1"] * 40)), "holds <U1"),
    (npy(np.ones((40, 1, 1))), r"one or two dimensions, it holds float64 \(40, 1, 1\)"),
    (npy(np.array(1.0)), r"one or two dimensions, it holds float64 \(\)"),
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


@pytest.mark.parametrize("reader", READERS)
def test_whatever_is_wrong_with_a_member_is_one_sentence(tmp_path, reader):
    for content, message, *compression in EVIL:
        path = archive(tmp_path / "evil.npz", content, *compression)
        named = rf": member 'measured/elbow_position' cannot be read \(.*({message})" if reader == "recording" else ""
        with pytest.raises(InputError, match=rf"evil\.npz{named}") as raised:
            READERS[reader](path)
        assert "\n" not in str(raised.value) and len(str(raised.value)) < 500, content[:200]


@pytest.mark.parametrize("stated", [100, 700_000_000])
def test_a_small_file_is_not_unpacked_to_a_large_one(tmp_path, stated):
    """An archive with a channel that unpacks to 16 MB, and a directory that states another number."""
    path, size = tmp_path / "bomb.npz", 16_000_000
    archive(path, npy(np.zeros(size // 8 - 16)), zipfile.ZIP_DEFLATED)
    path.write_bytes(path.read_bytes().replace(struct.pack("<I", size), struct.pack("<I", stated)))
    for read in READERS.values():
        sentence, most = peak(path, read=lambda path, limit, read=read: read(path))
        assert "bomb.npz" in sentence and most < 2_000_000


def test_the_limit_is_raised_by_an_option(tmp_path, capsys):
    channels = {"time": np.arange(2000) / 100, "measured/wide": np.zeros((2000, 600))}
    np.savez_compressed(tmp_path / "wide.npz", metadata=json.dumps({}), **channels)
    given = [str(PENDULUM), str(tmp_path / "wide.npz"), "--out", str(tmp_path / "out")]
    message = refusal(identify.main, [*given, "--max-size", "9"], capsys)
    assert "takes 10 MB in memory where at most 9 MB are expected of it; if it may be so large, say so" in message
    assert "takes 10 MB in memory" not in refusal(identify.main, given, capsys)
