"""The identities of Section III.B and the group axioms, on random elements."""

import numpy as np
import pytest
from mechanisms import random_pose, random_twist, unhat
from scipy.linalg import expm

from ident.geometry import inertia, se3
from ident.geometry.se3 import Ad, hat


@pytest.fixture(params=range(2))
def rng(request):
    return np.random.default_rng(request.param)


@pytest.mark.parametrize("kind", ["revolute", "prismatic", "helical", "welded"])
@pytest.mark.parametrize("theta", [0.0, 1e-12, 1e-6, 1e-3, 1.0, np.pi, -7.0])
def test_exp_is_the_matrix_exponential(kind, theta):
    xi = random_twist(np.random.default_rng(0), kind)
    np.testing.assert_allclose(se3.exp(xi, theta), expm(hat(xi) * theta), atol=1e-13)


def test_adjoint_is_a_homomorphism_and_conjugation(rng):
    a, b, V = random_pose(rng), random_pose(rng), rng.normal(size=6)
    np.testing.assert_allclose(se3.inverse(a), np.linalg.inv(a), atol=1e-13)
    np.testing.assert_allclose(Ad(a @ b), Ad(a) @ Ad(b), atol=1e-13)
    np.testing.assert_allclose(hat(Ad(a) @ V), a @ hat(V) @ se3.inverse(a), atol=1e-13)
    np.testing.assert_allclose(se3.coAd(a), np.linalg.inv(Ad(a)).T, atol=1e-13)


def moving(rng):
    """A pose as a smooth function of time."""
    start, other = random_pose(rng), random_pose(rng)
    xi, eta = random_twist(rng, "helical"), random_twist(rng, "helical")
    return lambda t: start @ se3.exp(xi, np.sin(t)) @ other @ se3.exp(eta, t**2)


def velocities(pose, t=0.7, h=1e-5):
    """Spatial and body velocity `Ṫ T⁻¹` and `T⁻¹ Ṫ` by central differences."""
    rate = (pose(t + h) - pose(t - h)) / (2 * h)
    return unhat(rate @ se3.inverse(pose(t))), unhat(se3.inverse(pose(t)) @ rate)


def test_equation_6_velocities_of_composed_motions(rng):
    """Spatial velocity is Ad of body velocity."""
    T_ab, T_bc = moving(rng), moving(rng)
    spatial_ab, body_ab = velocities(T_ab)
    spatial_bc, body_bc = velocities(T_bc)
    spatial_ac, body_ac = velocities(lambda t: T_ab(t) @ T_bc(t))
    np.testing.assert_allclose(spatial_ab, Ad(T_ab(0.7)) @ body_ab, atol=1e-7)
    np.testing.assert_allclose(spatial_ac, spatial_ab + Ad(T_ab(0.7)) @ spatial_bc, atol=1e-6)
    np.testing.assert_allclose(body_ac, Ad(se3.inverse(T_bc(0.7))) @ body_ab + body_bc, atol=1e-6)


def test_pseudo_inertia_is_the_second_moment_of_point_masses(rng):
    m, x = rng.uniform(0.1, 1, 7), rng.normal(size=(7, 3))
    points, com = np.column_stack([x, np.ones(7)]), m @ x / m.sum()
    about_com = sum(mk * (d @ d * np.eye(3) - np.outer(d, d)) for mk, d in zip(m, x - com, strict=True))
    phi = inertia.parameters_from_com(m.sum(), com, about_com)
    np.testing.assert_allclose(inertia.pseudo_inertia(phi), (points.T * m) @ points, atol=1e-13)
    for own, expected in zip(inertia.com_from_parameters(phi), (m.sum(), com, about_com), strict=True):
        np.testing.assert_allclose(own, expected, atol=1e-13)
