"""Predicted standard deviations agree with the effect of noise, and designs that minimise them improve it."""

from dataclasses import replace

import driven_arm
import mujoco
import numpy as np
import pytest
from scipy.linalg import block_diag

import scenes
from experiments.data import paper
from experiments.studies import excitation_problem
from experiments.studies.excitation_problem import SLIP, drive_signals
from ident.estimation.equations import Equations
from ident.estimation.samples import Samples
from ident.geometry.se3 import pose
from ident.mechanism.motion import Motion
from ident.model.regressor import base_wrench_regressor
from ident.parameters.prior import body_covariance
from ident.recordings.wrench import transform_covariance
from ident.regression.ordinary import least_squares
from sim.models.model_mechanism import mechanism
from sim.motion.excitation import DOUBLE_PENDULUM

TIME = np.arange(943) / 100
PAPERS = Motion(*DOUBLE_PENDULUM.trajectory(TIME))
RESTING = Motion(np.ones((100, 2)), np.zeros((100, 2)), np.zeros((100, 2)))


@pytest.fixture(scope="module")
def pendulum():
    return excitation_problem.problem(mechanism(scenes.load("double_pendulum"), "base"), None, sensors="wrench")


def test_predicted_deviations_are_those_of_an_estimate(pendulum):
    arm, noise, motion = pendulum.mechanism, (0.5, 0.05), Motion(*DOUBLE_PENDULUM.trajectory(TIME[:300]))
    wrench = base_wrench_regressor(arm.tree, *motion.states, gravity=arm.gravity) @ arm.prior
    samples = Samples(motion, wrench, np.diag(np.repeat(noise, 3) ** 2))
    problem = excitation_problem.problem(arm, None, sensors="wrench", noise=noise)
    predicted = excitation_problem.predicted_deviations(problem, motion)
    np.testing.assert_allclose(predicted, least_squares(Equations.of_wrench(arm), samples).std, rtol=0.01)


def test_what_a_model_knows_is_carried_through_the_regrouping(pendulum):
    base, phi = pendulum.parameters, pendulum.mechanism.prior
    B = np.zeros((base.rank, len(phi)))
    B[range(base.rank), list(base.kept)] = 1
    B[:, list(base.dependent)] = base.beta
    np.testing.assert_allclose(B @ phi, base.regroup(phi))
    L = excitation_problem.known_root(pendulum)
    S = block_diag(*(body_covariance(own) for own in phi.reshape(-1, 10)))
    np.testing.assert_allclose(L.T @ L, B @ S @ B.T, atol=1e-14)
    m1 = np.sqrt(np.sum((0.2 * phi[::10]) ** 2))
    assert np.linalg.norm(L, axis=0)[0] == pytest.approx(m1)


def test_what_cannot_be_seen_stays_as_known(pendulum):
    value = excitation_problem.cost(pendulum, "deviations", 100)
    resting = np.exp(value(*RESTING.states)[0])
    assert 0.1 < resting < 1
    quiet = replace(pendulum, whitening=1e-9 * pendulum.whitening)
    assert excitation_problem.quality(quiet, PAPERS)["geometric_mean_of_relative_deviations"] == pytest.approx(1)
    assert np.isfinite(excitation_problem.predicted_deviations(pendulum, RESTING)).all()


SENSING = """
<mujoco><worldbody><body name="base"><site name="plate" pos="0.1 0 -0.2" euler="0 30 0"/><geom size="0.1"/>
<body name="arm"><joint name="hinge" range="-1 1"/><geom size="0.1" pos="0 0 1"/><site name="elsewhere"/></body></body>
</worldbody><sensor><force site="plate" noise="2"/><torque site="plate" noise="0.3"/>
  <force site="elsewhere" noise="7"/><jointactuatorfrc joint="hinge" noise="0.4"/></sensor></mujoco>
"""


def test_noise_is_what_the_models_sensors_state():
    arm = mechanism(mujoco.MjModel.from_xml_string(SENSING), "base")

    def covariance(sensors, noise=None):
        W = excitation_problem.problem(arm, None, sensors=sensors, noise=noise).whitening
        return np.linalg.inv(W.T @ W)

    at_plate = np.diag([4.0, 4, 4, 0.09, 0.09, 0.09])
    expected = transform_covariance(pose(np.eye(3), np.array([0.1, 0, -0.2])), at_plate)
    np.testing.assert_allclose(covariance("wrench"), expected, atol=1e-12)
    np.testing.assert_allclose(covariance("wrench", (1.0, 0.1)), np.diag([1, 1, 1, 0.01, 0.01, 0.01]), atol=1e-12)
    assert covariance("torque") == pytest.approx(0.16)
    assert covariance("torque", (1.0, 0.1)) == pytest.approx(0.01)


ALL = ("rotor", "viscous", "coulomb", "stribeck", "spring")


def driven(drive, **stated):
    return excitation_problem.problem(driven_arm.mechanism(**stated), None, sensors="torque", drive=drive)


def random_motion(n=40):
    q, dq, ddq = np.random.default_rng(0).uniform(-1, 1, size=(3, n, 3))
    return Motion(q, 0.3 * dq, ddq)


def test_columns_are_the_torques_of_unit_drives():
    design, motion = driven(ALL), random_motion()
    columns = dict(zip(design.drives, drive_signals(design.mechanism, design.drives, motion).T, strict=True))
    q, dq, ddq = motion.q[:, 1], motion.dq[:, 1], motion.ddq[:, 2]
    np.testing.assert_allclose(columns["K(lift)"][1], q - 0.4)
    np.testing.assert_allclose(columns["Fv(lift)"][1], dq)
    np.testing.assert_allclose(columns["Fc(lift)"][1], np.tanh(dq / SLIP))
    np.testing.assert_allclose(columns["Ia(bend)"][2], ddq)
    assert all(np.count_nonzero(column.any(axis=1)) == 1 for column in columns.values())
    Y = design.regressor(*motion.states)
    assert Y.shape == (len(motion), 3, len(design.names))


@pytest.mark.parametrize("samples", [40, 3])
@pytest.mark.parametrize("criterion", paper.CRITERIA)
def test_derivatives_are_differences(criterion, samples):
    """With few samples, some combinations are not excited."""
    design, motion, step = driven(ALL), random_motion(samples), 1e-6
    cost = excitation_problem.cost(design, criterion, 1000)
    _, derivatives = cost(*motion.states)
    rng = np.random.default_rng(1)
    for which in range(3):
        direction = rng.normal(size=motion.q.shape)
        moved = [[x + sign * step * direction * (k == which) for k, x in enumerate(motion.states)] for sign in (1, -1)]
        difference = (cost(*moved[0])[0] - cost(*moved[1])[0]) / (2 * step)
        assert (derivatives[which] * direction).sum() == pytest.approx(difference, rel=1e-3, abs=1e-6)
