"""Torques that are not what moves the joints: a hand, commands, loops, computed torques; loads beside other units."""

from dataclasses import replace

import driven_arm
import mujoco
import numpy as np
import pytest
from coded import coded
from mechanisms import by_joint

import ident
import sim
from ident.setup import PRIORS

JOINTS = driven_arm.JOINTS
EXACT = dict.fromkeys(PRIORS, 0.0)

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
    estimate = ident.identify(ARM, recorded(torques), setup=EXACT, estimator="weighted", cutoff=8.0)
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
