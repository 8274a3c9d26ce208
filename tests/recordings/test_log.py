"""Logs in tables of text: layouts, mappings, jitter, suspected units, and one sentence for what cannot be read."""

import numpy as np
import pytest
from commands import sentence_of
from malformed_logs import DQ, JOINTS, LEG, PLAIN, WRENCH, N, Q, T, leg, read, replaced, retimed, text
from scipy.spatial.transform import Rotation

from ident import LogError, read_log
from ident.recordings.channels import unmapped

OUCH = {"time": T, "remark": T, "q_hip": Q[:, 1], "q_ankle": Q[:, 0]}


@pytest.mark.parametrize(
    "content",
    [
        *(text(PLAIN, end=end) for end in ("\n", "\r\n", "\r")),
        *(text(PLAIN, *layout) for layout in (";", ";,", "\t", "\t,")),
        text(PLAIN).rstrip(),
        "\ufeff" + text(PLAIN),
        *(text(PLAIN).encode(encoding) for encoding in ("utf-16", "utf-16-le", "utf-16-be")),
        text(PLAIN).replace(",", " , "),
        text(PLAIN).replace("\n", ",\n"),
        text(PLAIN).replace("q_hip", '"q_hip"'),
        "# a comment\n\n" + text(PLAIN) + "\n\n",
        text(OUCH).replace("\n0.01,0.01,", "\n0.01,ouch,"),
    ],
)
def test_what_spreadsheets_write_is_read(tmp_path, content):
    log = read(tmp_path, content)
    np.testing.assert_allclose(log.time, T, atol=1e-12)
    np.testing.assert_array_equal(log.of_joints(JOINTS, "position"), Q)
    assert list(log.measured) == ["ankle_position", "hip_position"] and log.rate == pytest.approx(100)
    assert (log.torques(JOINTS), log.base, log.wrenches, log.notes) == (None, None, (), [])


MAPPING = """
time = { column = "t", unit = "ms" }
[joints.ankle]
position = { column = "winkel", unit = "deg" }
velocity = { column = "rate", unit = "deg/s" }
[joints.hip]
position = "h"
velocity = "dh"
torque = { column = "h_moment", unit = "N mm" }
[wrenches.ground]
force = ["p1", "p2", "p3"]
torque = ["", "p5", ""]
unit = "kN"
torque_unit = "N mm"
position = [0.1, 0, -0.2]
rpy_deg = [0, 0, 90]
applied_to_link = false
[wrenches.handle]
force = ["h1", "h2", "h3"]
body = "torso"
quaternion = [0.5, 0.5, 0.5, 0.5]
[base]
position = ["x", "y", "z"]
quaternion = ["qw", "qx", "qy", "qz"]
unit = "mm"
"""
TURNS = Rotation.from_rotvec(np.outer(9 * T, [0, 0, 1]))
COLUMNS = {"t": 1000 * T, "winkel": np.rad2deg(Q[:, 0]), "rate": np.rad2deg(DQ[:, 0]), "h": Q[:, 1], "dh": DQ[:, 1]}
COLUMNS |= {"h_moment": 1000 * T} | {f"p{k + 1}": WRENCH[:, k] for k in range(6)}
COLUMNS |= {f"h{k + 1}": -WRENCH[:, k] for k in range(3)} | {axis: 1000 * WRENCH[:, k] for k, axis in enumerate("xyz")}
COLUMNS |= {f"q{c}": x * (-1) ** np.arange(N) for c, x in zip("wxyz", TURNS.as_quat(scalar_first=True).T, strict=True)}


def test_a_mapping_names_converts_and_places(tmp_path):
    log = read(tmp_path, text(COLUMNS), MAPPING)
    ground, handle = log.wrench("ground"), log.wrench("handle")
    for own, expected in (
        (log.time, T),
        (log.of_joints(JOINTS, "position"), Q),
        (log.of_joints(JOINTS, "velocity"), DQ),
        (log["hip_torque"], T),
        (ground.values[:, :3], 1000 * WRENCH[:, :3]),
        (ground.values[:, 4], WRENCH[:, 4] / 1000),
        (ground.pose, [[0, -1, 0, 0.1], [1, 0, 0, 0], [0, 0, 1, -0.2], [0, 0, 0, 1]]),
        (handle.pose[:3, :3], [[0, 0, 1], [1, 0, 0], [0, 1, 0]]),
        (log.base[:, :3, 3], WRENCH[:, :3]),
        (log.base[:, :3, :3], TURNS.as_matrix()),
    ):
        np.testing.assert_allclose(own, expected, rtol=1e-12, atol=1e-12)
    assert np.isnan(ground.values[:, [3, 5]]).all()
    assert (ground.applied_to_link, handle.applied_to_link, handle.body) == (False, True, "torso")
    units = {"ankle_position": "rad", "ankle_velocity": "rad/s", "hip_torque": "N m"}
    assert log.units == units | {"ground_force": "N", "ground_torque": "N m"}


