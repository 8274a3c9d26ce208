"""Computed columns, coupled motors, selected rows and times, and text in other layouts."""

import gzip

import numpy as np
import pytest
from malformed_logs import DQ, PLAIN, N, Q, T, text

from ident.errors import LogError
from ident.mechanism.body import Body
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.recordings.columns.entries import couplings
from ident.recordings.log import read_log, read_log_pieces

NAMES = ("leg", "torso")
AXIS = np.eye(6)[4]
MECHANISM = Mechanism(
    Tree(tuple(Body(NAMES[k], k - 1, np.eye(4), AXIS, joint) for k, joint in enumerate(("ankle", "hip")))),
    np.array([0, 0, -9.81]),
)
R = np.array([[2.0, 0.5], [-0.25, 4.0]])


def read(tmp_path, columns, mapping, name="log.csv", **options):
    content = (columns if isinstance(columns, str) else text(columns)).encode()
    (tmp_path / name).write_bytes(gzip.compress(content) if name.endswith(".gz") else content)
    (tmp_path / "c.toml").write_text(mapping)
    return read_log(tmp_path / name, MECHANISM, tmp_path / "c.toml", **options)


def test_gain_constant_and_unit(tmp_path):
    columns = {"frame": 5 * np.arange(N), "a": 10 - np.rad2deg(Q[:, 0]), "h": 1000 * Q[:, 1], "i": T + 1, "fz": T - 7}
    mapping = """
    time = { column = "frame", gain = 2, unit = "ms" }
    [joints.ankle]
    position = { column = "a", gain = -1, constant = 10, unit = "deg" }
    torque = { column = "i", unit = "mA", gain = 0.5, constant = 0.25 }
    [joints.hip]
    position = { column = "h", gain = 0.001 }
    [wrenches.ground]
    force = ["", "", { column = "fz", gain = -2, constant = 1 }]
    unit = "kN"
    """
    log = read(tmp_path, columns, mapping)
    np.testing.assert_allclose(log.time, T, atol=1e-12)
    np.testing.assert_allclose(log.of_joints(("ankle", "hip"), "position"), Q, atol=1e-12)
    np.testing.assert_allclose(log["ankle_torque"], 0.0005 * (T + 1) + 0.25, atol=1e-12)
    np.testing.assert_allclose(log["ground_force"][:, 2], 1000 * (1 - 2 * (T - 7)))
    assert log.units == {"ankle_position": "rad", "ankle_torque": "N m", "ground_force": "N"}
    assert log.unused == [] and log.notes == []


COUPLED = f"""
[motors.wrist]
joints = ["ankle", "hip"]
matrix = {R.tolist()}
position = [{{ column = "q1", unit = "deg" }}, {{ column = "q2", unit = "deg", constant = 30 }}]
velocity = ["dq1", "dq2"]
torque = [{{ column = "i1", gain = 0.1, unit = "A" }}, {{ column = "i2", gain = 0.2, unit = "A" }}]
"""


def coupled():
    motors, rates, currents = Q @ R.T, DQ @ R.T, np.stack([T, 1 - T], axis=1)
    columns = {"time": T, "q1": np.rad2deg(motors[:, 0]), "q2": np.rad2deg(motors[:, 1]) - 30}
    return columns | {"dq1": rates[:, 0], "dq2": rates[:, 1], "i1": currents[:, 0], "i2": currents[:, 1]}


def test_friction_belongs_to_motors_that_are_coupled_unless_stated(tmp_path):
    assert read(tmp_path, coupled(), COUPLED).couplings == {
        f"wrist {k}": dict(zip(("ankle", "hip"), row, strict=True)) for k, row in enumerate(R.tolist(), start=1)
    }
    for other in (COUPLED + 'friction = "joints"\n', COUPLED.replace(str(R.tolist()), "[[0, 2], [-3, 0]]")):
        assert read(tmp_path, coupled(), other).couplings == {}
    with pytest.raises(LogError, match=r"\[motors.wrist\] has a motor 'wrist 2', and a joint is named so too"):
        couplings("motors.wrist", {}, ["wrist 2", "hip"], R, ["wrist 2", "hip"])


def test_selected_rows_and_times(tmp_path):
    junk = text(PLAIN).splitlines()
    junk[1] = "[s],[rad],[rad]"
    log = read(tmp_path, "\n".join(junk), "[select]\nrows = [3, 30]")
    np.testing.assert_allclose(log.time, T[1:29], atol=1e-12)
    late = {**PLAIN, "q_hip": np.where(T < 0.095, np.nan, Q[:, 1])}
    np.testing.assert_allclose(read(tmp_path, late, "[select]\ntime = [0.095, 0.3]").time, T[10:31], atol=1e-12)
    clock = {**PLAIN, "time": T + 1.7e9}
    assert len(read(tmp_path, clock, "[select]\ntime = [0.095, 0.3]").time) == 21
    two = "[select]\ntime = [[0, 0.1], [0.2, 0.3]]"
    assert len(read(tmp_path, PLAIN, two, gaps=True).as_measured("hip_position").time) == 22
    with pytest.raises(LogError, match=r"has a gap of 0\.1 s, from 0\.1 s to 0\.2 s.* \(--gaps, gaps=True in Python\)"):
        read(tmp_path, PLAIN, two)
    pieces = read_log_pieces(tmp_path / "log.csv", MECHANISM, tmp_path / "c.toml", 10)
    with pytest.raises(LogError, match=r"has a gap of 0\.1 s"):
        list(pieces)
    (tmp_path / "c.toml").write_text("[select]\ntime = [0.1, 0.3]")
    pieces = list(read_log_pieces(tmp_path / "log.csv", MECHANISM, tmp_path / "c.toml", 10))
    np.testing.assert_allclose(np.concatenate([piece.time for piece in pieces]), T[10:31], atol=1e-12)


