"""Base parameters of structures and of regressors, against each other, ranks and known formulas."""

from dataclasses import replace
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path

import mechanisms
import numpy as np
import pytest
from mechanisms import GRAVITY, double_pendulum, random_states, random_tree, regrouping_error, tilted_axis
from random_models import random_model

from experiments.data import paper
from ident import BaseMotion, InputError, Sensors, Tree, base_wrench_regressor, find_base_parameters
from ident.geometry.inertia import parameter_names
from ident.geometry.se3 import coAd, inverse
from ident.model.regressor import joint_torque_regressor
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


def test_parallel_axes_have_rank_13_however_little_they_tilt_and_others_15():
    for tilt_deg in (10, 1e-2, 1e-5, 1e-11):
        axis = tilted_axis(tilt_deg, 120)
        tree = double_pendulum(axis, axis)
        assert base_of(tree).rank == find_base_parameters(tree).rank == 13
    for difference_deg in (1e-3, 1, 90):
        tree = double_pendulum(tilted_axis(5, 120), tilted_axis(5 + difference_deg, 120))
        assert base_of(tree).rank == find_base_parameters(tree).rank == 15
    assert find_base_parameters(tree, sensors=Sensors(False, True)).rank == 10


def test_pinned_names_that_are_no_basis_are_refused():
    for kept, message in (
        (["m1", "m9"], "named m9"),
        (TABLE_NAMES[:-1], "12 names of rank 12, where the regressor has rank 13"),
        ([*TABLE_NAMES[:-1], "Iyy2"], "13 names of rank 12"),
    ):
        with pytest.raises(ValueError, match=message):
            base_of(double_pendulum(), kept=kept)


def test_pinned_columns_that_make_up_the_others_only_roughly_are_refused():
    a, b = np.random.default_rng(0).normal(size=(2, 50))
    Y = np.stack([a, a + 3e-9 * b, b], axis=1)
    assert find_base_parameters(Y, "pqr").names == ("p", "r")
    with pytest.raises(ValueError, match="so nearly dependent"):
        find_base_parameters(Y, "pqr", kept="pq")
    assert find_base_parameters(Y, np.array(list("pqr")), kept=np.array(["p", "r"])).names == ("p", "r")
    for given in ({"kept": [1]}, {"parameters": 3}):
        with pytest.raises(InputError, match=f"{next(iter(given))} needs a list of names of parameters, got"):
            find_base_parameters(Y, **{"parameters": "pqr", **given})


def tree_of_any_kind(seed, bodies):
    """Trees and chains of all kinds of joints, with gravity any way or none."""
    rng = np.random.default_rng(seed)
    if seed % 4 == 3:
        model = random_model(rng, bodies)
        return tree_from_model(model, "b0"), gravity_in_base(model, "b0")
    kinds = ({"massless": 0.1}, {"kinds": mechanisms.SCREWS}, {"kinds": ("revolute",)})[seed % 4]
    return random_tree(rng, bodies, chain=seed % 4 == 2, **kinds), GRAVITY * (seed % 5 > 0)


@pytest.mark.parametrize(("seed", "bodies"), [(1, 3), (2, 5), (4, 12), (6, 20), (7, 28), (8, 40)])
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


@pytest.mark.parametrize("seed", range(6))
def test_structure_equals_the_regressor_at_random_states(seed):
    rng = np.random.default_rng(seed)
    tree = random_tree(rng, int(rng.integers(2, 9)), massless=0.2)
    gravity = 5 * rng.normal(size=3)
    states = random_states(rng, tree, 20 * len(tree.bodies))
    wrench, torques = (of(tree, *states, gravity=gravity) for of in (base_wrench_regressor, joint_torque_regressor))
    both = np.concatenate([wrench, torques], axis=1)
    for sensors, Y in ((Sensors(), wrench), (Sensors(False, True), torques), (Sensors(True, True), both)):
        if not Y.any():
            continue  # Nothing that moves has a mass.
        exact = find_base_parameters(tree, gravity=gravity, sensors=sensors)
        numeric = find_base_parameters(Y, kept=exact.names)
        assert numeric.rank == exact.rank
        np.testing.assert_allclose(exact.beta, numeric.beta, rtol=0, atol=1e-9 * max(1, abs(exact.beta).max()))
        assert exact.gap[0] > 1e-6 > 1e-12 > exact.gap[1]


def test_rank_of_a_floating_chain_of_revolute_joints():
    n = 12
    tree = random_tree(np.random.default_rng(n), n, kinds=("revolute",))
    assert find_base_parameters(tree, sensors=Sensors(moving_base=True)).rank == 10 + 7 * (n - 1)


def test_exact_numbers_give_exact_coefficients():
    """Exact with fractions: a pendulum of length 17/40 has its square as a coefficient."""

    def exact(x):
        return np.vectorize(Fraction, otypes=[object])(x)

    tree = double_pendulum()
    numbers = find_base_parameters(tree)
    for coefficient in (0.425, 0.425**2, 1.0):
        assert abs(abs(numbers.beta) - coefficient).min() < 1e-15
    bodies = tuple(replace(body, home=exact(body.home), twist=exact(body.twist)) for body in tree.bodies)
    base = find_base_parameters(Tree(bodies), gravity=exact([0, 0, -1]))
    assert base.names == numbers.names and Fraction(0.425) ** 2 in base.beta
    assert "Ixx2 + (" in base.expressions()[5]
    with pytest.raises(ValueError, match="can be pinned for numbers"):
        find_base_parameters(Tree(bodies), gravity=exact([0, 0, -1]), kept=base.names)


@pytest.mark.parametrize("moving_base", [False, True], ids=["resting", "moving"])
@pytest.mark.parametrize("seed", range(6))
def test_channels_of_the_base_wrench_see_what_their_regressor_shows(seed, moving_base):
    """Ranks and regroupings of some rows of the regressor, in frames at any pose and along frame axes."""
    rng = np.random.default_rng(seed)
    kinds = ("helical", "revolute") if seed % 4 == 0 else mechanisms.JOINTS
    tree = random_tree(rng, int(rng.integers(2, 6)), kinds=kinds, massless=0.1)
    pose, samples = mechanisms.random_pose(rng) if seed % 2 else np.eye(4), 40 * len(tree.bodies)
    rows = coAd(inverse(pose))[rng.choice(6, int(rng.integers(1, 6)), replace=False)]
    states = random_states(rng, tree, samples)
    free = rng.normal(size=(samples, 7)), *rng.normal(size=(2, samples, 6))
    motion = BaseMotion.from_free_joint(*free) if moving_base else None
    Y = rows @ base_wrench_regressor(tree, *states, gravity=GRAVITY, base=motion)
    exact = find_base_parameters(tree, gravity=GRAVITY, sensors=Sensors(moving_base=moving_base, channels=rows))
    assert find_base_parameters(Y).rank == exact.rank
    assert regrouping_error(exact, Y) <= 1e-9


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
