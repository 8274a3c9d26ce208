"""Units of columns, against the constants of physics, wrapped angles, computed columns, and selected rows and times."""

import re

import numpy as np
import pytest
from malformed_logs import LEG, PLAIN, N, Q, T, read, text
from scipy import constants

from ident import LogError, read_log
from ident.files.table import UNITS
from ident.recordings.channels import unwrapped
from ident.recordings.stated import couplings

TIME = np.arange(900) / 100
ANGLE = 2.2 * np.sin(1.9 * TIME) + 1.7 * np.sin(0.7 * TIME) + 1.5
DEG, TURN = 180 / np.pi, 2 * np.pi


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


COUPLED = """
[motors.wrist]
joints = ["ankle", "hip"]
matrix = [[2, 0.5], [-0.25, 4]]
position = ["time", "q_hip"]
"""


def test_friction_belongs_to_motors_that_are_coupled_unless_stated(tmp_path):
    coupled = {"wrist 1": {"ankle": 2.0, "hip": 0.5}, "wrist 2": {"ankle": -0.25, "hip": 4.0}}
    untimed = "rate = 100\n" + COUPLED
    assert read(tmp_path, PLAIN, untimed).couplings == coupled
    for other in (untimed + 'friction = "joints"\n', untimed.replace("[[2, 0.5], [-0.25, 4]]", "[[0, 2], [-3, 0]]")):
        assert read(tmp_path, PLAIN, other).couplings == {}
    with pytest.raises(LogError, match=r"\[motors.wrist\] has a motor 'wrist 2', and a joint is named so too"):
        couplings("motors.wrist", {}, ["wrist 2", "hip"], np.array([[2, 0.5], [-0.25, 4]]), ["wrist 2", "hip"])


def test_selected_rows_and_times_and_a_wrong_stamp_among_them(tmp_path):
    wrong = {**PLAIN, "time": T + 3e8 * (np.arange(N) == N - 1)}
    with pytest.raises(LogError, match=r"column 'time' jumps from 0\.38 s to 300000000\.4 s where 40 samples"):
        read(tmp_path, wrong, "", gaps=True)
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


def read_hip(columns, **entries):
    """The log of a leg with these entries for its hip, whose ankle does not turn around."""
    joints = {"hip": entries, "ankle": {"position": "b"}}
    return read_log({"time": TIME, "b": 0.1 * ANGLE, **columns}, LEG, {"joints": joints})


@pytest.mark.parametrize("lowest", [0.0, -0.5])
@pytest.mark.parametrize(
    ("factor", "turn", "entry"),
    [
        (1.0, TURN, {}),
        (-DEG, 360.0, {"unit": "deg", "gain": -1}),
        (4096 / TURN, 4096.0, {"gain": TURN / 4096}),
        (5 * DEG, 360.0, {"unit": "deg", "gain": 0.2}),
    ],
)
def test_wrapped_angles_are_read_as_continuous(lowest, factor, turn, entry):
    x = (factor * ANGLE - lowest * turn) % turn + lowest * turn
    log = read_hip({"a": x}, position={"column": "a", **entry})
    shift, number = log["hip_position"] - ANGLE, int((np.abs(np.diff(x)) > turn / 2).sum())
    assert number and np.abs(shift - shift[0]).max() < 1e-6
    (note,) = (note for note in log.notes if "whole turn" in note)
    assert note.startswith(f"Column 'a' jumps by a whole turn {number} times")
    np.testing.assert_allclose(log["ankle_position"], 0.1 * ANGLE, atol=1e-9)


@pytest.mark.parametrize("decimals", [3, 4])
def test_rests_at_half_a_turn_are_continuous_in_any_number_of_decimals(decimals):
    angle = np.pi - 1 + np.cos(np.maximum(TIME - TIME[-1] / 3, 0)) + 1e-4 * np.cos(1e3 * TIME)
    out, number = unwrapped(np.round((angle + np.pi) % TURN - np.pi, decimals), (TURN,))
    assert number > 10 and np.abs(out - out[0] - angle + angle[0]).max() < 10.0**-decimals


def test_steps_spikes_and_several_turns_are_no_wrapped_angles():
    step, spike = np.where(TIME < 4, 0.0, 5.5), np.where(np.abs(TIME - 4) < 0.004, ANGLE + 6.28, ANGLE)
    for x in (ANGLE, step, spike, 10 * ANGLE):
        out, number = unwrapped(x, (TURN,))
        assert out is x and number == 0


def test_commands_are_in_the_turn_of_their_positions():
    columns = {"a": ANGLE % TURN, "u": (ANGLE - ANGLE[0] - 0.01) % TURN}
    log = read_hip(columns, position="a", command="u", kp=5)
    assert np.abs(log["hip_command"] - log["hip_position"]).max() < np.pi
