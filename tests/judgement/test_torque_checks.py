"""Joint torques against the model: signs, units, friction, an absent hand, and torques that do not move the joints."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import driven_arm
import mujoco
import numpy as np
import pytest
import wrist
from coded import coded
from mechanisms import by_joint
from random_models import inverse_dynamics
from scipy import signal

import ident
import sim
from ident.estimation.preparation import prepared
from ident.judgement import torque_findings as judges
from ident.judgement.torque_checks import friction_shares, torque_checks
from ident.model.axes import Axes

HAND = {"mass": 0.7, "com": (0.0, 0.01, 0.06), "inertia": (2e-3, 2e-3, 1e-3, 0, 0, 0)}
NO_HAND = {"mass": 1e-9, "com": (0, 0, 0), "inertia": (1e-12, 1e-12, 1e-12, 0, 0, 0)}


@cache
def arm():
    return sim.mechanism(mujoco.MjSpec.from_string(wrist.model(tool=HAND)))


def log(*, hand=True, load=1.0, friction=0.0, gains=1.0, off=1.0, seconds=20.0, rate=50.0):
    """Angles and torques: the links' torques by MuJoCo times `off`, and friction."""
    heavier = HAND | {"mass": load * HAND["mass"], "inertia": tuple(load * x for x in HAND["inertia"])}
    true = mujoco.MjModel.from_xml_string(wrist.model(tool=heavier if hand else NO_HAND))
    rng, (t, q, dq, ddq) = np.random.default_rng(0), wrist.motion(seconds, rate)
    torque = off * inverse_dynamics(true, q, dq, ddq)[0] + friction * (0.6 * dq + 0.5 * np.sign(dq))
    torque = gains * torque + 0.03 * rng.normal(size=q.shape)
    q = q + 3e-4 * rng.normal(size=q.shape)
    return ident.Recording(t, by_joint(wrist.JOINTS, position=q, torque=torque))


def checks(**faults):
    return torque_checks(prepared(arm(), log(**faults)))


@pytest.mark.parametrize("faults", [{"off": 1.15}, {"off": 0.85, "friction": 1.0}, {"load": 2.0, "friction": 1.0}])
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


def test_a_heavy_load_is_no_factor_although_one_explains_some_torques():
    result = checks(load=16.0, friction=1.0)
    assert any(check.scaled for check in result.joints)
    assert result.load.body in ("tool", "link7") and result.load.better and result.load.against_factors < 0.1
    assert not result.gains and not result.grossly_wrong
    beyond = SimpleNamespace(checks=SimpleNamespace(torques=checks(load=40.0)))
    (finding,) = judges.torque_findings(beyond)
    # More than the whole arm: a load explains the torques far better, but the unit may be wrong as well.
    assert finding.code == "torque_scale" and finding.values["load"] in ("tool", "link7")


ABOUT_HANDS = ("friction_not_fitted", "body_not_carried", "rotor_not_fitted", "rotor_inseparable")


@cache
def fitted():
    return ident.identify(arm(), log(seconds=6), drive=(), estimator="weighted", cutoff=4.0)


def test_the_verdict_suggests_friction_and_names_the_hand_and_is_content_without_them():
    recording = log(hand=False, friction=1.0, seconds=6.0)
    estimate = ident.identify(arm(), recording, drive=(), estimator="weighted", cutoff=4.0)
    (absent,), (friction,) = coded(estimate, "body_not_carried"), coded(estimate, "friction_not_fitted")
    assert friction.doubt and friction.values["drives"] == ("viscous", "coulomb")
    assert not absent.doubt and absent.values["body"] == "tool"
    assert not coded(fitted(), *ABOUT_HANDS)
    bare = replace(arm(), prior=arm().known * np.repeat([*7 * [1], 1e-6], 10))
    rubs = ident.identify(bare, recording, drive=("viscous", "coulomb"), estimator="weighted", cutoff=4.0)
    assert rubs.verdict().usable and not coded(rubs, *ABOUT_HANDS)


def shares_of(residual):
    """Shares for predicted torques and a residual (N, 7)."""
    fit, samples = fitted().fit, fitted().prepared.samples
    right = samples.measured - fit.residual(samples)
    return np.array(list(friction_shares(fit, replace(samples, measured=right + residual)).values()))


