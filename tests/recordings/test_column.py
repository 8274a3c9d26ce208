"""Units of columns, against the constants of physics, wrapped angles, computed columns, and selected rows and times."""

import gzip
import re

import mujoco
import numpy as np
import pytest
from malformed_logs import DQ, LEG, PLAIN, N, Q, T, read, text
from scipy import constants

import ident
import sim
from ident.errors import LogError
from ident.files.column import UNITS
from ident.recordings.entries import couplings
from ident.recordings.faults import unwrapped
from ident.recordings.log import read_log, read_log_pieces

R = np.array([[2.0, 0.5], [-0.25, 4.0]])


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
    pieces = read_log_pieces(tmp_path / "log.csv", LEG, tmp_path / "columns.toml", 10)
    with pytest.raises(LogError, match=r"has a gap of 0\.1 s"):
        list(pieces)
    (tmp_path / "columns.toml").write_text("[select]\ntime = [0.1, 0.3]")
    pieces = list(read_log_pieces(tmp_path / "log.csv", LEG, tmp_path / "columns.toml", 10))
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
            read_log(tmp_path / "log.csv.gz", LEG, limit=500_000)
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
            read_log(tmp_path / "log.csv.gz", LEG)


SI = {"rad": 1.0, "deg": constants.degree, "rpm": 2 * constants.pi / constants.minute, "s": 1.0, "ms": constants.milli}
SI |= {"us": constants.micro, "ns": constants.nano, "N": 1.0, "mN": constants.milli, "kN": constants.kilo, "m": 1.0}
SI |= {"cm": constants.centi, "mm": constants.milli, "1": 1.0}


def factor(unit):
    """Factor of a unit to SI's: of rates per second, of moments as a force times an arm."""
    unit, force = re.sub("/s(2|\\^2|²)?$", "", unit), re.match("[mk]?N(?= ?m)", unit)
    return SI[force[0]] * SI[unit[force.end() :].strip()] if force else SI[unit]


@pytest.mark.parametrize("quantity", UNITS)
def test_units_are_what_they_are_in_si(quantity):
    assert UNITS[quantity] == pytest.approx({unit: factor(unit) for unit in UNITS[quantity]}, rel=1e-12)
    assert next(iter(UNITS[quantity].values())) == 1


TIME = np.arange(900) / 100
WRAPPED = 2.2 * np.sin(1.9 * TIME) + 1.7 * np.sin(0.7 * TIME) + 1.5
DEG = 180 / np.pi
MODEL = """<mujoco><worldbody><body><inertial pos=".1 0 0" mass="1" diaginertia=".1 .1 .1"/>
<joint name="hip" axis="0 1 0"/><body pos=".3 0 0"><inertial pos=".1 0 0" mass="1" diaginertia=".1 .1 .1"/>
<joint name="ram" type="slide" axis="1 0 0"/></body></body></worldbody></mujoco>"""


def wrapped(x, turn=2 * np.pi, from_turns=0.0):
    return (x - from_turns * turn) % turn + from_turns * turn


def read_arm(hip, entry, **more):
    """The log of an arm with this entry for its first joint."""
    columns = {"time": TIME, "a": hip, "b": 0.1 * WRAPPED, **more}
    arm = sim.mechanism(mujoco.MjSpec.from_string(MODEL))
    return ident.read_log(columns, arm, {"joints": {"hip": entry, "ram": {"position": "b"}}})


@pytest.mark.parametrize("from_turns", [0.0, -0.5])
@pytest.mark.parametrize(
    ("factor", "turn", "entry"),
    [
        (1.0, 2 * np.pi, {}),
        (DEG, 360.0, {"unit": "deg"}),
        (-DEG, 360.0, {"unit": "deg", "gain": -1}),
        (4096 / (2 * np.pi), 4096.0, {"gain": 2 * np.pi / 4096}),
        (5 * DEG, 360.0, {"unit": "deg", "gain": 0.2}),
    ],
    ids=["rad", "deg", "turned", "counts", "before a gear"],
)
def test_wrapped_angles_are_read_as_continuous(from_turns, factor, turn, entry):
    x = wrapped(factor * WRAPPED, turn, from_turns)
    log = read_arm(x, {"position": {"column": "a"} | entry})
    shift = log["hip_position"] - WRAPPED
    assert np.ptp(np.abs(np.diff(x))) > turn / 2 and np.abs(shift - shift[0]).max() < 1e-6
    (note,) = (note for note in log.notes if "whole turn" in note)
    number = int((np.abs(np.diff(x)) > turn / 2).sum())
    assert note.startswith(f"Column 'a' jumps by a whole turn {number} times")
    assert np.abs(log["ram_position"] - 0.1 * WRAPPED).max() < 1e-9


@pytest.mark.parametrize(
    "x",
    [WRAPPED, np.where(TIME < 4, 0.0, 5.5), np.where(np.abs(TIME - 4) < 0.004, WRAPPED + 6.28, WRAPPED), 10 * WRAPPED],
    ids=["no jump", "a step", "a spike", "several turns"],
)
def test_what_is_no_wrapped_angle_is_unchanged(x):
    out, number = unwrapped(x, (2 * np.pi,))
    spike = np.abs(out - WRAPPED).max() < 0.01
    assert (number == 0 and out is x) or (spike and number == 2)


def test_commands_are_in_the_turn_of_their_positions():
    command = wrapped(WRAPPED - WRAPPED[0] - 0.01)
    log = read_arm(wrapped(WRAPPED), {"position": "a", "command": "u", "kp": 5}, u=command)
    assert np.abs(log["hip_command"] - log["hip_position"]).max() < np.pi
