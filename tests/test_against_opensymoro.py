"""Section V: the geometric regressor against OpenSYMORO's, from modified DH tables (tests/data, trimmed)."""

import json
from pathlib import Path

import numpy as np
import pytest

from ident import Frame, Sensors, base_wrench_regressor, find_base_parameters, joint_torque_regressor, tree_from_mdh
from ident.geometry.inertia import parameter_transform
from ident.geometry.se3 import pose

DATA = sorted((Path(__file__).parent / "data").glob("*.json"))


PLACE = ("gamma", "b", "alpha", "d", "theta", "r")
TORQUES = Sensors(base_wrench=False, joint_torques=True)


def frame_of(row):
    parent, place = str(row["parent"] or "") or None, {name: row[name] for name in PLACE}
    return Frame(str(row["frame"]), parent, row["type"], inertia=row["has_inertia"], **place)


@pytest.mark.parametrize("path", DATA, ids=lambda path: path.stem)
@pytest.mark.parametrize(
    ("regressor", "key", "sensors"),
    [(base_wrench_regressor, "base_wrench", Sensors()), (joint_torque_regressor, "joint_torque", TORQUES)],
)
def test_regressors_ranks_and_regroupings_are_equal(path, regressor, key, sensors):
    golden = json.loads(path.read_text(encoding="utf-8"))
    tree = tree_from_mdh([frame_of(row) for row in golden["frames"]])
    expected, gravity = golden[f"grouping_{key}"], np.array(golden["gravity"])
    Y = regressor(tree, *(np.array(golden[name]) for name in ("q", "dq", "ddq")), gravity=gravity)
    np.testing.assert_allclose(Y, golden[f"Y_{key}"], rtol=0, atol=1e-12)
    np.testing.assert_allclose(Y @ np.array(golden["phi"]), golden[key], rtol=0, atol=1e-10)
    Y = regressor(tree, *np.random.default_rng(0).uniform(-2, 2, size=(3, 200, len(tree.moving))), gravity=gravity)
    names = golden["parameters"]
    for base in (find_base_parameters(Y, names), find_base_parameters(tree, names, gravity=gravity, sensors=sensors)):
        assert base.rank == expected["rank"] and list(base.names) == expected["kept"]
        dependent = [names[k] for k in base.dependent]
        places = [dependent.index(name) for name in expected["dependent"]]
        np.testing.assert_allclose(base.beta[:, places], expected["beta"], rtol=0, atol=1e-9)


@pytest.fixture(scope="module")
def sr400():
    """SR400 by OpenSYMORO's file: of six joints as an RX90's, with a parallelogram of the links 2, 3, 7 and 8."""
    half = np.pi / 2
    alpha, d = (0, -half, 0, -half, half, -half, -half, 0), (0, 4, 8, -2, 0, 0, 4, 10)
    # Of the opposite sides that stay parallel: q3 = q7 - q2 + 90°, q8 = q2 - q7.
    loop = {3: {"follows": {"2": -1.0, "7": 1.0}, "constant": half}, 8: {"follows": {"2": 1.0, "7": -1.0}}}
    frames = [Frame("1", None, "revolute", inertia=True)]
    for k, before in zip(range(2, 9), "1234517", strict=True):
        place = {"alpha": float(alpha[k - 1]), "d": float(d[k - 1]), "r": 10.0 * (k == 4)}
        frames.append(Frame(str(k), before, "revolute", inertia=True, **place, **loop.get(k, {})))
    return tree_from_mdh(frames)


def test_a_parallelogram_adds_three_parameters_to_an_arm(sr400):
    assert (sr400.joints, sr400.dependent) == (("1", "2", "4", "5", "6", "7"), ("3", "8"))
    poses = sr400.poses(np.random.default_rng(0).uniform(-2, 2, (20, 6)))
    pins = ("8", [8, 0, 0, 1]), ("3", [0, -10, 0, 1])
    ends = [poses[:, sr400.names.index(name)] @ pin for name, pin in pins]
    np.testing.assert_allclose(*ends, atol=1e-12)
    names = find_base_parameters(sr400, gravity=np.array([0, 0, -9.81]), sensors=TORQUES).names
    rx90 = json.loads((Path(__file__).parent / "data" / "rx90.json").read_text(encoding="utf-8"))
    assert len(names) == rx90["grouping_joint_torque"]["rank"] + 3
    assert [name for name in names if name[-1] in "78"] == ["m7rx7", "m7ry7", "m8ry8"]


def test_published_rules_give_all_groups_of_an_arm_with_a_parallelogram(sr400):
    """By joints (Gautier and Khalil, doi:10.1109/70.56655) and sides (Bennis, Khalil and Gautier, IEEE ICRA 1992).

    What a joint's axis does not turn counts on the body before. Opposite sides turn alike, so that all their inertias
    count on one of them; a first moment of side 8 along side 2 counts on the others.
    """
    base = find_base_parameters(sr400, gravity=np.array([0, 0, -9.81]), sensors=TORQUES)
    turns = sr400.poses(np.array([0.3, -0.2, 0.5, 1.1, 0.4, -0.9]))[:, :3, :3]
    about_axis = np.zeros((3, 10))
    about_axis[[0, 1, 2, 2], [0, 3, 4, 5]] = 1
    rules = list[dict[int, np.ndarray]]()
    for k, body in enumerate(sr400.bodies[1:], 1):
        rules += [{k: own, body.parent: -parameter_transform(body.home) @ own} for own in about_axis]
    # Of the first body, on a vertical axis, nothing but the moment of inertia about it shows.
    rules += [{0: own} for own in np.eye(10)[[0, 1, 2, 3, 4, 5, 7, 8, 9]]]
    for side, opposite in ((6, 2), (7, 1)):
        turned = parameter_transform(pose(turns[opposite].T @ turns[side], np.zeros(3)))
        rules += [{side: own, opposite: -turned @ own} for own in np.eye(10)[4:]]
    along = {7: (8, 0, 0), 1: (-8, 0, 0), 6: (10, 0, 0), 2: (0, 10, 0)}
    rules.append({k: np.r_[0, moment, np.zeros(6)] for k, moment in along.items()})
    grouped = np.zeros((len(rules), 8, 10))
    for row, rule in zip(grouped, rules, strict=True):
        row[list(rule)] = list(rule.values())
    grouped = grouped.reshape(len(rules), 80)
    np.testing.assert_allclose(base.regroup(grouped), 0, atol=1e-8)
    assert np.linalg.matrix_rank(grouped) == 80 - base.rank
