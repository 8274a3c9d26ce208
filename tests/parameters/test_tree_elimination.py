"""Elimination along the tree against the whole matrix, and exchanges of columns against the plain way."""

import numpy as np
import pytest
from regroupings import tree_of_any_kind
from scipy import linalg

from ident.errors import InputError
from ident.parameters import base_parameters, independent_columns
from ident.parameters.base_parameters import find_base_parameters
from ident.parameters.independent_columns import DEPENDENT
from ident.parameters.structure import Sensors

SENSORS = (
    Sensors(),
    Sensors(False, True),
    Sensors(True, True),
    Sensors(moving_base=True),
    Sensors(False, True, True),
    Sensors(channels=np.eye(6)[[0, 1, 5]]),
    Sensors(channels=np.eye(6)[[2]], moving_base=True),
)


def both_ways(monkeypatch, tree, gravity, sensors):
    """Regroupings along the tree and by the whole matrix; None if no parameter has an effect."""
    out = []
    for large in (1, np.inf):
        monkeypatch.setattr(base_parameters, "LARGE", large)
        try:
            out.append(find_base_parameters(tree, gravity=gravity, sensors=sensors))
        except InputError as error:
            assert "see no parameter" in str(error)
            out.append(None)
    return out


def check_equal(along, whole):
    if whole is None:
        assert along is None
        return
    assert (along.kept, along.dependent, along.passed_over) == (whole.kept, whole.dependent, whole.passed_over)
    np.testing.assert_allclose(along.beta, whole.beta, rtol=0, atol=1e-9 * max(1, abs(whole.beta).max(initial=0)))
    assert not (along.beta[whole.beta == 0]).any()
    assert along.gap[0] == pytest.approx(whole.gap[0], rel=1e-8)
    assert along.gap[1] < 1e-12


@pytest.mark.parametrize("seed", range(10))
def test_elimination_along_the_tree_equals_the_whole_matrix(seed, monkeypatch):
    _, tree, gravity = tree_of_any_kind(seed, 2 + seed // 2)
    check_equal(*both_ways(monkeypatch, tree, gravity, SENSORS[seed % len(SENSORS)]))


def plainly_exchanged(order, made, largest):
    """Kept columns and those passed over, by exchanges in the coefficients of all columns (r, P)."""
    kept, passed = order.copy(), []
    for j in range(made.shape[1]):
        share = np.where(kept > j, abs(made[:, j]), 0)
        i = int(share.argmax())
        if j in kept or share[i] <= DEPENDENT:
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
    for seed in range(8):
        rng = np.random.default_rng(seed)
        columns = rng.normal(size=(30, 12)) @ (rng.normal(size=(12, 30)) * rng.uniform(0, 1, size=(12, 30)) ** 3)
        unit = columns / np.linalg.norm(columns, axis=0)
        triangle, order = linalg.qr(unit, mode="r", pivoting=True)
        made = np.empty((12, 30))
        made[:, order] = linalg.solve_triangular(triangle[:12, :12], triangle[:12])
        assert independent_columns.first_independent(unit, 12, 0.0) == plainly_exchanged(order[:12], made, largest)
