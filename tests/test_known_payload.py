"""Torque constants that a payload of known mass fixes, on the arm of the scenes with a weight on its tool."""

from dataclasses import replace
from functools import cache

import mujoco
import numpy as np
import pytest
from coded import coded

import ident
import scenes
import sim
from ident.errors import LogError
from ident.estimation.preparation import prepared
from ident.recordings.recording import Recording

JOINTS = ("turn", "shoulder", "elbow", "wrist")
COULOMB, NOISE = np.array([1.5, 2.0, 1.0, 0.3]), np.array([0.015, 0.02, 0.01, 0.003])
STATED = 1.2
"""Stated over true torque."""

MASSES = dict(zip(("column", "upper", "fore", "tool"), (1.2, 0.85, 1.15, 1.25), strict=True))
"""True over the model's masses and inertias."""

EXACT = {"mass": 0, "center": 0, "inertia": 0}


def arm(payload, factors=None):
    """MuJoCo's specification of the arm with a payload of a mass on its tool, and factors on the bodies' masses."""
    spec = scenes.load("arm")
    for name, factor in (factors or {}).items():
        body = spec.body(name)
        body.mass, body.fullinertia = body.mass * factor, body.fullinertia * factor
    weight = spec.body("tool").add_body(name="payload", pos=(0.05, 0.1, 0.02))
    weight.mass, weight.inertia, weight.ipos = payload, [2e-3 * payload] * 3, (0, 0.02, 0.01)
    weight.explicitinertial = True
    return spec


@cache
def columns(payload, seed=0, seconds=8.0, rate=100.0):
    """Columns of a log of angles and of torques whose scale is wrong."""
    rng, spec = np.random.default_rng(seed), arm(payload, MASSES)
    for joint in JOINTS:
        spec.joint(joint).frictionloss = 0
    model = spec.compile()
    data, t = mujoco.MjData(model), np.arange(round(seconds * rate)) / rate
    pulsation = 2 * np.pi * 0.15 * np.arange(1, 6)
    amplitude, phase = rng.uniform(0.08, 0.3, (4, 5)), rng.uniform(0, 2 * np.pi, (4, 5))
    angle = pulsation * t[:, None, None] + phase
    q = (amplitude * np.sin(angle)).sum(axis=2) + np.array([0, -0.4, 0.8, 0.3])
    dq = (amplitude * pulsation * np.cos(angle)).sum(axis=2)
    ddq = -(amplitude * pulsation**2 * np.sin(angle)).sum(axis=2)
    torque = np.empty_like(q)
    for k in range(len(t)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], dq[k], ddq[k]
        mujoco.mj_inverse(model, data)
        torque[k] = data.qfrc_inverse
    torque += COULOMB * np.tanh(dq / 0.003) + NOISE * rng.normal(size=q.shape)
    q += 1e-4 * rng.normal(size=q.shape)
    out = {"time": t} | {f"{joint}_position": x for joint, x in zip(JOINTS, q.T, strict=True)}
    return out | {f"{joint}_torque": x for joint, x in zip(JOINTS, STATED * torque.T, strict=True)}


def mapping(**known):
    of_joints = {joint: {"torque": f"{joint}_torque", "torque_std": 0.3} for joint in JOINTS}
    return {"joints": of_joints, "known": {"mass": 0.3, "center": 0.02, **known}}


@cache
def estimate(payload):
    return ident.identify(sim.mechanism(arm(payload)), columns(payload), columns=mapping(payload=EXACT))


@pytest.mark.slow
def test_a_payload_of_known_mass_fixes_the_scale_of_torques():
    result = estimate(5.0)
    assert set(result.scales) == set(JOINTS)
    for scale, std in result.scales.values():
        assert abs(scale * STATED - 1) < 1.96 * std * STATED < 1.96 * 0.03
    (finding,) = coded(result, "torque_scale_estimated")
    assert finding.values["fixed_by"][0] == "what is stated of payload" and not finding.doubt
    assert "fixed by what is stated of payload and the model's other bodies" in finding.text


def test_deviations_of_single_bodies_are_read_and_saved(tmp_path):
    robot = sim.mechanism(arm(5.0))
    log = ident.read_log(columns(5.0), robot, mapping(payload=EXACT, tool={"center": False}))
    assert log.known == {"mass": 0.3, "center": 0.02}
    assert log.known_bodies == {"payload": EXACT, "tool": {"center": 0.0}}
    log.save(tmp_path / "log.npz")
    assert Recording.load(tmp_path / "log.npz").known_bodies == log.known_bodies
    ready = prepared(replace(robot, prior_known={"tool": {"mass": 0.1}, "fore": {"mass": 0.2}}), log)
    both = {"tool": {"mass": 0.1, "center": 0.0}, "fore": {"mass": 0.2}, "payload": EXACT}
    assert ready.mechanism.prior_known == ready.equations.mechanism.prior_known == both


@pytest.mark.parametrize(
    ("known", "message"),
    [
        ({"load": {"mass": 0}}, r"\[known.load\] needs the name of a body, one of base, column, .*payload"),
        ({"payload": {"mass": -1}}, "known.payload.mass needs a standard deviation, zero or false, got -1"),
        ({"payload": {"weight": 1}}, r"\[known.payload\] has no entry 'weight'; valid are mass, center, inertia"),
        ({"payload": 0}, r"\[known\] has no entry 'payload'; valid are mass, center, inertia"),
    ],
)
def test_bad_deviations_of_bodies_are_one_sentence(known, message):
    with pytest.raises(LogError, match=message):
        ident.read_log(columns(5.0), sim.mechanism(arm(5.0)), mapping(**known))