@pytest.mark.parametrize(("rho", "most"), [(0.0, 0.01), (0.9, 0.06)])
def test_noise_is_not_taken_for_friction(rho, most):
    """The share that two columns explain by chance is subtracted; it is larger for correlated noise."""
    rng, size = np.random.default_rng(0), fitted().prepared.samples.measured.shape
    noise = (signal.lfilter([1], [1, -rho], rng.normal(size=size), axis=0) for _ in range(6))
    shares = np.concatenate(list(map(shares_of, noise)))
    assert 0.35 < np.mean(shares == 0) < 0.75 and shares.mean() < most


def axes(joints, **motors):
    rows = np.array(list(motors.values()), float).reshape(-1, len(joints))
    return Axes(joints, tuple(motors), rows, (), np.zeros((0, len(joints))))


def estimate(share=0.0, ratio=0.1, **more):
    """An estimate of two torques, with a share of the second's residual that friction would explain."""
    channels = ("joint1", "joint2")
    given = dict(
        fit=SimpleNamespace(equations=SimpleNamespace(drives=(), axes=axes(channels), channels=channels)),
        channels=channels,
        ratios=dict.fromkeys(channels, ratio),
        friction={"joint1": 0.0, "joint2": share},
        model_error=np.array([0.0, share]),
        trajectory=SimpleNamespace(),
        logs=(),
    )
    return SimpleNamespace(**given | more)


def test_friction_is_worth_a_word_where_it_explains_much_of_something():
    """A residual of a hundredth of the signal may correlate with the velocity."""
    (finding,) = judges.friction_findings(estimate(0.25, 0.025))
    assert finding.doubt and finding.code == "friction_not_fitted" and finding.place.channels == ("joint2",)
    assert finding.values == {"shares": {"joint2": 0.25}, "drives": ("viscous", "coulomb")}
    for share, ratio in ((0.15, 0.025), (0.25, 0.015)):
        assert not list(judges.friction_findings(estimate(share, ratio)))


def reversals(monkeypatch, *, size=1.0, slip=0.003, **motors):
    """Findings on two torques of which the first motor has friction."""
    monkeypatch.setattr(judges, "rubbing", lambda equations: (2,))
    equations = SimpleNamespace(drives=(), axes=axes(("joint1", "joint2"), **motors), channels=("joint1", "joint2"))
    values = SimpleNamespace(
        size=np.array([0, 0, size]),
        velocity=np.array([1, 1, 0.05]),
        slip=np.array([0, 0, slip]),
        shares=equations.axes.matrix,
    )
    trajectory = SimpleNamespace(reversals=values, measurement=SimpleNamespace(equations=equations))
    more = {"mechanism": arm(), "bounded": {}, "at_rest": {"joint1": np.nan, "joint2": 0.4}}
    fit = SimpleNamespace(equations=equations)
    return list(judges.drive_findings(estimate(trajectory=trajectory, fit=fit, **more)))


def test_slack_of_a_motor_is_a_remark_on_the_joints_that_it_moves(monkeypatch):
    (finding,) = reversals(monkeypatch, left=[1.0, 2.0])
    assert finding.place.joints == ("joint1", "joint2")
    assert finding.values == {"velocities": {"left": 0.05}, "at_rest": {"joint2": 0.4}}
    (finding,) = reversals(monkeypatch, size=0.0, slip=0.05, left=[1.0, 2.0])
    assert finding.code == "smooth_coulomb_friction" and finding.values == {"velocities": {"left": 0.05}}
    assert not reversals(monkeypatch, size=0.0, slip=0.05, left=[10.0, 20.0])


def test_a_drive_at_its_bound_in_one_log_is_of_its_joint():
    bounded = {"Fc(joint2) of log 2": (0.1, 0.05)}
    (finding,) = judges.drive_findings(estimate(mechanism=arm(), trajectory=None, bounded=bounded))
    assert finding.place.joints == ("joint2",) and finding.values["units"] == {"Fc(joint2) of log 2": "N m"}


JOINTS = driven_arm.JOINTS

