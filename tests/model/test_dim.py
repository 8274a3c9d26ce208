"""Eq. 7-14, each against something other than the paper's recursion."""

import numpy as np
import pytest
from mechanisms import GRAVITY, moved_states, random_phi, random_pose, random_states, random_tree, random_twist, unhat
from scipy.linalg import expm

from ident.geometry import se3
from ident.geometry.inertia import pseudo_inertia
from ident.mechanism.body import BASE, Body
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.model import dim


@pytest.fixture(params=range(10))
def rng(request):
    return np.random.default_rng(request.param)


def state(rng, tree):
    return tuple(x[0] for x in random_states(rng, tree, 1))


def recursion(tree, q, dq, ddq, gravity):
    return dim.forward_recursion(Mechanism(tree, gravity), Motion(q, dq, ddq))


def inertial_poses(tree, q):
    return tree.poses(q)[list(tree.inertial)]


def test_equation_7_is_the_exponential(rng):
    body = Body("a", BASE, random_pose(rng), random_twist(rng, "helical"))
    computed = dim.relative_pose(body, np.array([0.7]))
    np.testing.assert_allclose(computed, body.home @ expm(se3.hat(body.twist) * 0.7), atol=1e-13)


def test_equation_9_is_the_derivative_of_the_motion(rng):
    tree = random_tree(rng)
    q, dq, ddq = state(rng, tree)
    _, V, dV = recursion(tree, q, dq, ddq, np.zeros(3))

    def poses(t):
        return tree.poses(moved_states(tree, q, dq, ddq, t)[0])

    def twists(t, h=1e-5):
        rate = (poses(t + h) - poses(t - h)) / (2 * h)
        return np.array([unhat(m) for m in se3.inverse(poses(t)) @ rate])

    np.testing.assert_allclose(twists(0), V, atol=2e-7)
    h = 1e-4
    np.testing.assert_allclose((twists(h) - twists(-h)) / (2 * h), dV, atol=2e-4)


def test_equation_9_takes_gravity_as_an_acceleration_of_the_base(rng):
    tree = random_tree(rng)
    q, dq, ddq = state(rng, tree)
    _, _, free = recursion(tree, q, dq, ddq, np.zeros(3))
    _, _, heavy = recursion(tree, q, dq, ddq, GRAVITY)
    for T, a, b in zip(tree.poses(q), free, heavy, strict=True):
        np.testing.assert_allclose(b - a, [*(T[:3, :3].T @ -GRAVITY), 0, 0, 0], atol=1e-12)


def test_equation_10_gives_the_kinetic_energy_of_the_mass_points(rng):
    phi, V = random_phi(rng, 1), rng.normal(size=6)
    velocity = se3.hat(V)
    energy = np.trace(velocity @ pseudo_inertia(phi) @ velocity.T) / 2
    assert np.isclose(V @ dim.spatial_inertia(phi) @ V / 2, energy, rtol=1e-12)


def test_equation_11_joint_power_is_the_rate_of_energy(rng):
    tree = random_tree(rng)
    phi = random_phi(rng, len(tree.inertial))
    q, dq, ddq = state(rng, tree)
    _, torques = dim.inverse_dynamics(Mechanism(tree, GRAVITY, phi), Motion(q, dq, ddq))

    def energy(t):
        q_t, dq_t = moved_states(tree, q, dq, ddq, t)
        _, V, _ = recursion(tree, q_t, dq_t, ddq, GRAVITY)
        total = 0.0
        twists = [V[i] for i in tree.inertial]
        for T, twist, phi_i in zip(inertial_poses(tree, q_t), twists, phi.reshape(-1, 10), strict=True):
            first_moment = phi_i[0] * T[:3, 3] + T[:3, :3] @ phi_i[1:4]
            total += twist @ dim.spatial_inertia(phi_i) @ twist / 2 - GRAVITY @ first_moment
        return total

    h = 1e-5
    rate = (energy(h) - energy(-h)) / (2 * h)
    assert np.isclose(torques @ dq, rate, rtol=1e-6, atol=1e-6)


def test_equation_11_ground_wrench_is_the_rate_of_momentum(rng):
    tree = random_tree(rng)
    phi = random_phi(rng, len(tree.inertial))
    q, dq, ddq = state(rng, tree)
    ground, _ = dim.inverse_dynamics(Mechanism(tree, np.zeros(3), phi), Motion(q, dq, ddq))

    def momentum(t):
        q_t, dq_t = moved_states(tree, q, dq, ddq, t)
        _, V, _ = recursion(tree, q_t, dq_t, ddq, np.zeros(3))
        twists = [V[i] for i in tree.inertial]
        terms = zip(inertial_poses(tree, q_t), twists, phi.reshape(-1, 10), strict=True)
        return sum(se3.coAd(T) @ dim.spatial_inertia(p) @ twist for T, twist, p in terms)

    h = 1e-5
    np.testing.assert_allclose((momentum(h) - momentum(-h)) / (2 * h), ground, atol=2e-5 * abs(ground).max())


def test_equations_12_and_13_are_momentum_and_newton_euler_of_one_body(rng):
    phi, V, dV = random_phi(rng, 1), rng.normal(size=6), rng.normal(size=6)
    M = dim.spatial_inertia(phi)
    np.testing.assert_allclose(dim.momentum_regressor(V) @ phi, M @ V, atol=1e-12)
    np.testing.assert_allclose(dim.body_regressor(V, dV) @ phi, M @ dV - se3.ad(V).T @ M @ V, atol=1e-11)


def test_equation_14_gives_the_wrench_of_equation_11(rng):
    tree = random_tree(rng)
    phi = random_phi(rng, len(tree.inertial))
    mechanism, motion = Mechanism(tree, GRAVITY, phi), Motion(*state(rng, tree))
    ground, _ = dim.inverse_dynamics(mechanism, motion)
    Y = dim.base_wrench_regressor(mechanism, motion)
    np.testing.assert_allclose(Y @ phi, ground, atol=1e-12 * abs(ground).max())
