from dataclasses import replace

import numpy as np
import pytest
from mechanisms import (
    GRAVITY,
    double_pendulum,
    random_phi,
    random_states,
    random_tree,
    regrouping_error,
    tilted_axis,
)
from regroupings import check_regroupings

from experiments.data import paper
from ident.geometry.inertia import parameter_names
from ident.mechanism.tree import Tree
from ident.model.regressor import base_wrench_regressor
from ident.parameters.base_parameters import find_base_parameters

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


@pytest.mark.parametrize("tilt_deg", [10.0**-k for k in range(-1, 13, 3)])
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


@pytest.mark.parametrize("seed", range(6))
def test_regrouping_predicts_the_same_wrench(seed):
    rng = np.random.default_rng(seed)
    tree = random_tree(rng)
    base, phi = base_of(tree), random_phi(rng, len(tree.inertial))
    Y = regressor_of(tree, samples=20, seed=99)
    expected = Y @ phi
    np.testing.assert_allclose(base.reduce(Y) @ base.regroup(phi), expected, atol=1e-8 * abs(expected).max())
    assert base.rank == np.linalg.matrix_rank(Y.reshape(-1, Y.shape[-1]), tol=1e-8 * np.linalg.norm(Y))


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


def test_kept_columns_span_the_regressor_of_every_tree():
    check_regroupings(12)


def test_chains_that_stretch_far_pass_over_nearly_dependent_columns():
    """The first independent columns of a chain in general position get ten times as dependent with each joint."""
    rng = np.random.default_rng(0)
    short = find_base_parameters(random_tree(rng, 5, kinds=("revolute",), chain=True))
    assert short.passed_over == () and short.remark == ""
    far = find_base_parameters(random_tree(rng, 40, kinds=("revolute",), chain=True))
    assert far.rank == 7 * 39 + 1
    assert set(far.passed_over) <= {far.parameters[k] for k in far.dependent}
    assert far.remark.endswith(f"{', '.join(far.passed_over)}.")


@pytest.mark.parametrize("length", [1e-4, 1e-2, 1e3])
def test_regrouping_holds_in_any_unit_of_length(length):
    rng = np.random.default_rng(1)
    tree = random_tree(rng, 15)
    metres = find_base_parameters(tree, gravity=GRAVITY)
    bodies = []
    for body in tree.bodies:
        home, twist = body.home.copy(), body.twist.copy()
        home[:3, 3] *= length
        twist[:3] *= length if twist[3:].any() else 1
        bodies.append(replace(body, home=home, twist=twist))
    scaled = Tree(tuple(bodies))
    base = find_base_parameters(scaled, gravity=GRAVITY)
    Y = base_wrench_regressor(scaled, *random_states(rng, scaled, 100), gravity=GRAVITY)
    assert base.rank == metres.rank
    assert regrouping_error(base, Y) <= 1e-10


def test_pinned_columns_that_make_up_the_others_only_roughly_are_refused():
    a, b = np.random.default_rng(0).normal(size=(2, 50))
    Y = np.stack([a, a + 3e-9 * b, b], axis=1)
    assert find_base_parameters(Y, "pqr").names == ("p", "r")
    with pytest.raises(ValueError, match="so nearly dependent"):
        find_base_parameters(Y, "pqr", kept="pq")
