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


WAYS = pytest.mark.parametrize(
    ("regressor", "key", "sensors"),
    [
        (base_wrench_regressor, "base_wrench", Sensors()),
        (joint_torque_regressor, "joint_torque", Sensors(base_wrench=False, joint_torques=True)),
    ],
    ids=["base_wrench", "joint_torque"],
)


@WAYS
def test_regressors_are_equal_and_wrench_and_torques_follow(golden, regressor, key, sensors):
    states = [np.array(golden[name]) for name in ("q", "dq", "ddq")]
    Y = regressor(tree_of(golden), *states, gravity=np.array(golden["gravity"]))
    np.testing.assert_allclose(Y, golden[f"Y_{key}"], rtol=0, atol=1e-12)
    np.testing.assert_allclose(Y @ np.array(golden["phi"]), golden[key], rtol=0, atol=1e-10)


@WAYS
def test_ranks_and_regroupings_are_equal(golden, regressor, key, sensors):
    """Of the regressor at random states, and of the structure."""
    tree, expected, gravity = tree_of(golden), golden[f"grouping_{key}"], np.array(golden["gravity"])
    Y = regressor(tree, *np.random.default_rng(0).uniform(-2, 2, size=(3, 200, len(tree.moving))), gravity=gravity)
    names = golden["parameters"]
    for base in (find_base_parameters(Y, names), find_base_parameters(tree, names, gravity=gravity, sensors=sensors)):
        assert base.rank == expected["rank"] and list(base.names) == expected["kept"]
        dependent = [names[k] for k in base.dependent]
        places = [dependent.index(name) for name in expected["dependent"]]
        np.testing.assert_allclose(base.beta[:, places], expected["beta"], rtol=0, atol=1e-9)


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
