"""The identities of Section III.B and the group axioms, on random elements."""

import numpy as np
import pytest
from mechanisms import random_phi, random_pose, random_twist, unhat
from scipy.linalg import expm

from ident.geometry import inertia, se3

SEEDS = range(6)


@pytest.fixture(params=SEEDS)
def rng(request):
    return np.random.default_rng(request.param)


@pytest.mark.parametrize("kind", ["revolute", "prismatic", "helical", "welded"])
@pytest.mark.parametrize("theta", [0.0, 1e-12, 1e-6, 1e-3, 1.0, np.pi, -7.0])
def test_exp_is_the_matrix_exponential(kind, theta):
    xi = random_twist(np.random.default_rng(0), kind)
    np.testing.assert_allclose(se3.exp(xi, theta), expm(se3.hat(xi) * theta), atol=1e-13)


def test_group_axioms(rng):
    a, b, c = (random_pose(rng) for _ in range(3))
    np.testing.assert_allclose(se3.inverse(a) @ a, np.eye(4), atol=1e-14)
    np.testing.assert_allclose(se3.inverse(a @ b), se3.inverse(b) @ se3.inverse(a), atol=1e-13)
    np.testing.assert_allclose((a @ b) @ c, a @ (b @ c), atol=1e-13)


def test_adjoint_is_conjugation(rng):
    T, V = random_pose(rng), rng.normal(size=6)
    np.testing.assert_allclose(se3.hat(se3.Ad(T) @ V), T @ se3.hat(V) @ se3.inverse(T), atol=1e-13)


def test_adjoint_is_a_homomorphism(rng):
    a, b = random_pose(rng), random_pose(rng)
    np.testing.assert_allclose(se3.Ad(a @ b), se3.Ad(a) @ se3.Ad(b), atol=1e-13)
    np.testing.assert_allclose(se3.Ad(se3.inverse(a)) @ se3.Ad(a), np.eye(6), atol=1e-13)


def test_ad_is_the_lie_bracket_and_the_derivative_of_Ad(rng):
    xi, V = random_twist(rng, "helical"), rng.normal(size=6)
    bracket = se3.hat(xi) @ se3.hat(V) - se3.hat(V) @ se3.hat(xi)
    np.testing.assert_allclose(se3.hat(se3.ad(xi) @ V), bracket, atol=1e-14)
    h = 1e-5
    derivative = (se3.Ad(se3.exp(xi, h)) - se3.Ad(se3.exp(xi, -h))) / (2 * h)
    np.testing.assert_allclose(derivative, se3.ad(xi), atol=1e-8)


def moving(rng):
    """A pose as a smooth function of time, and its velocity matrix by central differences."""
    start, xi = random_pose(rng), random_twist(rng, "helical")
    other, eta = random_pose(rng), random_twist(rng, "helical")

    def pose(t):
        return start @ se3.exp(xi, np.sin(t)) @ other @ se3.exp(eta, t**2)

    return pose


def velocities(pose, t, h=1e-5):
    """Spatial and body velocity `Ṫ T⁻¹` and `T⁻¹ Ṫ` by central differences."""
    rate = (pose(t + h) - pose(t - h)) / (2 * h)
    return unhat(rate @ se3.inverse(pose(t))), unhat(se3.inverse(pose(t)) @ rate)


def test_equation_6_spatial_velocity_is_Ad_of_body_velocity(rng):
    pose = moving(rng)
    spatial, body = velocities(pose, 0.7)
    np.testing.assert_allclose(spatial, se3.Ad(pose(0.7)) @ body, atol=1e-7)


def test_equation_6_velocities_of_composed_motions(rng):
    T_ab, T_bc = moving(rng), moving(rng)
    spatial_ab, body_ab = velocities(T_ab, 0.7)
    spatial_bc, body_bc = velocities(T_bc, 0.7)
    spatial_ac, body_ac = velocities(lambda t: T_ab(t) @ T_bc(t), 0.7)
    np.testing.assert_allclose(spatial_ac, spatial_ab + se3.Ad(T_ab(0.7)) @ spatial_bc, atol=1e-6)
    np.testing.assert_allclose(body_ac, se3.Ad(se3.inverse(T_bc(0.7))) @ body_ab + body_bc, atol=1e-6)


def test_leading_dimensions_are_batches(rng):
    xi = np.stack([random_twist(rng, "helical") for _ in range(6)]).reshape(2, 3, 6)
    theta = rng.normal(size=(2, 3))
    T = se3.exp(xi, theta)
    for name in ("inverse", "Ad", "coAd"):
        batch = getattr(se3, name)(T)
        for index in np.ndindex(2, 3):
            np.testing.assert_array_equal(batch[index], getattr(se3, name)(T[index]))
    for index in np.ndindex(2, 3):
        np.testing.assert_allclose(T[index], se3.exp(xi[index], theta[index]), atol=1e-15)
        np.testing.assert_array_equal(se3.ad(xi)[index], se3.ad(xi[index]))
    phi = random_phi(rng, 3).reshape(3, 10)
    np.testing.assert_array_equal(inertia.pseudo_inertia(phi), [inertia.pseudo_inertia(own) for own in phi])


def test_names_are_those_of_the_papers_tables():
    assert inertia.parameter_names(2)[:10] == (
        *("m1", "m1rx1", "m1ry1", "m1rz1"),
        *("Ixx1", "Iyy1", "Izz1", "Ixy1", "Ixz1", "Iyz1"),
    )
    assert inertia.parameter_names(2)[13] == "m2rz2"


@pytest.mark.parametrize("seed", range(4))
def test_com_form_and_back(seed):
    phi = random_phi(np.random.default_rng(seed), 1)
    np.testing.assert_allclose(inertia.parameters_from_com(*inertia.com_from_parameters(phi)), phi, rtol=1e-13)


@pytest.mark.parametrize("seed", range(4))
def test_pseudo_inertia_is_the_second_moment_of_point_masses(seed):
    rng = np.random.default_rng(seed)
    m, x = rng.uniform(0.1, 1, 7), rng.normal(size=(7, 3))
    points = np.column_stack([x, np.ones(7)])
    com = m @ x / m.sum()
    about_com = sum(mk * (d @ d * np.eye(3) - np.outer(d, d)) for mk, d in zip(m, x - com, strict=True))
    phi = inertia.parameters_from_com(m.sum(), com, about_com)
    np.testing.assert_allclose(inertia.pseudo_inertia(phi), (points.T * m) @ points, atol=1e-13)
