"""Motors of coupled joints, and torque constants that a payload of known mass fixes."""

from dataclasses import replace
from functools import cache

import driven_arm
import mujoco
import numpy as np
import pytest
from coded import coded
from mechanisms import by_joint, sines
from random_models import inverse_dynamics

import ident
import scenes
import sim
from experiments.reports.identify_report import _left_out_of, _write_updated
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
    assert _left_out_of("model.xml", result) == [f"model.xml cannot hold {', '.join(TRUE)}."]
    assert _left_out_of(None, result) == []


JOINTS = ("turn", "shoulder", "elbow", "wrist")
COULOMB, TORQUE_NOISE = np.array([1.5, 2.0, 1.0, 0.3]), np.array([0.015, 0.02, 0.01, 0.003])
STATED = 1.2  # Stated over true torque.
MASSES = dict(zip(("column", "upper", "fore", "tool"), (1.2, 0.85, 1.15, 1.25), strict=True))
"""True over the model's masses and inertias."""

EXACT = {"mass": 0, "center": 0, "inertia": 0}


def loaded_arm(**factors):
    """MuJoCo's specification of the arm with a payload of 5 kg on its tool, and factors on the bodies' masses."""
    spec = scenes.load("arm")
    for name, factor in factors.items():
        body = spec.body(name)
        body.mass, body.fullinertia = body.mass * factor, body.fullinertia * factor
    weight = spec.body("tool").add_body(name="payload", pos=(0.05, 0.1, 0.02))
    weight.mass, weight.inertia, weight.ipos = 5.0, [0.01] * 3, (0, 0.02, 0.01)
    weight.explicitinertial = True
    return spec


@cache
def loaded_columns():
    """Columns of a log of angles and of torques whose scale is wrong."""
    rng, spec, t = np.random.default_rng(0), loaded_arm(**MASSES), np.arange(800) / 100
    for joint in JOINTS:
        spec.joint(joint).frictionloss = 0
    amplitude, phase = rng.uniform(0.08, 0.3, (4, 5)), rng.uniform(0, 2 * np.pi, (4, 5))
    q, dq, ddq = sines(t, amplitude, 2 * np.pi * 0.15 * np.arange(1, 6), phase)
    q += np.array([0, -0.4, 0.8, 0.3])
    torque, _ = inverse_dynamics(spec.compile(), q, dq, ddq)
    torque += COULOMB * np.tanh(dq / 0.003) + TORQUE_NOISE * rng.normal(size=q.shape)
    q += 1e-4 * rng.normal(size=q.shape)
    return {"time": t} | by_joint(JOINTS, position=q, torque=(STATED * torque.T).T)


def loaded_mapping(**known):
    of_joints = {joint: {"torque": f"{joint}_torque", "torque_std": 0.3} for joint in JOINTS}
    return {"joints": of_joints, "known": {"mass": 0.3, "center": 0.02, **known}}


@pytest.mark.slow
def test_a_payload_of_known_mass_fixes_the_scale_of_torques():
    arm, mapping = sim.mechanism(loaded_arm()), loaded_mapping(payload=EXACT)
    result = ident.identify(arm, loaded_columns(), columns=mapping)
    assert set(result.scales) == set(JOINTS)
    for scale, std in result.scales.values():
        assert abs(scale * STATED - 1) < 1.96 * std * STATED < 1.96 * 0.03
    (finding,) = coded(result, "torque_scale_estimated")
    assert finding.values["fixed_by"][0] == "what is stated of payload" and not finding.doubt
    assert "fixed by what is stated of payload and the model's other bodies" in finding.text


def test_deviations_of_single_bodies_are_read_and_saved(tmp_path):
    robot = sim.mechanism(loaded_arm())
    with pytest.raises(LogError, match=r"\[known.load\] needs the name of a body, one of base, column, .*payload"):
        ident.read_log(loaded_columns(), robot, loaded_mapping(load={"mass": 0}))
    log = ident.read_log(loaded_columns(), robot, loaded_mapping(payload=EXACT, tool={"center": False}))
    assert log.known == {"mass": 0.3, "center": 0.02}
    assert log.known_bodies == {"payload": EXACT, "tool": {"center": 0.0}}
    log.save(tmp_path / "log.npz")
    assert Recording.load(tmp_path / "log.npz").known_bodies == log.known_bodies
    ready = prepared(replace(robot, prior_known={"tool": {"mass": 0.1}, "fore": {"mass": 0.2}}), log)
    both = {"tool": {"mass": 0.1, "center": 0.0}, "fore": {"mass": 0.2}, "payload": EXACT}
    assert ready.mechanism.prior_known == ready.equations.mechanism.prior_known == both
