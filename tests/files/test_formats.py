"""Logs and markers of other programs give the same as a CSV file with the same columns."""

import gzip
import json
import re

import numpy as np
import pytest
from commands import sentence_of
from malformed_logs import DQ, GROUND_COLUMNS, JOINTS, LEG, PLAIN, WRENCH, N, Q, T, read
from written_formats import DEG, write_bag, write_c3d, write_mat, write_mot, write_parquet, write_trc

from ident import read_log
from ident.files.readers import read_clocks, read_markers, read_tables

pytestmark = pytest.mark.extras


COLUMNS = PLAIN | {f"dq_{joint}": DQ[:, k] for k, joint in enumerate(JOINTS)} | GROUND_COLUMNS
FAST, FAST_TIME = np.repeat(WRENCH, 5, axis=0), np.arange(5 * N) / 500
HEEL = np.stack([T, 1 + T, 2 - T], axis=1)
STATES = {joint: list(zip(Q[:, k], DQ[:, k], T, strict=True)) for k, joint in reversed([*enumerate(JOINTS)])}
"""Positions, velocities and torques in another order than the mechanism's."""
OTHERS = {"ft": {"F": {"x": 1, "y": 2.5}, "M": [0, 0, 1]}, "mode": "run", "on": True}
LINES = [{"time": t, "q": q, "e": [2 * x for x in q], **OTHERS} for t, q in zip(T.tolist(), Q.tolist(), strict=True)]
OF_JOINTS = {joint: {"position": f"q.{k}", "torque": f"e.{k}"} for k, joint in enumerate(JOINTS)}