def test_jitter_is_resampled_and_told(tmp_path):
    time = T + np.r_[0, np.random.default_rng(0).uniform(-0.0008, 0.0008, N - 2), 0]
    log = read(tmp_path, text({"time": time, "ankle": 3 * time, "hip": 1 - time}))
    expected = np.stack([3 * log.time, 1 - log.time], axis=1)
    np.testing.assert_allclose(log.of_joints(JOINTS, "position"), expected, atol=1e-12)
    np.testing.assert_allclose(np.diff(log.time), log.time[-1] / (len(log.time) - 1))
    (note,) = log.notes
    assert "jitter" in note and "resampled linearly" in note


def test_forces_far_below_the_weight_are_suspected(tmp_path):
    content = text(PLAIN | {"ground_fz": 0.6 + 0 * T, "ground_mx": T})
    assert "may be kN" in read(tmp_path, content, mechanism=leg(600.0)).notes[0]
    assert read(tmp_path, content, mechanism=leg(60.0)).notes == []
    stated = '[wrenches.ground]\nforce = ["", "", "ground_fz"]\nunit = "N"\n'
    assert read(tmp_path, content, stated, mechanism=leg(600.0)).notes == []


def test_columns_that_are_not_mapped_are_named():
    assert "it has the columns emg, theta; none is mapped as a wrench" in unmapped(["emg", "theta"])
    assert "it has no columns;" in unmapped([])


@pytest.mark.parametrize("sign", [1, -1])
def test_the_largest_time_and_the_largest_number(tmp_path, sign):
    """No clock exceeds 1e30, and no channel 1e8 of its SI unit, in any unit."""
    seconds = 'time = { column = "time", unit = "s" }'
    with pytest.raises(LogError, match=r"row 2, column 'time' needs numbers below 1e\+30"):
        read(tmp_path, retimed(1.1e30 * sign + 10 * T), seconds)
    kilo = '[wrenches.ground]\nforce = ["", "", "ground_fz"]\nunit = "kN"'
    for mapping, limit in ((None, 1e8), (kilo, 1e5)):
        near, beyond = (text(PLAIN | {"ground_fz": share * sign * limit + T}) for share in (0.9, 1.1))
        np.testing.assert_allclose(read(tmp_path, near, mapping).wrench("ground").values[0, 2], 0.9e8 * sign)
        assert "row 2, column 'ground_fz' needs numbers below" in sentence_of(read, tmp_path, beyond, mapping)


