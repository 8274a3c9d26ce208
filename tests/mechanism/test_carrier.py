"""Bases moved by joints: their motion, and a sensor's reading of the bodies on them, against MuJoCo."""

import mujoco
import numpy as np
import pytest
import wrist

import ident
import sim
from ident.geometry.se3 import coAd, inverse
from ident.model.regressor import base_wrench_regressor

ARM = sim.mechanism(mujoco.MjSpec.from_string(wrist.model()))
TOOL = ARM.beyond("tool")


def test_the_wrench_of_a_tool_is_what_mujocos_sensor_reads():
    _, *states = wrist.motion()
    base = TOOL.carrier.motion(*states)
    none = np.zeros((len(states[0]), 0))
    Y = base_wrench_regressor(TOOL.tree, none, none, none, gravity=TOOL.gravity, base=base)
    in_sensor = Y @ TOOL.known @ coAd(inverse(wrist.sensors()["wrist"].pose)).T
    np.testing.assert_allclose(in_sensor, wrist.read(wrist.model()), atol=1e-13)


def test_poses_are_those_of_the_tree_and_rates_their_derivatives():
    rng = np.random.default_rng(0)
    q, dq, ddq = rng.normal(size=(3, 7))
    motion, h = TOOL.carrier.motion(q, dq, ddq), 1e-5
    np.testing.assert_allclose(motion.T, ARM.tree.poses(q)[ARM.tree.names.index("tool")], atol=1e-13)
    near = [TOOL.carrier.motion(q + s * h * dq + (s * h) ** 2 / 2 * ddq, dq + s * h * ddq, ddq) for s in (-1, 1)]
    np.testing.assert_allclose((near[1].V - near[0].V) / (2 * h), motion.dV, atol=1e-7)
    slope = inverse(motion.T) @ (near[1].T - near[0].T) / (2 * h)
    np.testing.assert_allclose(slope[:3, 3], motion.V[:3], atol=1e-8)
    np.testing.assert_allclose([slope[2, 1], slope[0, 2], slope[1, 0]], motion.V[3:], atol=1e-8)


def test_what_cannot_be_carried_is_refused():
    with pytest.raises(ident.InputError, match="no body 'hand' to be carried; the bodies are link1, "):
        ARM.beyond("hand")
    with pytest.raises(ident.InputError, match="from the whole mechanism"):
        TOOL.beyond("tool")
    still = sim.mechanism(
        mujoco.MjSpec.from_string('<mujoco><worldbody><body name="a"><geom size="1"/></body></worldbody></mujoco>')
    )
    with pytest.raises(ident.InputError, match="No joint moves 'a'"):
        still.beyond("a")
