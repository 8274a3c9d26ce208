"""Motors of coupled joints, and torque constants that a payload of known mass fixes."""

from dataclasses import replace
from functools import cache

import driven_arm
import mujoco
import numpy as np
import pytest
from coded import coded
from random_models import inverse_dynamics

import ident
import sim
from experiments.reports.identify_report import _write_updated, not_held
from ident import LogError, Recording
from ident.estimation.preparation import prepared
from ident.mechanism.drives import Drive

MATRIX = np.array([[30.0, 20.0], [30.0, -20.0]])  # Angles of two motors over those of the joints lift and bend.
GEARS, MOTORS = np.array([30.0, 30.0]), ("wrist 1", "wrist 2")
MOTOR_DRIVES = {"Ia": (1.5e-4, 1.2e-4), "Fv": (8e-4, 5e-4), "Fc": (0.03, 0.015)}
"""Rotor inertia, kg m², and friction, N m s and N m, of the motors."""

TRUE = {f"{column}({motor})": x for column, own in MOTOR_DRIVES.items() for motor, x in zip(MOTORS, own, strict=True)}
NOISE = 4e-4  # Noise of the motors' torques, N m.


def arm(**drives):
    """The arm with another axis of its last joint, and drives of its joints by attribute."""
    mjcf = driven_arm.text(**driven_arm.NONE | drives)
    mjcf = mjcf.replace('name="bend" axis="0 1 0"', 'name="bend" axis="1 0 0"')
    return mjcf.replace('pos="0.15 0.01 0"', 'pos="0.15 0.04 0.02"')


@cache
def columns(seed=1):
    """Columns of a log in which lift and bend are recorded by their motors, which have rotors and friction."""
    rng = np.random.default_rng(seed)
    t, q, dq, ddq = driven_arm.motion(rng)
    torque, _ = inverse_dynamics(mujoco.MjModel.from_xml_string(arm()), q, dq, ddq)
    turns, speeds_up = dq[:, 1:] @ MATRIX.T, ddq[:, 1:] @ MATRIX.T
    Ia, Fv, Fc = map(np.array, MOTOR_DRIVES.values())
    of_motors = torque[:, 1:] @ np.linalg.inv(MATRIX) + Ia * speeds_up + Fv * turns
    of_motors += Fc * np.tanh(turns / (0.003 * GEARS)) + NOISE * rng.normal(size=turns.shape)
    turn = torque[:, 0] + 0.8 * dq[:, 0] + 0.9 * np.tanh(dq[:, 0] / 0.003) + 0.02 * rng.normal(size=len(t))
    angles = q[:, 1:] @ MATRIX.T + 3e-3 * rng.normal(size=turns.shape)
    out = {"time": t, "turn_position": q[:, 0] + 1e-4 * rng.normal(size=len(t)), "turn_torque": turn}
    out |= dict(zip(("a1", "a2"), angles.T, strict=True))
    return out | dict(zip(("i1", "i2"), of_motors.T / 0.05, strict=True))


def mapping():
    torques = [{"column": name, "gain": 0.05, "unit": "A"} for name in ("i1", "i2")]
    wrist = {"joints": ["lift", "bend"], "matrix": MATRIX.tolist(), "position": ["a1", "a2"], "torque": torques}
    return {"motors": {"wrist": wrist | {"friction": "motors"}}}


def mechanism(**drives):
    return sim.mechanism(mujoco.MjSpec.from_string(arm(**drives)))


def by_name(estimate):
    fit = estimate.fit
    return dict(zip(fit.names, zip(fit.values, fit.std, strict=True), strict=True))


def test_rotors_and_friction_of_coupled_motors_are_identified():
    estimate = ident.identify(mechanism(), columns(), columns=mapping())
    fitted = by_name(estimate)
    for name, true in TRUE.items():
        value, std = fitted[name]
        assert abs(value - true) < 1.96 * std < 0.02 * true, name
    assert not {"Fv(lift)", "Fv(bend)", "Ia(bend)"} & set(fitted) and {"Fv(turn)", "Fc(turn)"} <= set(fitted)
    # The residual is the noise of the motors, as the joints have it.
    noise = NOISE * np.sqrt((MATRIX**2).sum(axis=0))
    assert estimate.trajectory.fit.channel_noise[1:] == pytest.approx(noise, rel=0.05)