LOOP = """<mujoco><compiler inertiafromgeom="true"/><worldbody><body name="base"><geom size=".1"/>
  <body name="crank"><joint name="turn" axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 .3 0 0"/>
    <body name="rod" pos=".3 0 0"><joint name="pin" axis="0 1 0"/><geom size=".05" pos=".2 0 0"/>
      <body name="tip" pos=".3 0 0"><joint name="end" axis="0 1 0"/><geom size=".03" pos="0 0 .1"/></body></body>
    <body name="brace" pos=".1 0 0"><joint name="hold" axis="0 1 0"/>
      <geom type="capsule" size=".02" fromto="0 0 0 .2 0 .2"/></body></body></body></worldbody>
  <equality><connect name="close" body1="brace" body2="rod" anchor=".2 0 .2"/></equality></mujoco>"""


ARM = replace(driven_arm.mechanism(), drives={})  # Without the drives that its model states.


def recorded(torques, noise=0.03, seconds=8.0):
    """Recording of the arm whose torques are a function of the inertial ones, the weight and the velocities."""
    rng = np.random.default_rng(1)
    t, q, dq, ddq = driven_arm.motion(rng, seconds, size=1.5)
    moved, held = (
        ident.joint_torque_regressor(ARM.tree, q, *states, gravity=ARM.gravity) @ ARM.known
        for states in ((dq, ddq), (0 * dq, 0 * ddq))
    )
    torque = torques(moved - held, held, q, dq) + noise * rng.normal(size=q.shape)
    return ident.Recording(t, by_joint(JOINTS, position=q + 2e-4 * rng.normal(size=q.shape), torque=torque))


def rubs(dq):
    return 0.8 * dq + 0.9 * np.tanh(dq / 1e-3)


@pytest.mark.parametrize(
    ("torques", "joints"),
    [
        (lambda inertia, weight, q, dq: weight + 0.3 * rubs(dq), JOINTS),
        (lambda inertia, weight, q, dq: 0 * weight, JOINTS),
        (lambda inertia, weight, q, dq: inertia * [1, 1, 0] + weight + [1, 1, 0] * rubs(dq), ("bend",)),
        (lambda inertia, weight, q, dq: inertia + weight + rubs(dq), ()),
        (lambda inertia, weight, q, dq: inertia + weight + 20 * q, ()),
    ],
    ids=["gravity and friction", "none", "a joint", "motors", "springs"],
)
def test_motion_that_the_torques_do_not_explain_is_a_doubt(torques, joints):
    """A hand moves an arm whose torques hold its weight, or nothing; motors move the others."""
    estimate = ident.identify(ARM, recorded(torques), setup=driven_arm.EXACT, estimator="weighted", cutoff=8.0)
    findings = coded(estimate, "motion_not_by_torques")
    assert tuple(finding.place.joints for finding in findings) == ((joints,) if joints else ())
    assert all(finding.doubt for finding in findings) and (not joints or estimate.verdict().outcome.value == "not")


def test_torques_of_a_loop_that_is_left_out_are_doubted_and_the_wrench_is_not():
    spec = mujoco.MjSpec.from_string(LOOP)
    mechanism = sim.mechanism(spec, base="base", ignore=["close"])
    rng, t = np.random.default_rng(0), np.arange(600) / 100
    q = np.stack([0.8 * np.sin(w * t + w) for w in (1.9, 2.7, 3.1, 4.3)], axis=1)
    dq, ddq = (np.gradient(x, 0.01, axis=0) for x in (q, np.gradient(q, 0.01, axis=0)))
    torque, wrench = (
        regressor(mechanism.tree, q, dq, ddq, gravity=mechanism.gravity) @ mechanism.known
        for regressor in (ident.joint_torque_regressor, ident.base_wrench_regressor)
    )
    channels = by_joint(mechanism.joints, position=q, velocity=dq, acceleration=ddq)
    felt = by_joint(mechanism.joints, torque=torque + 0.01 * rng.normal(size=torque.shape))
    ground = {"ground_force": wrench[:, :3], "ground_torque": wrench[:, 3:]}
    estimate, without, of_wrench = (
        ident.identify(mechanism, ident.Recording(t, channels | more), estimator="ordinary", drive=(), leave_out=names)
        for more, names in ((felt, ()), (felt, ("pin", "hold")), (ground, ()))
    )
    (finding,) = coded(estimate, "loop_left_out")
    assert finding.doubt and finding.values == {"loop": "close", "joints": ("pin", "hold")}
    assert "--leave-out pin hold" in finding.text and not estimate.verdict().usable
    assert not coded(without, "loop_left_out") and not coded(of_wrench, "loop_left_out")
