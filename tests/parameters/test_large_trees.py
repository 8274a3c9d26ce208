"""Slow regroupings: 40 random trees, and dm_control's animals, with more than sixty bodies each."""

from importlib.util import find_spec
from pathlib import Path

import numpy as np
import pytest
from mechanisms import random_states, regrouping_error
from regroupings import check_regroupings

from ident.model.regressor import base_wrench_regressor
from ident.parameters.base_parameters import find_base_parameters
from sim.models.couplings import couplings
from sim.models.mujoco_model import compiled, gravity_in_base, tree_from_model

DM_CONTROL = find_spec("dm_control")
pytestmark = [
    pytest.mark.skipif(DM_CONTROL is None, reason="dm_control is not installed; make test-extras does"),
    pytest.mark.extras,
]


def test_kept_columns_span_the_regressor_of_40_random_trees():
    check_regroupings(40)


@pytest.mark.parametrize("animal", ["dog_v2/dog.xml", "rodent.xml"])
def test_kept_columns_span_the_regressor(animal):
    model = compiled(Path(DM_CONTROL.submodule_search_locations[0], "locomotion/walkers/assets", animal))
    tree = tree_from_model(model, ignore=[coupling.name for coupling in couplings(model)])
    gravity = gravity_in_base(model)
    base = find_base_parameters(tree, gravity=gravity)
    Y = base_wrench_regressor(tree, *random_states(np.random.default_rng(0), tree, 300), gravity=gravity)
    assert regrouping_error(base, Y) <= 1e-10
    kept = base.reduce(Y).reshape(-1, base.rank)
    assert np.linalg.cond(kept / np.linalg.norm(kept, axis=0)) <= 1e7
    assert base.gap[0] > 1e-6 > 1e-12 > base.gap[1]
    assert base.passed_over
