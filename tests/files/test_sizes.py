"""Small files that unpack to much: rejected before they take memory, in all formats."""

import gzip
import tracemalloc

import numpy as np
import pytest
from written_formats import write_bag, write_mat

from ident.errors import LogError
from ident.files import csv_file, text_file
from ident.files.formats.bag_chunks import largest_chunk
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


def test_short_rows_take_the_memory_of_their_numbers(tmp_path):
    path = packed(tmp_path / "log.csv.gz", b"time,q\n" + 60_000 * b"0,0\n")
    (table,) = peak(path)
    assert len(table.rows) == 60_000 and peak.bytes < 6_000_000


def test_numbers_count_and_not_only_the_bytes_of_their_text(tmp_path):
    path = packed(tmp_path / "log.csv.gz", b"time,q\n" + 120_000 * b"0,0\n")
    assert "takes 2 MB in memory where at most 2 MB" in peak(path) and peak.bytes < 6_000_000


def test_text_that_comes_again_is_kept_once_and_other_text_counts(tmp_path):
    (table,) = peak(packed(tmp_path / "log.csv.gz", b"time,note\n" + 60_000 * b"0,fine\n"))
    assert table.cells["note"][0] is table.cells["note"][-1] and peak.bytes < 6_000_000
    text = "".join(f"0,n{k}\n" for k in range(40_000)).encode()
    assert "takes 2 MB in memory" in peak(packed(tmp_path / "log.csv.gz", b"time,note\n" + text))


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


@pytest.mark.parametrize("content", [np.zeros(400_000, np.uint8), {"y": np.zeros(400_000, np.uint8)}])
def test_small_numbers_of_matlab_count_as_what_they_become(tmp_path, content):
    write_mat(tmp_path / "log.mat", {}, x=content)
    assert "takes 3 MB in memory where at most 2 MB" in peak(tmp_path / "log.mat")


def test_messages_of_bags_count_besides_their_bytes(tmp_path):
    pytest.importorskip("rosbags", reason="rosbags is in the extra 'ros'")
    time = np.arange(500) / 100
    write_bag(tmp_path / "log.bag", {"/x": (time, np.zeros((500, 1)))})
    with pytest.raises(LogError, match="takes 0 MB in memory where at most 0 MB"):
        read_clocks(tmp_path / "log.bag", limit=100_000)


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


@pytest.mark.parametrize("name", ["log.bag", "log.mcap"])
@pytest.mark.parametrize("length", [0, 5, 14, 40, 60])
def test_damaged_bags_state_no_size_and_end_the_search(tmp_path, name, length):
    path = tmp_path / name
    magic = b"#ROSBAG V2.0\n" if name == "log.bag" else b"\x89MCAP0\r\n"
    path.write_bytes((magic + b"\x06" + b"\xff" * 60)[:length])
    assert largest_chunk(path) in (0, 2**64 - 1)
