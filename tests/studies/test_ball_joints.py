"""Ball joints from a recording of quaternions: the trajectory estimate and least squares against the truth."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import ident
import sim
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor

MODEL = """
<mujoco><option gravity="0 0 -9.81"/><worldbody><body name="base">
  <geom size=".1" mass="2"/>
  <body name="arm" pos="0 0 .1"><joint name="shoulder" type="ball"/>
    <geom type="capsule" fromto="0 0 0 .05 0 -.3" size=".04" mass="2"/>
    <body name="hand" pos=".05 0 -.3"><joint name="elbow" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 .2 .05 -.1" size=".03" mass="1"/>
</body></body></body></worldbody></mujoco>
"""


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    path = tmp_path_factory.mktemp("model") / "ball.xml"
    path.write_text(MODEL)
    return sim.mechanism(path, base="base")


def recorded(arm, seed, *, torques=False, noise=0.002):
    """Eight seconds at 100 Hz with noise everywhere, and jumps of the quaternion's sign."""
    rng = np.random.default_rng(seed)
    model = mujoco.MjModel.from_xml_string(MODEL)
    t, h = np.arange(800) / 100, 1e-4
    amplitude, phase = rng.uniform(0.2, 0.5, (4, 3)), rng.uniform(0, 6, (4, 3))

    def angles(t):
        waves = np.sin(2 * np.pi * np.array([0.4, 0.7, 1.1]) * t[:, None, None] + phase)
        return (amplitude * waves).sum(axis=-1)

    def coordinates(t):
        turned = Rotation.from_euler("XYZ", angles(t)[:, :3]).as_quat(scalar_first=True)
        return np.hstack([turned * np.where(turned[:, :1] < 0, -1, 1), angles(t)[:, 3:]])

    def rates(t):
        out = np.zeros((len(t), 4))
        for k, (before, after) in enumerate(zip(coordinates(t - h), coordinates(t + h), strict=True)):
            mujoco.mj_differentiatePos(model, out[k], 2 * h, before, after)
        return out

    q, dq, ddq = coordinates(t), rates(t), (rates(t + 1e-3) - rates(t - 1e-3)) / 2e-3
    wrench = base_wrench_regressor(arm.tree, q, dq, ddq, gravity=arm.gravity) @ arm.known
    turned = Rotation.from_quat(q[:, :4], scalar_first=True) * Rotation.from_rotvec(noise * rng.normal(size=(800, 3)))
    flips = rng.choice([-1, 1], size=(800, 1))
    measured = {
        "shoulder_position": turned.as_quat(scalar_first=True) * flips,
        "elbow_position": q[:, 4] + noise * rng.normal(size=800),
        "ground_force": wrench[:, :3] + 0.1 * rng.normal(size=(800, 3)),
        "ground_torque": wrench[:, 3:] + 0.01 * rng.normal(size=(800, 3)),
    }
    if torques:
        felt = joint_torque_regressor(arm.tree, q, dq, ddq, gravity=arm.gravity) @ arm.known
        measured |= {"shoulder_torque": felt[:, :3] + 0.01 * rng.normal(size=(800, 3))}
        measured |= {"elbow_torque": felt[:, 3] + 0.01 * rng.normal(size=800)}
    return ident.Recording(t, measured)


@pytest.mark.slow
def test_a_ball_is_identified_from_its_quaternions(arm):
    estimate = ident.identify(arm, recorded(arm, 0, torques=True))
    truth = estimate.base.regroup(arm.known)
    z = (estimate.psi - truth) / estimate.std_setup
    assert np.abs(z).max() < 4 and np.sqrt((z**2).mean()) < 1.6
    assert estimate.verdict().usable
    assert (estimate.held_out.ratio[[0, 1, 2, 3, 4]] < 0.2).all()


def test_least_squares_takes_their_filtered_quaternions(arm):
    estimate = ident.identify(arm, recorded(arm, 0, noise=1e-5), estimator="ordinary", cutoff=12)
    truth = estimate.base.regroup(arm.known)
    np.testing.assert_allclose(estimate.psi, truth, atol=0.02 * np.abs(truth).max())
