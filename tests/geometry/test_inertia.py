import numpy as np
import pytest
from mechanisms import random_phi

from ident.geometry import inertia


def test_names_are_those_of_the_papers_tables():
    assert inertia.parameter_names(2)[:10] == (
        *("m1", "m1rx1", "m1ry1", "m1rz1"),
        *("Ixx1", "Iyy1", "Izz1", "Ixy1", "Ixz1", "Iyz1"),
    )
    assert inertia.parameter_names(2)[13] == "m2rz2"


@pytest.mark.parametrize("seed", range(10))
def test_com_form_and_back(seed):
    phi = random_phi(np.random.default_rng(seed), 1)
    np.testing.assert_allclose(inertia.parameters_from_com(*inertia.com_from_parameters(phi)), phi, rtol=1e-13)


@pytest.mark.parametrize("seed", range(10))
def test_pseudo_inertia_is_the_second_moment_of_point_masses(seed):
    rng = np.random.default_rng(seed)
    m, x = rng.uniform(0.1, 1, 7), rng.normal(size=(7, 3))
    points = np.column_stack([x, np.ones(7)])
    com = m @ x / m.sum()
    about_com = sum(mk * (d @ d * np.eye(3) - np.outer(d, d)) for mk, d in zip(m, x - com, strict=True))
    phi = inertia.parameters_from_com(m.sum(), com, about_com)
    np.testing.assert_allclose(inertia.pseudo_inertia(phi), (points.T * m) @ points, atol=1e-13)


def test_pseudo_inertia_takes_batches():
    phi = random_phi(np.random.default_rng(0), 3).reshape(3, 10)
    batch = inertia.pseudo_inertia(phi)
    for k in range(3):
        np.testing.assert_array_equal(batch[k], inertia.pseudo_inertia(phi[k]))


def test_a_massless_body_has_no_centre_of_mass():
    with pytest.raises(ValueError, match="zero mass"):
        inertia.com_from_parameters(np.zeros(10))
