"""JSON lines give the same as the arrays that they hold, and every error names the row."""

import gzip
import json

import numpy as np
import pytest
from malformed_logs import JOINTS, LEG, N, Q, T

from ident.errors import LogError
from ident.files.readers import read_tables
from ident.recordings.log import read_log


def lines(n=N):
    force = [{"x": 1, "y": 2.5, "z": k} for k in range(n)]
    rows = zip(T.tolist(), Q.tolist(), force, strict=True)
    return [
        {"time": t, "q": q, "e": [2 * x for x in q], "ft": {"F": f, "M": [0, 0, t]}, "mode": "run", "on": True}
        for t, q, f in rows
    ]


def written(path, rows):
    text = "\n".join(row if isinstance(row, str) else json.dumps(row) for row in rows) + "\n"
    if path.suffix == ".gz":
        path.write_bytes(gzip.compress(text.encode()))
    else:
        path.write_text(text, encoding="utf-8")
    return path


def table(path):
    (whole,) = read_tables(path)
    return whole


@pytest.mark.parametrize("name", ["log.jsonl", "LOG.NDJSON", "log.jsonl.gz"])
def test_arrays_and_objects_are_columns(tmp_path, name):
    path = written(tmp_path / name, lines())
    columns = table(path).cells
    assert list(columns) == [
        *("time", "q.0", "q.1", "e.0", "e.1", "ft.F.x", "ft.F.y", "ft.F.z", "ft.M.x", "ft.M.y", "ft.M.z", "mode", "on")
    ]
    np.testing.assert_array_equal(np.stack([columns["q.0"], columns["q.1"]], axis=1), Q)
    mapping = {"joints": {x: {"position": f"q.{k}", "torque": f"e.{k}"} for k, x in enumerate(JOINTS)}}
    log = read_log(path, LEG, mapping)
    np.testing.assert_array_equal(log.of_joints(JOINTS, "torque"), 2 * Q)
    np.testing.assert_allclose(log.time, T, atol=1e-12)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda rows: [*rows[:4], "[1, 2]", *rows[4:]], r"row 5 needs an object of JSON, .*; got \[1.0, 2.0\]"),
        (lambda rows: [*rows[:4], '{"time": 0.04, "q":', *rows[4:]], r"row 5 needs an object of JSON, .* \(Expecting"),
        (lambda rows: [*rows, "[" * 100_000], rf"row {N + 1} needs an object of JSON"),
        (lambda rows: ["", *rows[:3], {**rows[3], "q.1": 2}, *rows[4:]], r"row 5 has two values named 'q.1'"),
        (lambda rows: [*rows[:9], {"time": T[9], "q": [0.1]}, *rows[10:]], "row 10, column 'q.1' is empty"),
        (
            lambda rows: [*rows[:9], {**rows[9], "q": [0.1, "x"]}, *rows[10:]],
            "row 10, column 'q.1' needs a number, .*x",
        ),
        (lambda rows: [*rows[:9], {**rows[9], "q": [0.1, 1e400]}, *rows[10:]], "row 10, column 'q.1' needs a finite"),
        (lambda rows: [json.dumps(rows)], "row 1 needs an object of JSON"),
        (lambda rows: rows[:3], "at least 10 samples, it has 3"),
        (lambda rows: [], "at least 10 samples, it has 0"),
    ],
)
def test_errors_name_the_row(tmp_path, change, message):
    path = written(tmp_path / "log.jsonl", change(lines()))
    with pytest.raises(LogError, match=message) as raised:
        read_log(path, LEG, {"joints": {x: {"position": f"q.{k}"} for k, x in enumerate(JOINTS)}})
    assert "\n" not in str(raised.value)
