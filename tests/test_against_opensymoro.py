"""Section V: the geometric regressor against OpenSYMORO's, from modified DH tables (tests/data, trimmed)."""

import json
from pathlib import Path

import numpy as np
import pytest

from ident.mechanism.dh import Frame, tree_from_mdh
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor
from ident.parameters.base_parameters import find_base_parameters

DATA = sorted((Path(__file__).parent / "data").glob("*.json"))


@pytest.fixture(scope="module", params=DATA, ids=lambda path: path.stem)
def golden(request):
    return json.loads(request.param.read_text(encoding="utf-8"))


def tree_of(golden):
    return tree_from_mdh(
        [
            Frame(
                name=str(row["frame"]),
                parent=str(row["parent"]) if row["parent"] else None,
                kind=row["type"],
                inertia=row["has_inertia"],
                **{key: row[key] for key in ("gamma", "b", "alpha", "d", "theta", "r")},
            )
            for row in golden["frames"]
        ]
    )


@pytest.mark.parametrize(
    ("regressor", "key"),
    [(base_wrench_regressor, "Y_base_wrench"), (joint_torque_regressor, "Y_joint_torque")],
)
def test_regressors_are_equal(golden, regressor, key):
    states = [np.array(golden[name]) for name in ("q", "dq", "ddq")]
    Y = regressor(tree_of(golden), *states, gravity=np.array(golden["gravity"]))
    np.testing.assert_allclose(Y, golden[key], rtol=0, atol=1e-12)


def test_wrench_and_torques_follow(golden):
    states = [np.array(golden[name]) for name in ("q", "dq", "ddq")]
    phi = np.array(golden["phi"])
    for regressor, key in ((base_wrench_regressor, "base_wrench"), (joint_torque_regressor, "joint_torque")):
        Y = regressor(tree_of(golden), *states, gravity=np.array(golden["gravity"]))
        np.testing.assert_allclose(Y @ phi, golden[key], rtol=0, atol=1e-10)


@pytest.mark.parametrize(
    ("regressor", "key"),
    [(base_wrench_regressor, "grouping_base_wrench"), (joint_torque_regressor, "grouping_joint_torque")],
)
def test_ranks_and_regroupings_are_equal(golden, regressor, key):
    tree, expected = tree_of(golden), golden[key]
    states = np.random.default_rng(0).uniform(-2, 2, size=(3, 200, len(tree.moving)))
    Y = regressor(tree, *states, gravity=np.array(golden["gravity"]))
    base = find_base_parameters(Y, golden["parameters"])
    assert base.rank == expected["rank"]
    assert list(base.names) == expected["kept"]
    dependent = [golden["parameters"][k] for k in base.dependent]
    beta = {
        (kept, gone): value
        for kept, row in zip(base.names, base.beta, strict=True)
        for gone, value in zip(dependent, row, strict=True)
    }
    for kept, row in zip(expected["kept"], expected["beta"], strict=True):
        for gone, value in zip(expected["dependent"], row, strict=True):
            assert abs(beta[kept, gone] - value) < 1e-9, (kept, gone)
