"""Units of logs, against the constants of physics, and wrapped angles."""

import re

import numpy as np
import pytest
from guesses.odd_logs import text
from scipy import constants

import ident
import sim
from ident.files.column import UNITS
from ident.recordings.plausibility import unwrapped

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


def from_zero(x, turn):
    return x % turn


def about_zero(x, turn):
    return (x + turn / 2) % turn - turn / 2


@pytest.fixture
def arm(tmp_path):
    (tmp_path / "arm.xml").write_text(MODEL)
    return sim.mechanism(tmp_path / "arm.xml")


def log_of(tmp_path, hip, ram=0.1 * WRAPPED):
    """A log of both joints with torques."""
    columns = {"time": TIME, "a": hip, "b": ram, "hip_torque": WRAPPED, "ram_torque": WRAPPED}
    path = tmp_path / "log.csv"
    path.write_text(text(columns), encoding="utf-8")
    return path


@pytest.mark.parametrize("wrapped", [from_zero, about_zero])
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
def test_wrapped_angles_are_read_as_continuous(tmp_path, arm, wrapped, factor, turn, entry):
    x = wrapped(factor * WRAPPED, turn)
    path = log_of(tmp_path, x)
    mapping = {"joints": {"hip": {"position": {"column": "a"} | entry}, "ram": {"position": "b"}}}
    log = ident.read_log(path, arm, mapping)
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


def test_commands_are_in_the_turn_of_their_positions(tmp_path, arm):
    columns = {"time": TIME, "a": from_zero(WRAPPED, 2 * np.pi), "b": 0.1 * WRAPPED, "hip_torque": WRAPPED}
    columns["u"] = from_zero(WRAPPED - WRAPPED[0] - 0.01, 2 * np.pi)
    path = tmp_path / "log.csv"
    path.write_text(text({name: x for name, x in columns.items() if name != "hip_torque"}))
    mapping = {"joints": {"hip": {"position": "a", "command": "u", "kp": 5}, "ram": {"position": "b"}}}
    log = ident.read_log(path, arm, mapping)
    assert np.abs(log["hip_command"] - log["hip_position"]).max() < np.pi