@pytest.mark.slow
def test_intervals_hold_the_motors_drives_as_often_as_they_say():
    z = []
    for seed in range(4):
        own = by_name(ident.identify(mechanism(), columns(seed), columns=mapping()))
        z.append([(own[name][0] - true) / own[name][1] for name, true in TRUE.items()])
    assert (np.abs(z) < 1.96).mean() > 0.9 and np.sqrt(np.square(z).mean()) < 1.3


def test_a_model_s_file_keeps_what_it_states_of_coupled_joints(tmp_path):
    stated = mechanism(damping=(0.5, 0.4, 0.3))
    result = ident.identify(stated, columns(), columns=mapping(), estimator="weighted", cutoff=8.0)
    assert set(result.drives_updated) == {"turn"}
    _write_updated(result, False, tmp_path / "model.xml")
    drives = sim.mechanism(str(tmp_path / "model.xml")).drives
    assert (drives["lift"].viscous, drives["bend"].viscous) == (0.4, 0.3)
    assert drives["turn"].viscous == pytest.approx(0.8, rel=0.1) and isinstance(drives["turn"], Drive)
    assert not_held("model.xml", result) == [f"model.xml cannot hold {', '.join(TRUE)}."]
    assert not_held(None, result) == []


EXACT = {"mass": 0, "center": 0, "inertia": 0}
STATED = 1.2  # Stated over true torque.


def scaled_log(robot, **known):
    """Columns of a log whose torques are all too large, read with what is known of bodies."""
    log = driven_arm.log()
    columns = {name: STATED * x if name.endswith("torque") else x for name, x in log.measured.items()}
    of_joints = {joint: {"torque": f"{joint}_torque", "torque_std": 0.3} for joint in driven_arm.JOINTS}
    mapping = {"joints": of_joints, "known": {"mass": 0.3, "center": 0.02, **known}}
    return ident.read_log({"time": log.time, **columns}, robot, mapping)


@pytest.mark.slow
def test_a_body_of_known_mass_fixes_the_scale_of_torques():
    """Although the model's other bodies are wrong by a fifth."""
    robot = driven_arm.mechanism()
    robot = replace(robot, prior=robot.known * np.repeat([1.2, 0.85, 1], 10))
    result = ident.identify(robot, scaled_log(robot, fore=EXACT))
    assert set(result.scales) == set(driven_arm.JOINTS)
    for scale, std in result.scales.values():
        assert abs(scale * STATED - 1) < 1.96 * std * STATED < 1.96 * 0.03
    (finding,) = coded(result, "torque_scale_estimated")
    assert finding.values["fixed_by"][0] == "what is stated of fore" and not finding.doubt
    assert "fixed by what is stated of fore and the model's other bodies" in finding.text


def test_deviations_of_single_bodies_are_read_and_saved(tmp_path):
    robot = driven_arm.mechanism()
    with pytest.raises(LogError, match=r"\[known.load\] needs the name of a body, one of column, upper, fore"):
        scaled_log(robot, load={"mass": 0})
    log = scaled_log(robot, fore=EXACT, upper={"center": False})
    assert log.known == {"mass": 0.3, "center": 0.02}
    assert log.known_bodies == {"fore": EXACT, "upper": {"center": 0.0}}
    log.save(tmp_path / "log.npz")
    assert Recording.load(tmp_path / "log.npz").known_bodies == log.known_bodies
    ready = prepared(replace(robot, prior_known={"upper": {"mass": 0.1}, "column": {"mass": 0.2}}), log)
    both = {"upper": {"mass": 0.1, "center": 0.0}, "column": {"mass": 0.2}, "fore": EXACT}
    assert ready.mechanism.prior_known == ready.equations.mechanism.prior_known == both