COUNT = np.arange(N)
SWEEPS = PLAIN | {"q_hip": np.rad2deg(Q[:, 1])}
RATES = PLAIN | {"dq_ankle": DQ[:, 0], "dq_hip": DQ[:, 1]}
LOGS = [
    ("", "the file is empty; a log is a header row"),
    ("time,q_ankle,q_hip\n", "at least 10 samples, it has 0"),
    ("\n".join(text(PLAIN).splitlines()[1:]), "header row of names, row 1 holds numbers"),
    (b"\x89\xff\x00\x01" * 30, "text in UTF-8, a byte 0x89 is not"),
    (replaced(9, "q_hip", '"0.5'), "row 9 opens a quotation mark that it does not close"),
    (replaced(17, "q_hip", "1_0"), "row 17, column 'q_hip' needs a number, got '1_0'"),
    ("# c\n" + replaced(5, "q_hip", "?"), "row 6, column 'q_hip' needs a number, got '?'"),
    (text(PLAIN, ";", ",").replace("\n0,01;", "\n1,000,001;"), "row 3, column 'time' needs a number, got '1,000,001'"),
    (text(PLAIN) + "0.4,1\n", "row 42 has 2 cells where the header has 3"),
    (text(PLAIN, ";", ",").replace("0,01;", "0.01;"), "decimal commas (column 'q_ankle') and decimal points"),
    (text(PLAIN).replace("q_ankle", "q_hip"), "names column 'q_hip' more than once"),
    (text(PLAIN | {"hip": T}), "columns q_hip and hip may both be the position of joint 'hip'; keep one"),
    (text(PLAIN).replace("time", "zeit"), "as in rate = 100; the file has zeit"),
    (text(PLAIN).replace("q_hip", "q_knee"), "joint 'hip' needs a column of its positions, named hip_position, q_hip"),
    (replaced(9, "q_hip", "nan"), "row 9, column 'q_hip' is empty or NaN, as are 1 of 40 samples"),
    (text(PLAIN | {"ground_fz": np.where(T > 0.2, np.nan, 1)}), "row 23, column 'ground_fz' is empty"),
    (replaced(9, "q_hip", "-inf"), "row 9, column 'q_hip' needs a finite number"),
    (text({**PLAIN, "q_hip": T * np.nan}), "column 'q_hip' is empty, but joints.hip.position needs it"),
    (retimed(T * np.nan), "column 'time' is empty, but a log needs times"),
    (retimed(np.where(COUNT == 20, 0.1, T)), "row 22, column 'time' goes back in time by 0.09 s; sort the log"),
    (retimed(np.where(COUNT < 20, T + 9, T)), "one by [select] rows = [2, 21] or [22, 41] in the columns file"),
    (
        retimed(np.where(COUNT < 20, T, T - 0.1)),
        "goes back in time by 0.09 s and goes on from there: a clock was reset",
    ),
    (retimed(np.where(COUNT == 20, T[19], T)), "row 22, column 'time' repeats the time"),
    (text({name: 0 * x for name, x in PLAIN.items()}), "10 samples at different times, it has 1"),
    (retimed(T + (T > 0.2) * 0.03), "row 23, column 'time' has a gap of 0.04 s, from 0.2 s to 0.24 s, where"),
    (retimed(T + (T > 0.1) * 0.02 + (T > 0.2) * 0.03), "steps are 0.01 s; it is the longest of 2 gaps. A filter would"),
    (retimed(1000 * T), "steps of 10 s, which suggests that its unit is not the second"),
    (text(SWEEPS), "column 'q_hip', the position of joint 'hip', ranges over"),
    (text(RATES | {"dq_ankle": 57.3 * DQ[:, 0]}), "velocity of joint 'ankle' is 57.3 times the derivative of its pos"),
    (text(RATES | {"ddq_ankle": -430 * np.sin(5 * T), "ddq_hip": T}), "the acceleration of joint 'ankle' is 57.3"),
]

