"""Section V: the geometric regressor against OpenSYMORO's, from modified DH tables (tests/data, trimmed)."""

import json
from pathlib import Path

import numpy as np
import pytest

from ident.mechanism.dh import Frame, tree_from_mdh
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor
from ident.parameters.base_parameters import find_base_parameters
from ident.parameters.structure import Sensors

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


def test_a_parallelogram_adds_three_parameters_to_an_arm():
    """SR400 by OpenSYMORO's file: of six joints as an RX90's, with a parallelogram of the links 2, 3, 7 and 8."""
    half = np.pi / 2
    geometry = {"alpha": [0, -half, 0, -half, half, -half, -half, 0], "d": [0, 4, 8, -2, 0, 0, 4, 10]}
    geometry |= {"r": [0, 0, 0, 10, 0, 0, 0, 0]}
    # Of the opposite sides that stay parallel: q3 = q7 - q2 + 90°, q8 = q2 - q7.
    loop = {3: {"follows": {"2": -1.0, "7": 1.0}, "constant": half}, 8: {"follows": {"2": 1.0, "7": -1.0}}}
    frames = [
        Frame(
            name=str(k + 1),
            parent=str(before) if before else None,
            kind="revolute",
            inertia=True,
            **{key: float(values[k]) for key, values in geometry.items()},
            **loop.get(k + 1, {}),
        )
        for k, before in enumerate((0, 1, 2, 3, 4, 5, 1, 7))
    ]
    tree = tree_from_mdh(frames)
    assert (tree.joints, tree.dependent) == (("1", "2", "4", "5", "6", "7"), ("3", "8"))
    poses = tree.poses(np.random.default_rng(0).uniform(-2, 2, (20, 6)))
    pins = ("8", [8, 0, 0, 1]), ("3", [0, -10, 0, 1])
    ends = [poses[:, tree.names.index(name)] @ pin for name, pin in pins]
    np.testing.assert_allclose(*ends, atol=1e-12)
    torques = Sensors(base_wrench=False, joint_torques=True)
    gravity = np.array([0, 0, -9.81])
    names = find_base_parameters(tree, gravity=gravity, sensors=torques).names
    rx90 = json.loads((Path(__file__).parent / "data" / "rx90.json").read_text(encoding="utf-8"))
    assert len(names) == rx90["grouping_joint_torque"]["rank"] + 3
    assert [name for name in names if name[-1] in "78"] == ["m7rx7", "m7ry7", "m8ry8"]
