"""Small files that unpack to much: rejected before they take memory, in all formats."""

import bz2
import gzip
import struct
import sys
import tracemalloc

import numpy as np
import pytest
from written_formats import write_bag

from ident.errors import LogError
from ident.files import csv_file, text_file
from ident.files.formats.bag import largest_chunk
from ident.files.readers import read_clocks, read_tables

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
    monkeypatch.setattr(text_file, "LONGEST", 1000)
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

    from ident.files.formats.parquet import size_of

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
