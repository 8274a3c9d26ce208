"""Base parameters against ranks and regressors, and their elimination against the plain way."""

from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from mechanisms import GRAVITY, SCREWS, double_pendulum, random_states, random_tree, regrouping_error, tilted_axis
from random_models import random_model
from scipy import linalg

from experiments.data import paper
from ident.errors import InputError
from ident.geometry.inertia import parameter_names
from ident.mechanism.tree import Tree
from ident.model.regressor import base_wrench_regressor
from ident.parameters import independent_columns
from ident.parameters.base_parameters import find_base_parameters
from ident.tolerances import ROUNDING
from sim.models.couplings import couplings
from sim.models.mujoco_model import compiled, gravity_in_base, tree_from_model

TABLE_NAMES = list(paper.TABLE_3)


def regressor_of(tree, samples=60, gravity=GRAVITY):
    return base_wrench_regressor(tree, *random_states(np.random.default_rng(0), tree, samples), gravity=gravity)


def base_of(tree, **options):
    return find_base_parameters(regressor_of(tree), parameter_names(len(tree.inertial)), **options)


def assert_regroups(base, Y):
    """Checks that the dependent columns' combinations hold, and that the kept ones are well apart."""
    kept = base.reduce(Y).reshape(-1, base.rank)
    assert regrouping_error(base, Y) <= 1e-10
    assert np.linalg.cond(kept / np.linalg.norm(kept, axis=0)) <= 1e7
    assert base.gap[0] > 1e-6 > 1e-12 > base.gap[1]


def test_double_pendulum_has_the_papers_base_parameters():
    base = base_of(double_pendulum())
    assert list(base.names) == TABLE_NAMES
    assert base.expressions() == (
        *("m1 + m2 + m3", "m1rx1 + m2rx2 + m3rx3", "m1ry1", "m2ry2", "m2rz2 + 0.425 m3", "Ixx2 + 0.180625 m3"),
        *("Ixy2", "Ixz2 - 0.425 m3rx3", "m3ry3", "m3rz3", "Ixx3", "Ixy3", "Ixz3"),
    )
    unseen = "m1rz1 Ixx1 Iyy1 Izz1 Ixy1 Ixz1 Iyz1 Iyy2 Izz2 Iyz2 Iyy3 Izz3 Iyz3"
    assert set(base.unseen) == set(unseen.split())


@pytest.mark.parametrize("tilt_deg", [10, 1e-2, 1e-5, 1e-11])
def test_parallel_axes_have_rank_13_however_little_they_tilt(tilt_deg):
    axis = tilted_axis(tilt_deg, 120)
    tree = double_pendulum(axis, axis)
    assert base_of(tree).rank == find_base_parameters(tree).rank == 13
    expected = "m1 m1rx1 m1ry1 m2rx2 m2ry2 Ixx2 Iyy2 Izz2 m3rx3 m3ry3 Ixx3 Iyy3 Izz3"
    assert tilt_deg < 10 or base_of(tree).names == tuple(expected.split())


@pytest.mark.parametrize("difference_deg", [1e-3, 1, 90])
def test_axes_that_are_not_parallel_have_rank_15(difference_deg):
    assert base_of(double_pendulum(tilted_axis(5, 120), tilted_axis(5 + difference_deg, 120))).rank == 15


@pytest.mark.parametrize(
    ("kept", "message"),
    [
        (["m1", "m9"], "named m9"),
        (TABLE_NAMES[:-1], "12 names of rank 12, where the regressor has rank 13"),
        ([*TABLE_NAMES[:-1], "Iyy2"], "13 names of rank 12"),
    ],
)
def test_pinned_names_that_are_no_basis_are_refused(kept, message):
    with pytest.raises(ValueError, match=message):
        base_of(double_pendulum(), kept=kept)


def test_pinned_columns_that_make_up_the_others_only_roughly_are_refused():
    a, b = np.random.default_rng(0).normal(size=(2, 50))
    Y = np.stack([a, a + 3e-9 * b, b], axis=1)
    assert find_base_parameters(Y, "pqr").names == ("p", "r")
    with pytest.raises(ValueError, match="so nearly dependent"):
        find_base_parameters(Y, "pqr", kept="pq")
    assert find_base_parameters(Y, np.array(list("pqr")), kept=np.array(["p", "r"])).names == ("p", "r")
    for given in ({"kept": 3}, {"kept": [1]}, {"kept": np.ones(2)}, {"parameters": 3}):
        with pytest.raises(InputError, match=f"{next(iter(given))} needs a list of names of parameters, got"):
            find_base_parameters(Y, **{"parameters": "pqr", **given})


