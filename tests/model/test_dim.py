"""Eq. 7-14, each against something other than the paper's recursion."""

import numpy as np
import pytest
from mechanisms import GRAVITY, moved_states, random_phi, random_pose, random_states, random_tree, random_twist, unhat
from scipy.linalg import expm

from ident import Mechanism, Motion
from ident.geometry import se3
from ident.geometry.inertia import pseudo_inertia
from ident.mechanism.body import BASE, Body
from ident.model import dim


@pytest.fixture(params=range(2))
def rng(request):
    return np.random.default_rng(request.param)


@pytest.fixture
def tree(rng):
    return random_tree(rng)


@pytest.fixture
def state(rng, tree):
    return tuple(x[0] for x in random_states(rng, tree, 1))


@pytest.fixture
def phi(rng, tree):
    return random_phi(rng, len(tree.inertial))


def slope(function, h):
    return (function(h) - function(-h)) / (2 * h)


def test_equation_7_is_the_exponential(rng):
    body = Body("a", BASE, random_pose(rng), random_twist(rng, "helical"))
    computed = dim.relative_pose(body, np.array([0.7]))
    np.testing.assert_allclose(computed, body.home @ expm(se3.hat(body.twist) * 0.7), atol=1e-13)


def test_equation_9_is_the_derivative_of_the_motion_with_gravity_as_an_acceleration_of_the_base(tree, state):
    _, V, dV = dim.forward_recursion(Mechanism(tree, GRAVITY), Motion(*state))

    def moved(t):
        return tree.poses(moved_states(tree, *state, t)[0])

    def twists(t):
        rates = slope(lambda h: moved(t + h), 1e-5)
        return np.array([unhat(rate) for rate in se3.inverse(moved(t)) @ rates])

    np.testing.assert_allclose(V, twists(0), atol=2e-7)
    upward = np.pad(-GRAVITY @ moved(0)[:, :3, :3], [(0, 0), (0, 3)])
    np.testing.assert_allclose(dV, slope(twists, 1e-4) + upward, atol=2e-4)


def test_equation_10_gives_the_kinetic_energy_of_the_mass_points(rng):
    phi, V = random_phi(rng, 1), rng.normal(size=6)
    energy = np.trace(se3.hat(V) @ pseudo_inertia(phi) @ se3.hat(V).T) / 2
    assert np.isclose(V @ dim.spatial_inertia(phi) @ V / 2, energy, rtol=1e-12)


def test_equations_9_and_11_are_the_rates_of_energy_and_of_momentum(tree, state, phi):
    """Power of the joints' torques, and the ground's wrench without gravity."""

    def bodies(t):
        q, dq = moved_states(tree, *state, t)
        T, (_, V, _) = tree.poses(q), dim.forward_recursion(Mechanism(tree, GRAVITY), Motion(q, dq, state[2]))
        return [(T[i], V[i], own) for i, own in zip(tree.inertial, phi.reshape(-1, 10), strict=True)]

    def energy(t):
        weights = (GRAVITY @ (own[0] * T[:3, 3] + T[:3, :3] @ own[1:4]) for T, _, own in bodies(t))
        return sum(V @ dim.spatial_inertia(own) @ V / 2 for _, V, own in bodies(t)) - sum(weights)

    def momentum(t):
        return sum(se3.coAd(T) @ dim.spatial_inertia(own) @ V for T, V, own in bodies(t))

    _, torques = dim.inverse_dynamics(Mechanism(tree, GRAVITY, phi), Motion(*state))
    assert np.isclose(torques @ state[1], slope(energy, 1e-5), rtol=1e-6, atol=1e-6)
    ground, _ = dim.inverse_dynamics(Mechanism(tree, np.zeros(3), phi), Motion(*state))
    np.testing.assert_allclose(slope(momentum, 1e-5), ground, atol=2e-5 * abs(ground).max())


def test_equations_12_and_13_are_momentum_and_newton_euler_of_one_body(rng):
    phi, V, dV = random_phi(rng, 1), rng.normal(size=6), rng.normal(size=6)
    M = dim.spatial_inertia(phi)
    np.testing.assert_allclose(dim.momentum_regressor(V) @ phi, M @ V, atol=1e-12)
    np.testing.assert_allclose(dim.body_regressor(V, dV) @ phi, M @ dV - se3.ad(V).T @ M @ V, atol=1e-11)


def test_equation_14_gives_the_wrench_of_equation_11(tree, state, phi):
    mechanism, motion = Mechanism(tree, GRAVITY, phi), Motion(*state)
    ground, _ = dim.inverse_dynamics(mechanism, motion)
    Y = dim.base_wrench_regressor(mechanism, motion)
    np.testing.assert_allclose(Y @ phi, ground, atol=1e-12 * abs(ground).max())