def same_as_csv(path):
    """The log, if it has the numbers of a CSV file with the same columns."""
    log, expected = read_log(path, LEG), read(path.parent, COLUMNS)
    assert log.measured.keys() == expected.measured.keys()
    for name, x in expected.measured.items():
        np.testing.assert_allclose(log[name], x, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(log.time, expected.time, atol=1e-12)
    return log


@pytest.mark.parametrize(("name", "degrees"), [("run.mot", "yes"), ("run.sto", "no")])
def test_a_motion_file_knows_its_degrees(tmp_path, name, degrees):
    path = tmp_path / name
    turns = DEG if degrees == "yes" else 1
    write_mot(path, {name: x * (turns if name[0] in "qd" else 1) for name, x in COLUMNS.items()}, degrees)
    log = same_as_csv(path)
    assert log.units["hip_position"] == "rad" and log.units["hip_velocity"] == "rad/s"
    pieces = [piece.column("time") for piece in read_tables(path, 13)]
    np.testing.assert_allclose(np.concatenate(pieces), T, atol=1e-12)


def test_matlab_arrays_and_structures(tmp_path):
    others = {"gains": np.eye(3), "name": "arm", "k": 3.0, "wrench": {"F": WRENCH[:, :3].T, "M": WRENCH[:, 3:]}}
    write_mat(tmp_path / "run.mat", COLUMNS, **others)
    log = same_as_csv(tmp_path / "run.mat")
    assert log.unused == [f"wrench.{what}.{axis}" for what in "FM" for axis in "xyz"]
    ground = {"force": [f"wrench.F.{x}" for x in "xyz"]}
    log = read_log(tmp_path / "run.mat", LEG, {"wrenches": {"ground": ground}})
    np.testing.assert_array_equal(log["ground_force"], WRENCH[:, :3])


def test_parquet(tmp_path):
    pyarrow = pytest.importorskip("pyarrow", reason="pyarrow is in the extra 'parquet'")
    path = tmp_path / "run.parquet"
    write_parquet(path, {**COLUMNS, "remark": ["x"] * N})
    same_as_csv(path)
    stamps = pyarrow.array(1_700_000_000_123_456_789 + np.round(1e9 * T).astype(int), pyarrow.timestamp("ns"))
    force = pyarrow.FixedSizeListArray.from_arrays(WRENCH[:, :3].ravel(), 3)
    columns = {name: x for name, x in COLUMNS.items() if name[:8] != "ground_f"}
    write_parquet(path, {**columns, "time": stamps, "ground_force": force})
    same_as_csv(path)
    message = sentence_of(read_log, path, LEG, {"time": {"column": "time", "unit": "ms"}})
    assert "time is mapped in another unit than the file's, which says s" in message
    repeated = pyarrow.Table.from_arrays([pyarrow.array(T)] * 3, names=["time", "force", "force"])
    pyarrow.parquet.write_table(repeated, path)
    assert "columns of a log need different names, 'force' is more than one" in sentence_of(read_log, path, LEG)


def test_c3d_has_a_platform_at_its_own_rate(tmp_path):
    pytest.importorskip("ezc3d", reason="ezc3d is in the extra 'c3d'")
    points = {joint: np.stack([Q[:, k], 0 * T, 0 * T], axis=1) for k, joint in enumerate(JOINTS)} | {"HEEL": HEEL}
    write_c3d(tmp_path / "log.c3d", 100.0, points, FAST, JOINTS, {"emg": FAST_TIME})
    ground = {kind: [f"plate1_{kind}.{axis}" for axis in "xyz"] for kind in ("force", "torque")}
    mapping = {"joints": {joint: {"position": f"{joint}.x"} for joint in JOINTS}, "wrenches": {"ground": ground}}
    log = read_log(tmp_path / "log.c3d", LEG, mapping)
    np.testing.assert_allclose(log.of_joints(JOINTS, "position"), Q, atol=1e-6)
    force, torque = (log.as_measured(f"ground_{kind}") for kind in ("force", "torque"))
    np.testing.assert_allclose(force.time, FAST_TIME, atol=1e-12)
    np.testing.assert_allclose(np.hstack([force.values, torque.values]), FAST, rtol=1e-5, atol=1e-3)
    assert log.units["ground_torque"] == "N m" and "'plate1' has its centre at (0.4, 0.3, 0) m" in log.notes[0]


@pytest.mark.parametrize("units", ["mm", "m"])
def test_markers_of_a_trc_file(tmp_path, units):
    toe, path = np.stack([T, T, 1 + T], axis=1), tmp_path / "log.trc"
    toe[[5, 6, 7, 8, -1]] = np.nan
    write_trc(path, T, {"HEEL": HEEL, "TOE": toe}, units)
    markers = read_markers(path)
    assert markers.labels == ("HEEL", "TOE")
    np.testing.assert_allclose(markers.time, T, atol=1e-9)
    np.testing.assert_allclose(markers.positions, np.stack([HEEL, toe], axis=1), atol=1e-9)
    assert re.search(r"joint 'ankle' needs a column .* the file has time, HEEL\.x", sentence_of(read_log, path, LEG))


def test_markers_of_c3d_files_are_read(tmp_path):
    pytest.importorskip("ezc3d", reason="ezc3d is in the extra 'c3d'")
    write_c3d(tmp_path / "a.c3d", 50.0, {"KNEE": HEEL, "HIP": HEEL}, angles=("HIP",))
    markers = read_markers(tmp_path / "a.c3d")
    assert markers.labels == ("KNEE",)
    np.testing.assert_allclose(markers.positions[:, 0], HEEL, atol=1e-6)
    np.testing.assert_allclose(markers.time, 2 * T)
    write_c3d(tmp_path / "b.c3d", 50.0, {"HIP": HEEL}, angles=("HIP",))
    assert f"0 markers in {N} frames need positions" in sentence_of(read_markers, tmp_path / "b.c3d")


def test_damaged_tables_of_markers_are_refused(tmp_path):
    for text, expected in (
        ("t,A.x,A.y,A.z\n0,1,2,3\n", "markers need a column 'time'"),
        ("time,A.x,A.y\n0,1,2\n", "marker 'A' lacks the column 'A.z'"),
        ("time,A.w\n0,1\n", "need columns LABEL.x, LABEL.y and LABEL.z"),
        ("time,A.x,A.y,A.z\n0,1,,3\n1,1,2,3\n", "frame 1: marker 'A' has some of x, y and z only"),
        ("time,A.x,A.y,A.z\n1,1,2,3\n0,1,2,3\n", "times of frames must be finite and increase; frame 2"),
        ("time,A.x,A.y,A.z\n", "needs frames, it has none"),
        ("time,A.x,A.y,A.z\n0,1,1e30,3\n", "frame 1: marker 'A' needs positions below"),
    ):
        (tmp_path / "a.csv").write_text(text)
        assert expected in sentence_of(read_markers, tmp_path / "a.csv")


@pytest.mark.parametrize("name", ["log.bag", "folder", "folder/folder.db3", "mcap/mcap.mcap"])
def test_bags_have_each_topic_at_its_own_times(tmp_path, name):
    pytest.importorskip("rosbags", reason="rosbags is in the extra 'ros'")
    late = FAST_TIME + 0.0013
    for stamped, folder, note in ((True, tmp_path / "a", "frame 'tool'"), (False, tmp_path / "b", "those of writing")):
        folder.mkdir()
        topics = {"/joint_states": (T, STATES), "/ground": (late, FAST), "/x": (T, Q)}
        write_bag(folder / name.partition("/")[0], topics, stamped=stamped)
        log = read_log(folder / name, LEG)
        for k, joint in enumerate(JOINTS):
            np.testing.assert_allclose(log.as_measured(f"{joint}_position").time, T, atol=1e-8)
            for kind, expected in (("position", Q[:, k]), ("velocity", DQ[:, k]), ("torque", T)):
                np.testing.assert_array_equal(log.as_measured(f"{joint}_{kind}").values, expected)
        np.testing.assert_allclose(log.as_measured("ground_torque").time, late, atol=1e-8)
        np.testing.assert_array_equal(log.as_measured("ground_force").values, FAST[:, :3])
        assert log.unused == ["x.0", "x.1"] and any(note in each for each in log.notes)


def test_joints_of_several_topics_are_named_by_their_topics(tmp_path):
    pytest.importorskip("rosbags", reason="rosbags is in the extra 'ros'")
    write_bag(tmp_path / "log.bag", {"/a": (T, STATES), "/b": (T, {"hip": STATES["hip"]})})
    columns = [name for table in read_clocks(tmp_path / "log.bag") for name in table.cells]
    assert {"a:hip_position", "b:hip_position", "ankle_position"} <= {*columns} and "hip_position" not in columns


def test_mappings_that_contradict_a_bag(tmp_path):
    pytest.importorskip("rosbags", reason="rosbags is in the extra 'ros'")
    write_bag(tmp_path / "log.bag", {"/j": (T, STATES), "/ground": (FAST_TIME, FAST), "/x": (T, Q)})
    degrees = {"column": "hip_position", "unit": "deg"}
    for mapping, message in (
        ({"time": "x"}, "this file knows the times of its columns; leave time out"),
        ({"file": {"skip": 1}}, "the mapping's [file] tells how text is laid out, but this file is none"),
        ({"joints": {"hip": {"position": degrees}}}, "joints.hip.position is mapped in"),
        ({"wrenches": {"ground": {"force": ["ground_force.x", "x.0", ""]}}}, "wrenches.ground.force needs columns of"),
    ):
        assert message in sentence_of(read_log, tmp_path / "log.bag", LEG, mapping)


def written(path, rows):
    text = "\n".join(row if isinstance(row, str) else json.dumps(row) for row in rows).encode() + b"\n"
    path.write_bytes(gzip.compress(text) if path.suffix == ".gz" else text)
    return path


@pytest.mark.parametrize("name", ["log.jsonl", "LOG.NDJSON", "log.jsonl.gz"])
def test_arrays_and_objects_are_columns(tmp_path, name):
    path = written(tmp_path / name, LINES)
    names = "time q.0 q.1 e.0 e.1 ft.F.x ft.F.y ft.M.x ft.M.y ft.M.z mode on"
    assert list(next(iter(read_tables(path))).cells) == names.split()
    log = read_log(path, LEG, {"joints": OF_JOINTS})
    np.testing.assert_array_equal(log.of_joints(JOINTS, "position"), Q)
    np.testing.assert_array_equal(log.of_joints(JOINTS, "torque"), 2 * Q)
    np.testing.assert_allclose(log.time, T, atol=1e-12)


def test_errors_name_the_row(tmp_path):
    for rows, message in (
        ([*LINES[:4], "[1, 2]", *LINES[4:]], r"row 5 needs an object of JSON, .*; got \[1.0, 2.0\]"),
        ([*LINES[:4], '{"time": 0.04, "q":', *LINES[4:]], r"row 5 needs an object of JSON, .* \(Expecting"),
        ([*LINES, "[" * 100_000], rf"row {N + 1} needs an object of JSON"),
        (["", *LINES[:3], {**LINES[3], "q.1": 2}, *LINES[4:]], r"row 5 has two values named 'q.1'"),
        ([*LINES[:9], {"time": T[9], "q": [0.1]}, *LINES[10:]], "row 10, column 'q.1' is empty"),
        ([*LINES[:9], {**LINES[9], "q": [0.1, "x"]}, *LINES[10:]], "row 10, column 'q.1' needs a number"),
        ([*LINES[:9], {**LINES[9], "q": [0.1, 1e400]}, *LINES[10:]], "row 10, column 'q.1' needs a finite"),
        ([json.dumps(LINES)], "row 1 needs an object of JSON"),
    ):
        path = written(tmp_path / "log.jsonl", rows)
        mapping = {"joints": {joint: {"position": own["position"]} for joint, own in OF_JOINTS.items()}}
        assert re.search(message, sentence_of(read_log, path, LEG, mapping))
