import numpy as np
import pytest
from mechanisms import GRAVITY, double_pendulum, random_phi, random_states, random_tree, tilted_axis

from experiments import paper
from ident.base_parameters import find_base_parameters
from ident.inertia import parameter_names
from ident.regressor import base_wrench_regressor

TABLE_NAMES = list(paper.TABLE_3)


def regressor_of(tree, samples=60, seed=0):
    states = random_states(np.random.default_rng(seed), tree, samples)
    return base_wrench_regressor(tree, *states, gravity=GRAVITY)


def base_of(tree, **options):
    return find_base_parameters(regressor_of(tree), parameter_names(len(tree.inertial)), **options)


def test_double_pendulum_has_the_papers_base_parameters():
    base = base_of(double_pendulum())
    assert list(base.names) == TABLE_NAMES
    assert base.expressions() == (
        *("m1 + m2 + m3", "m1rx1 + m2rx2 + m3rx3", "m1ry1", "m2ry2", "m2rz2 + 0.425 m3", "Ixx2 + 0.180625 m3"),
        *("Ixy2", "Ixz2 - 0.425 m3rx3", "m3ry3", "m3rz3", "Ixx3", "Ixy3", "Ixz3"),
    )
    assert set(base.unseen) == {
        *("m1rz1", "Ixx1", "Iyy1", "Izz1", "Ixy1", "Ixz1", "Iyz1"),
        *("Iyy2", "Izz2", "Iyz2", "Iyy3", "Izz3", "Iyz3"),
    }


@pytest.mark.parametrize("tilt_deg", [10.0**-k for k in range(-1, 13)])
def test_parallel_axes_have_rank_13_however_little_they_tilt(tilt_deg):
    axis = tilted_axis(tilt_deg, 120)
    tree = double_pendulum(axis, axis)
    assert base_of(tree).rank == find_base_parameters(tree).rank == 13


def test_parallel_tilted_axes_have_rank_13_in_other_columns():
    axis = tilted_axis(5, 120)
    base = base_of(double_pendulum(axis, axis))
    expected = "m1 m1rx1 m1ry1 m2rx2 m2ry2 Ixx2 Iyy2 Izz2 m3rx3 m3ry3 Ixx3 Iyy3 Izz3"
    assert base.names == tuple(expected.split())


@pytest.mark.parametrize("difference_deg", [1e-3, 0.01, 1, 90])
def test_axes_that_are_not_parallel_have_rank_15(difference_deg):
    assert base_of(double_pendulum(tilted_axis(5, 120), tilted_axis(5 + difference_deg, 120))).rank == 15


@pytest.mark.parametrize("seed", range(20))
def test_regrouping_predicts_the_same_wrench(seed):
    rng = np.random.default_rng(seed)
    tree = random_tree(rng)
    base, phi = base_of(tree), random_phi(rng, len(tree.inertial))
    Y = regressor_of(tree, samples=20, seed=99)
    expected = Y @ phi
    np.testing.assert_allclose(base.reduce(Y) @ base.regroup(phi), expected, atol=1e-8 * abs(expected).max())
    assert base.rank == np.linalg.matrix_rank(Y.reshape(-1, Y.shape[-1]), tol=1e-8 * np.linalg.norm(Y))


def test_selection_is_the_first_independent_columns():
    rng = np.random.default_rng(0)
    a, b, c = rng.normal(size=(3, 50))
    Y = np.stack([0 * a, a, 2 * a, b, a - 3 * b, 1e6 * c, c + b], axis=1)
    base = find_base_parameters(Y, "opqrstu")
    assert base.names == ("p", "r", "t")
    assert base.unseen == ("o",)
    assert base.expressions() == ("p + 2 q + s", "r - 3 s + u", "t + 1e-06 u")


def test_pinned_names_describe_the_same_wrench():
    axis = tilted_axis(5, 120)
    tree = double_pendulum(axis, axis)
    own, pinned = base_of(tree), base_of(tree, kept=TABLE_NAMES)
    phi, Y = random_phi(np.random.default_rng(0), 3), regressor_of(tree)
    assert list(pinned.names) == TABLE_NAMES
    expected = own.reduce(Y) @ own.regroup(phi)
    np.testing.assert_allclose(pinned.reduce(Y) @ pinned.regroup(phi), expected, atol=1e-9 * abs(expected).max())


@pytest.mark.parametrize(
    ("kept", "message"),
    [
        (["m1", "m9"], "named m9"),
        (TABLE_NAMES[:-1], "12 names of rank 12, where the regressor has rank 13"),
        ([*TABLE_NAMES[:-1], "m2"], "13 names of rank 12"),
        ([*TABLE_NAMES[:-1], "Iyy2"], "13 names of rank 12"),
    ],
)
def test_pinned_names_that_are_no_basis_are_refused(kept, message):
    with pytest.raises(ValueError, match=message):
        base_of(double_pendulum(), kept=kept)


@pytest.mark.parametrize("Y", [np.zeros((5, 6, 30)), np.full((5, 6, 30), np.nan)])
def test_regressors_without_numbers_are_refused(Y):
    with pytest.raises(ValueError, match="finite numbers that are not all zero"):
        find_base_parameters(Y)


def test_names_must_match_the_columns():
    with pytest.raises(ValueError, match="30 columns needs as many names, got 2"):
        find_base_parameters(regressor_of(double_pendulum()), ["a", "b"])
