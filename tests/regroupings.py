"""Trees of all kinds, and checks of their regroupings, for the tests."""

import numpy as np
from mechanisms import GRAVITY, SCREWS, random_states, random_tree, regrouping_error
from random_models import random_model

from ident.model.regressor import base_wrench_regressor
from ident.parameters.base_parameters import find_base_parameters
from sim.models.mujoco_model import gravity_in_base, tree_from_model


def unit_condition(base, Y):
    """Condition number of the kept columns at unit length."""
    kept = base.reduce(Y).reshape(-1, base.rank)
    return np.linalg.cond(kept / np.linalg.norm(kept, axis=0))


def tree_of_any_kind(seed, bodies):
    """Trees and chains of all kinds of joints, with gravity any way or none."""
    rng = np.random.default_rng(seed)
    if seed % 4 == 3:
        model = random_model(rng, bodies)
        return rng, tree_from_model(model, "b0"), gravity_in_base(model, "b0")
    kinds = {"massless": 0.1} if seed % 4 == 0 else {"kinds": SCREWS} if seed % 4 == 1 else {"kinds": ("revolute",)}
    return rng, random_tree(rng, bodies, chain=seed % 4 == 2, **kinds), GRAVITY * (seed % 5 > 0)


def check_regroupings(trees):
    """Checks trees of 2 to 60 bodies: the dependent columns' combinations hold at new states."""
    for seed, bodies in enumerate(np.geomspace(2, 60, trees).astype(int)):
        rng, tree, gravity = tree_of_any_kind(seed, bodies)
        Y = base_wrench_regressor(tree, *random_states(rng, tree, 40 + 5 * len(tree.bodies)), gravity=gravity)
        if not Y.any():
            continue
        base = find_base_parameters(tree, gravity=gravity)
        assert regrouping_error(base, Y) <= 1e-10, (seed, bodies)
        assert unit_condition(base, Y) <= 1e7, (seed, bodies)
        assert base.gap[0] > 1e-6 > 1e-12 > base.gap[1], (seed, bodies)