GROUND = '[wrenches.ground]\nforce = ["a", "b", "c"]\n'
CONTACT = '[wrenches.grip]\nforce = ["a", "b", "c"]\n'
HIP = "[joints.hip]\nposition = "
MOTOR = '[motors.a]\njoints = ["hip"]\nmatrix = '
TWO_MOTORS = '[motors.a]\njoints = ["hip", "ankle"]\nmatrix = [[1, 2], [2, 4]]\n'
MAPPINGS = [
    ("time = = 3", "needs to be TOML in UTF-8"),
    ("[joint.hip]", "the mapping has no entry 'joint'; valid are time, rate, poses, joints, motors, wr"),
    ('time = { colum = "t" }', "time has no entry 'colum'; valid are column, columns, weights"),
    ('time = "zeit"', "time is mapped to column 'zeit', but the file has time, q_ankle, q_hip"),
    (HIP + '{ column = "q_hip", unit = "A", gain = 1 }', "joints.hip.position.unit needs one of rad, deg; got A"),
    ('[joints.hip]\ntorque = { column = "time", unit = "A" }', "torque in A needs a gain, in the joint's"),
    (HIP + '{ unit = "deg" }', "joints.hip.position needs the name of a column, got"),
    (HIP + '{ column = "q_hip", gain = 0 }', "a gain other than zero"),
    (HIP + '{ column = "q_hip", columns = ["time"] }', "needs a column or several columns, got both"),
    (HIP + '{ column = "q_hip", weights = [1] }', "has weights, which are for several columns"),
    (HIP + '{ columns = ["q_hip", "time"], weights = [1] }', "weights needs a list of 2 numbers"),
    (HIP + '{ columns = ["q_hip", "time"], weights = [1, 0] }', "needs numbers other than zero"),
    (HIP + '{ columns = ["q_hip", "q_hip"] }', "needs names of different columns"),
    (HIP + '"q_ankle"', "column 'q_ankle' is mapped to joints.hip.position and to"),
    ("[wrenches.ground]", "[wrenches.ground] needs at least one column under force or"),
    ('[wrenches.ground]\nforce = ["a", "b"]', "wrenches.ground.force needs a list of 3 columns, got"),
    (GROUND, "wrenches.ground.force is mapped to column 'a', but the file has"),
    (GROUND + "quaternion = [1, 1, 0, 0]", "quaternion needs four numbers w, x, y, z of norm 1"),
    (GROUND + "quaternion = [1, 0, 0, 0]\nrpy_deg = [0, 0, 0]", "a quaternion or rpy_deg, got both"),
    (GROUND + 'body = "leg"', "[wrenches.ground] needs no body: the ground acts at the base"),
    (CONTACT, "[wrenches.grip] needs a body, one of leg, torso; got None"),
    ('[base]\nposition = ["a", "b", "c"]', "base.quaternion needs a list of 4 columns"),
    ('[base]\nposition = ["a", "", "c"]', "base.position needs 3 columns, none of them may be"),
    ('[base]\nposition = ["x", "y", "z"]\nquaternion = ["x", "y", "z", "w"]', "column 'x' is mapped to base.position"),
    ('[motors.a]\njoints = ["knee"]\nmatrix = [[1]]', "motors.a.joints needs a list of joints, of"),
    (MOTOR + "[[1, 2]]", "motors.a.matrix needs a list of 1 numbers"),
    (MOTOR + "3", "motors.a.matrix needs a row for each of 1 motors, got 3"),
    (TWO_MOTORS + 'position = ["q_hip", "q_ankle"]', "[motors.a] needs a matrix that can be inverted"),
    (MOTOR + '[[1]]\nposition = [""]', "motors.a.position needs 1 columns, none of them may be missing"),
    (HIP + '"q_hip"\n' + MOTOR + '[[1]]\nposition = ["q_hip"]', "joints.hip.position is mapped twice, under [joints]"),
    ("[file]\nskip = -1", "file.skip needs a number of lines, got -1"),
    ("[select]\nrows = [9, 3]", "select.rows needs two numbers, the first before the last; got [9, 3]"),
    ("[select]\nrows = [100, 200]", "rows that the file has, got 100 to 200; the file has rows 2 to 41"),
    ("[select]\ntime = [5, 6]", "needs times that the file has, got 5 to 6; its times go from 0 s to"),
    ("[select]\nrows = [2, 6]", "a log needs at least 10 samples, it has 5"),
    ("rate = 0", "rate needs a number of samples per second, in Hz; got 0"),
    ('rate = 100\ntime = "time"', "has time and rate; rate is for a log without times"),
    ('time = { rate = 5, column = "t" }', "time has no entry 'column'; valid are rate"),
]
REFUSED = [(content, None, message) for content, message in LOGS]
REFUSED += [(text(PLAIN), mapping, message) for mapping, message in MAPPINGS]


@pytest.mark.parametrize(("content", "mapping", "message"), REFUSED, ids=[row[2] for row in REFUSED])
def test_what_cannot_be_read_is_one_sentence(tmp_path, content, mapping, message):
    sentence = sentence_of(read, tmp_path, content, mapping)
    assert sentence.startswith(str(tmp_path)) and message in sentence


def test_of_samples_at_one_time_the_first_counts_where_some_may_be_missing(tmp_path):
    log = read(tmp_path, {**PLAIN, "time": np.where(COUNT == 20, T[19], T)}, gaps=True)
    assert "Samples at the time of the one before were dropped: 1, the first is row 22." in log.notes
    assert len(log.as_measured("hip_position").time) == N - 1


def test_files_that_are_no_logs(tmp_path):
    (tmp_path / "log.xlsx").write_text("")
    (tmp_path / "log.csv.gz").write_text("time")
    for name, reason in {
        "log.csv.gz": "the file needs to be packed by gzip, whole and undamaged",
        "missing.csv": "there is no such file",
        "missing.bag": "there is no such file",
        "log.xlsx": "logs end in .csv, .tsv, ",
        ".": "the folder needs metadata.yaml",
    }.items():
        assert reason in sentence_of(read_log, tmp_path / name, LEG)
    (tmp_path / "log.csv").write_text(text(PLAIN))
    with pytest.raises(LogError, match=r"no.toml: a mapping of columns needs to be TOML in UTF-8 \(No such file"):
        read_log(tmp_path / "log.csv", LEG, columns=tmp_path / "no.toml")
