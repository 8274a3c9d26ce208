"""Joint torques against the model: signs, units, friction, and a hand that is absent."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
import wrist
from coded import coded

import ident
import sim
from ident.estimation.preparation import prepared
from ident.judgement.torque_checks import torque_checks
from ident.judgement.torque_findings import torque_findings
from ident.setup import PRIORS

HAND = {"mass": 0.7, "com": (0.0, 0.01, 0.06), "inertia": (2e-3, 2e-3, 1e-3, 0, 0, 0)}
NO_HAND = {"mass": 1e-9, "com": (0, 0, 0), "inertia": (1e-12, 1e-12, 1e-12, 0, 0, 0)}


@cache
def arm():
    """A seven-joint arm with a hand."""
    return sim.mechanism(mujoco.MjSpec.from_string(wrist.model(tool=HAND)))


def heavier(factor):
    """The hand with a load of the same shape, as many times as heavy together."""
    inertia = tuple(factor * x for x in HAND["inertia"])
    return HAND | {"mass": factor * HAND["mass"], "inertia": inertia}


def log(*, hand=True, load=1.0, friction=0.0, slow=0.0, gains=1.0, off=1.0, seed=0, seconds=20.0, rate=100.0):
    """Angles and torques: the links' torques by MuJoCo times `off`, and friction, `slow` N m more at low velocity."""
    true = mujoco.MjModel.from_xml_string(wrist.model(tool=heavier(load) if hand else NO_HAND))
    data, (t, q, dq, ddq), torques = mujoco.MjData(true), wrist.motion(seconds, rate), []
    for data.qpos[:], data.qvel[:], data.qacc[:] in zip(q, dq, ddq, strict=True):
        mujoco.mj_inverse(true, data)
        torques.append(data.qfrc_inverse.copy())
    rng = np.random.default_rng(seed)
    torque = off * np.array(torques) + friction * (0.6 * dq + 0.5 * np.sign(dq))
    torque = torque + slow * np.sign(dq) * np.exp(-((dq / 0.1) ** 2))
    torque = gains * torque + 0.03 * rng.normal(size=q.shape)
    q = q + 3e-4 * rng.normal(size=q.shape)
    channels = {f"{joint}_position": x for joint, x in zip(wrist.JOINTS, q.T, strict=True)}
    return ident.Recording(t, channels | {f"{j}_torque": x for j, x in zip(wrist.JOINTS, torque.T, strict=True)})


def checks(**faults):
    return torque_checks(prepared(arm(), log(**faults)))


@pytest.mark.parametrize(
    "faults", [{}, {"friction": 1.0}, {"off": 1.15}, {"off": 0.85, "friction": 1.0}, {"load": 2.0, "friction": 1.0}]
)
def test_nothing_is_found_where_nothing_is_wrong(faults):
    result = checks(**faults)
    assert not any(check.flipped or check.scaled for check in result.joints)
    assert result.absent is None


def test_opposite_signs_and_missing_factors_are_named():
    gains = np.array([1, -1, 1, 0.01, 1, 1, 1])
    by_joint = {check.joint: check for check in checks(gains=gains, friction=1.0).joints}
    assert [joint for joint, check in by_joint.items() if check.flipped] == ["joint2"]
    assert [joint for joint, check in by_joint.items() if check.scaled] == ["joint4"]
    assert by_joint["joint4"].gain == pytest.approx(0.01, rel=0.1)


@pytest.mark.parametrize("friction", [0.0, 1.0])
def test_a_heavy_load_is_no_factor_although_one_explains_some_torques(friction):
    result = checks(load=16.0, friction=friction)
    assert any(check.scaled for check in result.joints)
    assert result.load.body in ("tool", "link7") and result.load.better and result.load.against_factors < 0.1
    assert not result.gains and not result.grossly_wrong
    (finding,) = torque_findings(evidence_of(checks(load=40.0)))
    # More than the whole arm: a load explains the torques far better, but the unit may be wrong as well.
    assert finding.code == "torque_scale" and finding.values["load"] in ("tool", "link7")


def evidence_of(result):
    """Evidence with checks of torques alone."""
    return SimpleNamespace(checks=SimpleNamespace(torques=result))


def test_the_verdict_suggests_friction_and_names_the_hand_and_is_content_without_them():
    recording = log(hand=False, friction=1.0, seconds=10.0, rate=50.0)
    estimate = ident.identify(arm(), recording, drive=(), estimator="weighted", cutoff=4.0)
    absent, friction = coded(estimate, "body_not_carried"), coded(estimate, "friction_not_fitted")
    (absent,), (friction,) = absent, friction
    assert friction.doubt and friction.values["drives"] == ("viscous", "coulomb")
    assert not absent.doubt and absent.values["body"] == "tool"
    clean = ident.identify(arm(), log(seconds=10.0, rate=50.0), drive=(), estimator="weighted", cutoff=4.0)
    assert not coded(clean, "friction_not_fitted", "body_not_carried", "rotor_not_fitted", "rotor_inseparable")
    bare = replace(arm(), prior=arm().known * np.repeat([*7 * [1], 1e-6], 10))
    estimate = ident.identify(bare, recording, drive=("viscous", "coulomb"), setup=dict.fromkeys(PRIORS, 0.0))
    assert estimate.verdict().usable
    assert not coded(estimate, "friction_not_fitted", "body_not_carried", "rotor_not_fitted", "rotor_inseparable")
    assert estimate.disagreement < 1.5
    assert set(estimate.to_dict()["friction"]) == set(wrist.JOINTS)
