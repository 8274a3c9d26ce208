"""Torques that are not what moves the joints: a hand, commands, loops, computed torques; loads beside other units."""

from dataclasses import replace
from functools import cache

import driven_arm
import mujoco
import numpy as np
import pytest
from coded import coded
from mechanisms import by_joint

import ident
import scenes
import sim
from ident.setup import PRIORS
from sim.motion.excitation import Trapezoids

JOINTS = driven_arm.JOINTS
EXACT = dict.fromkeys(PRIORS, 0.0)

LOOP = """<mujoco><compiler inertiafromgeom="true"/><worldbody><body name="base"><geom size=".1"/>
  <body name="crank"><joint name="turn" axis="0 1 0"/><geom type="capsule" size=".02" fromto="0 0 0 .3 0 0"/>
    <body name="rod" pos=".3 0 0"><joint name="pin" axis="0 1 0"/><geom size=".05" pos=".2 0 0"/>
      <body name="tip" pos=".3 0 0"><joint name="end" axis="0 1 0"/><geom size=".03" pos="0 0 .1"/></body></body>
    <body name="brace" pos=".1 0 0"><joint name="hold" axis="0 1 0"/>
      <geom type="capsule" size=".02" fromto="0 0 0 .2 0 .2"/></body></body></body></worldbody>
  <equality>{}</equality></mujoco>"""

CLOSE = '<connect name="close" body1="brace" body2="rod" anchor=".2 0 .2"/>'


def arm():
    """The arm without the drives that its model states."""
    return replace(driven_arm.mechanism(), drives={})


def recorded(torques, noise=0.03, seconds=10.0):
    """Recording of the arm whose torques are a function of the inertial ones, the weight and the velocities."""
    rng, mechanism = np.random.default_rng(1), arm()
    t, q, dq, ddq = driven_arm.motion(rng, seconds, size=1.5)
    moved, held = (
        ident.joint_torque_regressor(mechanism.tree, q, *states, gravity=mechanism.gravity) @ mechanism.known
        for states in ((dq, ddq), (0 * dq, 0 * ddq))
    )
    torque = torques(moved - held, held, q, dq) + noise * rng.normal(size=q.shape)
    q = q + 2e-4 * rng.normal(size=q.shape)
    return ident.Recording(t, by_joint(JOINTS, position=q, torque=torque))


def rubs(dq):
    return 0.8 * dq + 0.9 * np.tanh(dq / 1e-3)


@pytest.mark.parametrize(
    ("torques", "joints"),
    [
        (lambda inertia, weight, q, dq: weight, JOINTS),
        (lambda inertia, weight, q, dq: weight + 0.3 * rubs(dq), JOINTS),
        (lambda inertia, weight, q, dq: 0 * weight, JOINTS),
        (lambda inertia, weight, q, dq: inertia * [1, 1, 0] + weight + [1, 1, 0] * rubs(dq), ("bend",)),
        (lambda inertia, weight, q, dq: inertia + weight + rubs(dq), ()),
        (lambda inertia, weight, q, dq: 0.4 * (inertia + weight) + rubs(dq), ()),
        (lambda inertia, weight, q, dq: inertia + weight + 20 * q, ()),
    ],
    ids=["gravity", "gravity and friction", "none", "a joint", "motors", "a lighter arm", "springs"],
)
def test_motion_that_the_torques_do_not_explain_is_a_doubt(torques, joints):
    """A hand moves an arm whose torques hold its weight, or nothing; motors move the others."""
    estimate = ident.identify(arm(), recorded(torques), setup=EXACT, estimator="weighted", cutoff=8.0)
    findings = coded(estimate, "motion_not_by_torques")
    assert tuple(finding.place.joints for finding in findings) == ((joints,) if joints else ())
    assert all(finding.doubt for finding in findings) and (not joints or estimate.verdict().outcome.value == "not")


def test_torques_of_a_loop_that_is_left_out_are_doubted_and_the_wrench_is_not():
    spec = mujoco.MjSpec.from_string(LOOP.format(CLOSE))
    mechanism = sim.mechanism(spec, base="base", ignore=["close"])
    rng, t = np.random.default_rng(0), np.arange(600) / 100
    q = np.stack([0.8 * np.sin(w * t + w) for w in (1.9, 2.7, 3.1, 4.3)], axis=1)
    dq, ddq = (np.gradient(x, 0.01, axis=0) for x in (q, np.gradient(q, 0.01, axis=0)))
    states = {"q": q, "dq": dq, "ddq": ddq}
    torque = ident.joint_torque_regressor(mechanism.tree, **states, gravity=mechanism.gravity) @ mechanism.known
    wrench = ident.base_wrench_regressor(mechanism.tree, **states, gravity=mechanism.gravity) @ mechanism.known
    channels = by_joint(mechanism.joints, position=q, velocity=dq, acceleration=ddq)
    felt = by_joint(mechanism.joints, torque=torque + 0.01 * rng.normal(size=torque.T.shape).T)
    options = {"estimator": "ordinary", "drive": ()}
    estimate = ident.identify(mechanism, ident.Recording(t, channels | felt), **options)
    (finding,) = coded(estimate, "loop_left_out")
    assert finding.doubt and finding.values == {"loop": "close", "joints": ("pin", "hold")}
    assert "--leave-out pin hold" in finding.text and not estimate.verdict().usable
    without = ident.identify(mechanism, ident.Recording(t, channels | felt), leave_out=("pin", "hold"), **options)
    assert not coded(without, "loop_left_out")
    ground = {"ground_force": wrench[:, :3], "ground_torque": wrench[:, 3:]}
    assert not coded(ident.identify(mechanism, ident.Recording(t, channels | ground), **options), "loop_left_out")


OF_TORQUES = ("torque_sign", "torque_scale", "body_not_carried")


@cache
def scene_arm():
    return sim.mechanism(scenes.load("arm"), base="base")


@cache
def scene_log():
    """Angles, torques and the plate's wrench."""
    motion = Trapezoids.drawn(np.random.default_rng(0), 4, 8)
    return sim.simulate(scenes.load("arm"), motion, samples=700)


def identified(*, light=False, factor=1.0):
    """Estimate with a model whose last body has half of its mass, and with torques times a factor."""
    known = scene_arm().known.reshape(-1, 10).copy()
    known[-1] *= 0.5 if light else 1.0
    log = scene_log()
    measured = {name: (factor if name in torques() else 1.0) * x for name, x in log.measured.items()}
    return ident.identify(replace(scene_arm(), prior=known.ravel()), replace(log, measured=measured))


def torques():
    return [f"{joint}_torque" for joint in scene_arm().tree.joints]


@pytest.mark.slow
def test_right_torques_of_a_model_with_too_light_a_tool_are_no_finding():
    estimate = identified(light=True)
    assert estimate.verdict().usable and not coded(estimate, *OF_TORQUES, "setup_gain")
    (mass,) = [each for each in estimate.parameters if each.name == "m1"]
    assert mass.estimate == pytest.approx(14.8, abs=0.05)


@pytest.mark.slow
def test_torques_that_are_a_seventh_too_large_are_a_finding_beside_a_plate():
    estimate = identified(light=True, factor=1.15)
    gains = {each.place.channels[0]: each.values["value"] for each in coded(estimate, "setup_gain")}
    assert set(gains) <= {"turn", "shoulder", "elbow", "wrist"} and len(gains) >= 2
    assert all(0.08 < gain < 0.18 for gain in gains.values()) and not coded(estimate, *OF_TORQUES)