def tree_of_any_kind(seed, bodies):
    """Trees and chains of all kinds of joints, with gravity any way or none."""
    rng = np.random.default_rng(seed)
    if seed % 4 == 3:
        model = random_model(rng, bodies)
        return tree_from_model(model, "b0"), gravity_in_base(model, "b0")
    kinds = {"massless": 0.1} if seed % 4 == 0 else {"kinds": SCREWS} if seed % 4 == 1 else {"kinds": ("revolute",)}
    return random_tree(rng, bodies, chain=seed % 4 == 2, **kinds), GRAVITY * (seed % 5 > 0)


@pytest.mark.parametrize(("seed", "bodies"), [(1, 3), (2, 5), (3, 8), (4, 12), (6, 20), (7, 28), (8, 40), (9, 50)])
def test_kept_columns_span_the_regressor_of_every_tree(seed, bodies):
    tree, gravity = tree_of_any_kind(seed, bodies)
    base = find_base_parameters(tree, gravity=gravity)
    assert_regroups(base, regressor_of(tree, 40 + 5 * len(tree.bodies), gravity))


def test_chains_that_stretch_far_pass_over_nearly_dependent_columns():
    """The first independent columns of a chain in general position get ten times as dependent with each joint."""
    rng = np.random.default_rng(0)
    short, far = (find_base_parameters(random_tree(rng, n, kinds=("revolute",), chain=True)) for n in (5, 40))
    assert short.passed_over == () and short.remark == ""
    assert far.rank == 7 * 39 + 1
    assert set(far.passed_over) <= {far.parameters[k] for k in far.dependent}
    assert far.remark.endswith(f"{', '.join(far.passed_over)}.")


@pytest.mark.parametrize("length", [1e-4, 1e3])
def test_regrouping_holds_in_any_unit_of_length(length):
    tree, bodies = random_tree(np.random.default_rng(1), 15), []
    for body in tree.bodies:
        home, twist = body.home.copy(), body.twist.copy()
        home[:3, 3] *= length
        twist[:3] *= length if twist[3:].any() else 1
        bodies.append(replace(body, home=home, twist=twist))
    base = find_base_parameters(Tree(tuple(bodies)), gravity=GRAVITY)
    assert base.rank == find_base_parameters(tree, gravity=GRAVITY).rank
    assert regrouping_error(base, regressor_of(Tree(tuple(bodies)), 100)) <= 1e-10


def plainly_exchanged(order, made, largest):
    """Kept columns and those passed over, by exchanges in the coefficients of all columns (r, P)."""
    kept, passed = order.copy(), []
    for j in range(made.shape[1]):
        share = np.where(kept > j, abs(made[:, j]), 0)
        i = int(share.argmax())
        if j in kept or share[i] <= ROUNDING:
            continue
        row = made[i] / made[i, j]
        after = made - np.outer(made[:, j], row)
        after[i] = row
        if abs(after).max() <= largest:
            made, kept[i] = after, j
        else:
            passed.append(j)
    return sorted(kept.tolist()), passed


@pytest.mark.parametrize("largest", [1.5, 10, 1e3])
def test_exchanges_within_a_bound_equal_the_plain_way(largest, monkeypatch):
    monkeypatch.setattr(independent_columns, "COEFFICIENTS", (largest, largest))
    for seed in range(4):
        rng = np.random.default_rng(seed)
        columns = rng.normal(size=(30, 12)) @ (rng.normal(size=(12, 30)) * rng.uniform(0, 1, size=(12, 30)) ** 3)
        unit, made = columns / np.linalg.norm(columns, axis=0), np.empty((12, 30))
        triangle, order = linalg.qr(unit, mode="r", pivoting=True)
        made[:, order] = linalg.solve_triangular(triangle[:12, :12], triangle[:12])
        assert independent_columns.first_independent(unit, 12, 0.0) == plainly_exchanged(order[:12], made, largest)


DM_CONTROL = find_spec("dm_control")


@pytest.mark.skipif(DM_CONTROL is None, reason="dm_control is not installed; make test-extras does")
@pytest.mark.extras
@pytest.mark.parametrize("animal", ["dog_v2/dog.xml", "rodent.xml"])
def test_kept_columns_span_the_regressor_of_animals(animal):
    model = compiled(Path(DM_CONTROL.submodule_search_locations[0], "locomotion/walkers/assets", animal))
    tree = tree_from_model(model, ignore=[coupling.name for coupling in couplings(model)])
    gravity = gravity_in_base(model)
    base = find_base_parameters(tree, gravity=gravity)
    assert_regroups(base, regressor_of(tree, 300, gravity))
    assert base.passed_over
