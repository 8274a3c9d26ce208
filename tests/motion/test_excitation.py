"""Motions that excite, and a person's motions."""

from functools import cache

import numpy as np
import pytest
import random_models
from scipy.optimize import minimize

import ident
import scenes
import sim
from sim.motion import person
from sim.motion.excitation import DOUBLE_PENDULUM, FourierTrajectory, Trapezoids
from sim.motion.excitation_design import minimum
from sim.motion.person import ACTIVITIES, RAIL, Style

TIME = np.arange(943) / 100
PERSON = sim.mechanism(scenes.load("humanoid"), base="pelvis")
NAMES = PERSON.tree.names
SECONDS = np.arange(0, 4, 0.02)


def test_motion_stays_within_a_ur5s_speed_and_the_scenes_limits():
    q, dq, _ = DOUBLE_PENDULUM.trajectory(TIME)
    np.testing.assert_allclose([q[:, 0].min(), q[:, 1].max()], [-1.89, 1.90], atol=0.01)
    assert 2.2 < abs(dq).max() < 2.3


def test_velocities_and_accelerations_are_the_derivatives():
    drawn, h = Trapezoids.drawn(np.random.default_rng(0), 3, 10), 1e-4
    time = np.arange(0, 10, h)
    q, dq, ddq = drawn.trajectory(time)
    assert q.shape == dq.shape == ddq.shape == (len(time), drawn.joints) == (100_000, 3)
    assert np.abs(np.gradient(q, h, axis=0) - dq).max() < 4 * h * np.abs(ddq).max()
    # Except at the jumps, four for each move.
    wrong = np.abs(np.gradient(dq, h, axis=0) - ddq) > 1e-6
    assert wrong.mean() < 4 * 3 * 11 / len(time)
    np.testing.assert_array_equal(drawn.with_noise(3).trajectory(time, np.random.default_rng(1))[0], q)


@pytest.mark.parametrize("harmonics", [2, 5, 12])
def test_a_fourier_trajectory_rests_at_both_ends_returns_and_has_its_derivatives(harmonics):
    rng, h = np.random.default_rng(harmonics), 1e-5
    trajectory = FourierTrajectory(7.3, rng.normal(size=3), rng.normal(size=(3, 2 * harmonics - 2)))
    q, dq, ddq = trajectory.states(np.array([0, 7.3]))
    np.testing.assert_allclose(np.stack([dq, ddq, q - q[0]]), 0, atol=1e-11)
    before, now, after = (trajectory.states(np.linspace(0, 7.3, 50) + shift) for shift in (-h, 0, h))
    for k in (0, 1):
        np.testing.assert_allclose((after[k] - before[k]) / (2 * h), now[k + 1], atol=2e-6)


@pytest.mark.parametrize("seed", range(4))
def test_constrained_minima_are_those_of_sequential_quadratic_programming(seed):
    """Of a quadratic function plus one of fourth order."""
    rng, visited = np.random.default_rng(seed), []
    n, m, w = 3, 12, 4
    root, pull, limits = rng.normal(size=(n * w, n * w)), 5 * rng.normal(size=n * w), rng.normal(size=(n, m, w))

    def function(x):
        visited.append(abs(np.einsum("nmw,nw->nm", limits, x.reshape(n, w))).max())
        flat = x.ravel()
        value = np.sum((root @ flat) ** 2) / 2 + np.sum(flat**4) / 4 - pull @ flat
        return float(value), (root.T @ root @ flat + flat**3 - pull).reshape(x.shape)

    x = minimum(function, np.zeros((n, w)), limits, 400)
    assert max(visited) < 1
    rows = np.zeros((n, m, n, w))
    rows[range(n), :, range(n)] = limits
    rows = np.vstack([rows.reshape(n * m, n * w), -rows.reshape(n * m, n * w)])
    within = {"type": "ineq", "fun": lambda x: 1 - rows @ x, "jac": lambda x: -rows}
    tight = {"maxiter": 500, "ftol": 1e-12}
    theirs = minimize(function, np.zeros(n * w), jac=True, method="SLSQP", constraints=within, options=tight)
    # The barrier's last weight bounds its cost, and this is its remainder.
    assert -1e-9 < function(x)[0] - theirs.fun < 0.004
    assert abs(limits @ x[:, :, None]).max() > 0.99


@cache
def moved(activity, rail=True):
    motion = person.motion(PERSON.tree, activity, SECONDS, Style(seed=1, rail=rail))
    return motion, motion.base.T[:, None] @ PERSON.tree.poses(motion.q)


@pytest.mark.parametrize("activity", ACTIVITIES)
def test_a_foot_stays_and_the_hand_holds_the_rail(activity):
    _, poses = moved(activity)
    left, right = (poses[:, NAMES.index(f"{side}_foot")] for side in ("left", "right"))
    still = [np.abs(np.diff(foot, axis=0)).max(axis=(1, 2)) < 1e-9 for foot in (left, right)]
    assert (still[0] | still[1])[np.diff(np.floor(0.5 * SECONDS)) == 0].all()
    assert np.mean(still[0]) > 0.4
    palm = poses[:, NAMES.index("right_hand")] @ [0, 0, -0.06, 1]
    np.testing.assert_allclose(palm[:, :3], np.broadcast_to(RAIL, (len(SECONDS), 3)), atol=1e-9)


@pytest.mark.parametrize("activity", ACTIVITIES)
@pytest.mark.parametrize("rail", [True, False])
def test_inverse_dynamics_of_mujoco_agrees(activity, rail):
    """Velocities and accelerations are differences of the same coordinates over another step."""
    model, h = random_models.humanoid(), 1e-4
    motion, _ = moved(activity, rail)
    wrench = ident.base_wrench_regressor(PERSON.tree, *motion.states, gravity=PERSON.gravity, base=motion.base)
    wrench = wrench @ PERSON.known
    for i in (3, 57, 131):
        q = person.coordinates(PERSON.tree, activity, SECONDS[i] + h * np.arange(-1, 2), Style(seed=1, rail=rail))
        forces = random_models.forces_between(model, *q, h)
        force = motion.base.T[i, :3, :3] @ wrench[i, :3]
        np.testing.assert_allclose(forces[:6], [*force, *wrench[i, 3:]], atol=0.01)
