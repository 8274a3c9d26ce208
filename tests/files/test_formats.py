"""Logs and markers of other programs give the same as a CSV file with the same columns."""

import gzip
import json
import re

import numpy as np
import pytest
from commands import sentence_of
from malformed_logs import DQ, GROUND_COLUMNS, JOINTS, LEG, PLAIN, WRENCH, N, Q, T
from written_formats import DEG, write_bag, write_c3d, write_csv, write_mat, write_mot, write_parquet, write_trc

from ident.errors import LogError
from ident.files.markers import trc_markers
from ident.files.readers import read_clocks, read_markers, read_tables
from ident.recordings.log import read_log, read_log_pieces

pytestmark = pytest.mark.extras


COLUMNS = PLAIN | {f"dq_{joint}": DQ[:, k] for k, joint in enumerate(JOINTS)} | GROUND_COLUMNS
FAST = np.repeat(WRENCH, 5, axis=0)
FAST_TIME = np.arange(5 * N) / 500


def in_degrees():
    return {name: x * (DEG if name.startswith(("q_", "dq_")) else 1) for name, x in COLUMNS.items()}


def same_as_csv(tmp_path, log):
    write_csv(tmp_path / "same.csv", COLUMNS)
    expected = read_log(tmp_path / "same.csv", LEG)
    assert log.measured.keys() == expected.measured.keys()
    for name, x in expected.measured.items():
        np.testing.assert_allclose(log[name], x, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(log.time, expected.time, atol=1e-12)


@pytest.mark.parametrize("suffix", ["mot", "sto"])
@pytest.mark.parametrize("degrees", ["yes", "no"])
def test_a_motion_file_knows_its_degrees(tmp_path, suffix, degrees):
    write_mot(tmp_path / f"log.{suffix}", in_degrees() if degrees == "yes" else COLUMNS, degrees)
    log = read_log(tmp_path / f"log.{suffix}", LEG)
    same_as_csv(tmp_path, log)
    assert log.units["hip_position"] == "rad" and log.units["hip_velocity"] == "rad/s"
    pieces = list(read_log_pieces(tmp_path / f"log.{suffix}", LEG, None, 13))
    np.testing.assert_allclose(np.concatenate([piece.time for piece in pieces]), T, atol=1e-12)


def test_matlab_arrays_and_structures(tmp_path):
    others = {"gains": np.eye(3), "name": "arm", "k": 3.0, "wrench": {"F": WRENCH[:, :3].T, "M": WRENCH[:, 3:]}}
    write_mat(tmp_path / "log.mat", COLUMNS, **others)
    log = read_log(tmp_path / "log.mat", LEG)
    same_as_csv(tmp_path, log)
    assert log.unused == [f"wrench.{what}.{axis}" for what in "FM" for axis in "xyz"]
    log = read_log(tmp_path / "log.mat", LEG, {"wrenches": {"ground": {"force": [f"wrench.F.{x}" for x in "xyz"]}}})
    np.testing.assert_array_equal(log["ground_force"], WRENCH[:, :3])


def test_parquet(tmp_path):
    pyarrow = pytest.importorskip("pyarrow", reason="pyarrow is in the extra 'parquet'")
    write_parquet(tmp_path / "log.parquet", {**COLUMNS, "remark": ["x"] * N})
    same_as_csv(tmp_path, read_log(tmp_path / "log.parquet", LEG))
    stamps = pyarrow.array(1_700_000_000_123_456_789 + np.round(1e9 * T).astype(int), pyarrow.timestamp("ns"))
    force = pyarrow.FixedSizeListArray.from_arrays(WRENCH[:, :3].ravel(), 3)
    columns = {name: x for name, x in COLUMNS.items() if name[:8] != "ground_f"}
    write_parquet(tmp_path / "log.parquet", {**columns, "time": stamps, "ground_force": force})
    same_as_csv(tmp_path, read_log(tmp_path / "log.parquet", LEG))
    with pytest.raises(LogError, match="time is mapped in another unit than the file's, which says s"):
        read_log(tmp_path / "log.parquet", LEG, {"time": {"column": "time", "unit": "ms"}})
    repeated = pyarrow.Table.from_arrays([pyarrow.array(T)] * 3, names=["time", "force", "force"])
    pyarrow.parquet.write_table(repeated, tmp_path / "log.parquet")
    with pytest.raises(LogError, match="columns of a log need different names, 'force' is more than one"):
        read_log(tmp_path / "log.parquet", LEG)


C3D = {
    "joints": {joint: {"position": f"{joint}.x"} for joint in JOINTS},
    "wrenches": {"ground": {kind: [f"plate1_{kind}.{axis}" for axis in "xyz"] for kind in ("force", "torque")}},
}


def points():
    angles = {joint: np.stack([Q[:, k], 0 * T, 0 * T], axis=1) for k, joint in enumerate(JOINTS)}
    return angles | {"HEEL": np.stack([T, 1 + T, 0.1 + 0 * T], axis=1)}


def test_c3d_has_a_platform_at_its_own_rate(tmp_path):
    pytest.importorskip("ezc3d", reason="ezc3d is in the extra 'c3d'")
    write_c3d(tmp_path / "log.c3d", 100.0, points(), FAST, JOINTS, {"emg": FAST_TIME})
    log = read_log(tmp_path / "log.c3d", LEG, C3D)
    np.testing.assert_allclose(log.of_joints(JOINTS, "position"), Q, atol=1e-6)
    force, torque = (log.as_measured(f"ground_{kind}") for kind in ("force", "torque"))
    np.testing.assert_allclose(force.time, FAST_TIME, atol=1e-12)
    np.testing.assert_allclose(np.hstack([force.values, torque.values]), FAST, rtol=1e-5, atol=1e-3)
    assert log.units["ground_torque"] == "N m"
    assert "'plate1' has its centre at (0.4, 0.3, 0) m" in log.notes[0]


@pytest.mark.parametrize("units", ["mm", "m"])
def test_markers_of_a_trc_file(tmp_path, units):
    heel, toe = np.stack([T, 1 + T, 2 - T], axis=1), np.stack([T, T, 1 + T], axis=1)
    toe[5:9] = np.nan
    toe[-1] = np.nan
    write_trc(tmp_path / "log.trc", T, {"HEEL": heel, "TOE": toe}, units)
    markers = trc_markers(tmp_path / "log.trc", 10**9)
    assert markers.labels == ("HEEL", "TOE")
    np.testing.assert_allclose(markers.time, T, atol=1e-9)
    np.testing.assert_allclose(markers.positions, np.stack([heel, toe], axis=1), atol=1e-9)
    with pytest.raises(LogError, match=r"joint 'ankle' needs a column .* the file has time, HEEL\.x"):
        read_log(tmp_path / "log.trc", LEG)


def joint_states(names=("hip", "ankle")):
    """In another order than the mechanism's."""
    columns = {joint: k for k, joint in enumerate(JOINTS)}
    return {name: list(zip(Q[:, columns[name]], DQ[:, columns[name]], T, strict=True)) for name in names}


BAGS = ["log.bag", "folder", "mcap", "mcap/mcap.mcap", "folder/folder.db3"]


@pytest.mark.parametrize("name", BAGS)
@pytest.mark.parametrize("stamped", [True, False])
def test_bags_have_each_topic_at_its_own_times(tmp_path, name, stamped):
    pytest.importorskip("rosbags", reason="rosbags is in the extra 'ros'")
    late = FAST_TIME + 0.0013
    topics = {"/joint_states": (T, joint_states()), "/ground": (late, FAST), "/x": (T, Q)}
    write_bag(tmp_path / name.partition("/")[0], topics, stamped=stamped)
    log = read_log(tmp_path / name, LEG)
    for k, joint in enumerate(JOINTS):
        np.testing.assert_allclose(log.as_measured(f"{joint}_position").time, T, atol=1e-8)
        np.testing.assert_array_equal(log.as_measured(f"{joint}_position").values, Q[:, k])
        np.testing.assert_array_equal(log.as_measured(f"{joint}_velocity").values, DQ[:, k])
        np.testing.assert_array_equal(log.as_measured(f"{joint}_torque").values, T)
    np.testing.assert_allclose(log.as_measured("ground_torque").time, late, atol=1e-8)
    np.testing.assert_array_equal(log.as_measured("ground_force").values, FAST[:, :3])
    assert log.unused == ["x.0", "x.1"]
    assert any(("frame 'tool'" if stamped else "those of writing") in note for note in log.notes)


def test_joints_of_several_topics_are_named_by_their_topics(tmp_path):
    pytest.importorskip("rosbags", reason="rosbags is in the extra 'ros'")
    write_bag(tmp_path / "log.bag", {"/a": (T, joint_states()), "/b": (T, joint_states(("hip",)))})
    columns = [name for table in read_clocks(tmp_path / "log.bag") for name in table.cells]
    assert {"a:hip_position", "b:hip_position", "ankle_position"} <= {*columns} and "hip_position" not in columns


CONTRADICTIONS = {
    "time": ('time = "x"', "this file knows the times of its columns; leave time out"),
    "layout": ("[file]\nskip = 1", "the mapping's [file] tells how text is laid out, but this file is none"),
    "unit": ('[joints.hip]\nposition = { column = "hip_position", unit = "deg" }', "joints.hip.position is mapped in"),
    "two rates": ('[wrenches.ground]\nforce = ["ground_force.x", "x.0", ""]', "wrenches.ground.force needs columns of"),
}


@pytest.mark.parametrize(("mapping", "message"), CONTRADICTIONS.values(), ids=CONTRADICTIONS.keys())
def test_mappings_that_contradict_a_bag(tmp_path, mapping, message):
    pytest.importorskip("rosbags", reason="rosbags is in the extra 'ros'")
    write_bag(tmp_path / "log.bag", {"/j": (T, joint_states()), "/ground": (FAST_TIME, FAST), "/x": (T, Q)})
    (tmp_path / "c.toml").write_text(mapping)
    assert message in sentence_of(read_log, tmp_path / "log.bag", LEG, tmp_path / "c.toml")


def lines(n=N):
    force = [{"x": 1, "y": 2.5, "z": k} for k in range(n)]
    rows = zip(T.tolist(), Q.tolist(), force, strict=True)
    return [
        {"time": t, "q": q, "e": [2 * x for x in q], "ft": {"F": f, "M": [0, 0, t]}, "mode": "run", "on": True}
        for t, q, f in rows
    ]


def written(path, rows):
    text = "\n".join(row if isinstance(row, str) else json.dumps(row) for row in rows) + "\n"
    path.write_bytes(gzip.compress(text.encode()) if path.suffix == ".gz" else text.encode())
    return path


@pytest.mark.parametrize("name", ["log.jsonl", "LOG.NDJSON", "log.jsonl.gz"])
def test_arrays_and_objects_are_columns(tmp_path, name):
    path = written(tmp_path / name, lines())
    columns = next(iter(read_tables(path))).cells
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
        (lambda rows: [*rows[:9], {**rows[9], "q": [0.1, "x"]}, *rows[10:]], "row 10, column 'q.1' needs a number"),
        (lambda rows: [*rows[:9], {**rows[9], "q": [0.1, 1e400]}, *rows[10:]], "row 10, column 'q.1' needs a finite"),
        (lambda rows: [json.dumps(rows)], "row 1 needs an object of JSON"),
        (lambda rows: rows[:3], "at least 10 samples, it has 3"),
        (lambda rows: [], "at least 10 samples, it has 0"),
    ],
)
def test_errors_name_the_row(tmp_path, change, message):
    path = written(tmp_path / "log.jsonl", change(lines()))
    mapping = {"joints": {x: {"position": f"q.{k}"} for k, x in enumerate(JOINTS)}}
    assert re.search(message, sentence_of(read_log, path, LEG, mapping))


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