def test_one_wrong_stamp_is_told(tmp_path):
    wrong = {**PLAIN, "time": T + 3e8 * (np.arange(N) == N - 1)}
    with pytest.raises(LogError, match=r"column 'time' jumps from 0\.38 s to 300000000\.4 s where 40 samples"):
        read(tmp_path, wrong, "", gaps=True)


def test_packed_text_unpacks_to_no_more_than_is_expected(tmp_path):
    header, row = "time,q_ankle,q_hip\n", "0.0,0.0,0.0\n"
    for content in (header + 100_000 * row, header + "0" * 2_000_000):
        (tmp_path / "log.csv.gz").write_bytes(gzip.compress(content.encode()))
        with pytest.raises(LogError, match=r"takes 1 MB in memory where at most 0 MB .*--max-size"):
            read_log(tmp_path / "log.csv.gz", MECHANISM, limit=500_000)
    packed = gzip.compress((text(PLAIN)).encode())
    for damaged in (
        packed[:-9],
        packed[: len(packed) // 2],
        b"\x1f\x8b" + b"\x00" * 40,
        b"time",
        packed[:40] + b"!" * 60,
    ):
        (tmp_path / "log.csv.gz").write_bytes(damaged)
        with pytest.raises(LogError, match=r"log\.csv\.gz: the file needs to be packed by gzip, whole and undamaged"):
            read_log(tmp_path / "log.csv.gz", MECHANISM)


HIP = "[joints.hip]\nposition = "
BAD = {
    "no gain": (
        '[joints.hip]\ntorque = { column = "time", unit = "A" }',
        "torque in A needs a gain, in the joint's",
    ),
    "gain of no number": (HIP + '{ column = "q_hip", gain = "1" }', "joints.hip.position.gain needs a number, got 1"),
    "gain of zero": (HIP + '{ column = "q_hip", gain = 0 }', "a gain other than zero"),
    "both": (HIP + '{ column = "q_hip", columns = ["time"] }', "needs a column or several columns, got both"),
    "weights of one": (HIP + '{ column = "q_hip", weights = [1] }', "has weights, which are for several columns"),
    "too many weights": (HIP + '{ columns = ["q_hip", "time"], weights = [1] }', "weights needs a list of 2 numbers"),
    "a weight of zero": (HIP + '{ columns = ["q_hip", "time"], weights = [1, 0] }', "needs numbers other than zero"),
    "one column twice": (HIP + '{ columns = ["q_hip", "q_hip"] }', "needs names of different columns"),
    "no columns": (HIP + "{ columns = [] }", "joints.hip.position needs the name of a column, got []"),
    "unknown column": (HIP + '{ columns = ["q_hip", "m"] }', "joints.hip.position is mapped to column 'm', but"),
    "two uses": (HIP + '{ column = "q_ankle", gain = -1 }', "column 'q_ankle' is mapped to joints.hip.position and"),
    "ampere of a position": (HIP + '{ column = "q_hip", unit = "A", gain = 1 }', "unit needs one of rad, deg; got A"),
    "unknown joint": (
        '[motors.a]\njoints = ["knee"]\nmatrix = [[1]]',
        "motors.a.joints needs a list of joints, of",
    ),
    "matrix": ('[motors.a]\njoints = ["hip"]\nmatrix = [[1, 2]]', "motors.a.matrix needs a list of 1 numbers"),
    "rows": ('[motors.a]\njoints = ["hip"]\nmatrix = 3', "motors.a.matrix needs a row for each of 1 motors, got 3"),
    "singular": (
        '[motors.a]\njoints = ["hip", "ankle"]\nmatrix = [[1, 2], [2, 4]]\nposition = ["q_hip", "q_ankle"]',
        "[motors.a] needs a matrix that can be inverted",
    ),
    "motors and joint": (
        HIP + '"q_hip"\n[motors.a]\njoints = ["hip"]\nmatrix = [[1]]\nposition = ["q_hip"]',
        "joints.hip.position is mapped twice, under [joints] and by motors",
    ),
    "friction": (
        '[motors.a]\njoints = ["hip"]\nmatrix = [[1]]\nfriction = "none"',
        "motors.a.friction needs one of motors, joints; got none",
    ),
    "missing motor": (
        '[motors.a]\njoints = ["hip"]\nmatrix = [[1]]\nposition = [""]',
        "motors.a.position needs 1 columns, none of them may be missing",
    ),
    "header": ('[file]\nheader = "no"', "file.header needs true or false, got no"),
    "skip": ("[file]\nskip = -1", "file.skip needs a number of lines, got -1"),
    "skip all": ("[file]\nskip = 99", "the file is empty"),
    "backwards": ("[select]\nrows = [9, 3]", "select.rows needs two numbers, the first before the last; got [9, 3]"),
    "no span": ("[select]\ntime = 3", "select.time needs two numbers, the first before the last; got 3"),
    "rows beyond": (
        "[select]\nrows = [100, 200]",
        "rows that the file has, got 100 to 200; the file has rows 2 to 41",
    ),
    "times beyond": ("[select]\ntime = [5, 6]", "needs times that the file has, got 5 to 6; its times go from 0 s to"),
    "too few": ("[select]\nrows = [2, 6]", "a log needs at least 10 samples, it has 5"),
}


@pytest.mark.parametrize(("mapping", "message"), BAD.values(), ids=BAD.keys())
def test_mappings_that_cannot_be_are_one_sentence(tmp_path, mapping, message):
    with pytest.raises(LogError) as error:
        read(tmp_path, PLAIN, mapping)
    assert message in str(error.value) and "\n" not in str(error.value)
    assert str(error.value).startswith(str(tmp_path))
