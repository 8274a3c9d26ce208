"""A four-bar on a turntable against its published dynamic model and parameter vector, in modified DH parameters.

SchapplM/robsynth-serhybroblib, `systems/fourbar1turn`, robot fourbar1turnTE: `inertiaJ_slag_vp2` and
`gravloadJ_floatb_twist_slag_vp2` of commit 31a2f0a3, evaluated, and `convert_par2_MPV_fixb` of 7605dcd8: symbolic code
from explicit kinematics.
"""

import numpy as np
import pytest

from ident import Frame, Sensors, find_base_parameters, joint_torque_regressor, tree_from_mdh
from ident.mechanism.loops import Coincidence, Constraints

GROUND, CRANK, ROD, ROCKER, HEIGHT = 0.5, 0.2, 0.45, 0.4, 0.3
GRAVITY = np.array([3, -4, -9.81])
PHI = np.array(
    [
        [1.1, 1.9, 0.4, 1.9, 0.7, 0.9, 1.7, 0.9, 1.1, 0.2],
        [1.5, 1.1, 0.7, 1.6, 0.7, 1.0, 0.4, 0.9, 0.5, 0.6],
        [1.5, 0.6, 1.0, 2.0, 1.9, 1.5, 1.1, 0.6, 0.4, 1.9],
        [1.1, 0.3, 1.3, 1.6, 1.3, 1.8, 0.2, 1.1, 1.0, 0.2],
    ]
)

# By the published code: joint angles, dependent ones, inertia matrix (11, 12, 22), torques at rest.
PUBLISHED = [
    ((0.3, 0.7), (-0.053804050008742395, 1.5401927398418913),
     (6.034305288660448, -0.1883402373784562, 0.5476609775629698), (-0.2842597725846101, 7.767664737513969)),
    ((-1.1, 2.0), (-1.5888001585756955, 2.011804380350864),
     (3.272985933663234, 0.24085278844229743, 0.5079821132388603), (-23.709546199021112, -14.256594922102222)),
    ((2.0, -1.5), (2.7215090678383116, 2.549231453686958),
     (4.4184441713204246, 0.23051721674253633, 0.47412206887407343), (25.086699873427182, 11.279317494720829)),
]  # fmt: skip

# The published parameter vector: factors of m, m r (x, y, z), I (xx, yy, zz, xy, xz, yz) of links 1 to 4.
VECTOR = [
    {"1zz": 1, "4m": GROUND**2, "2yy": 1, "3m": CRANK**2}, {"4m": GROUND, "1x": 1},
    {"1y": 1, "2z": -1, "3z": -1, "4z": -1}, {"2xx": 1, "2yy": -1, "3m": -(CRANK**2)}, {"2xy": 1},
    {"3z": -CRANK, "2xz": 1}, {"2yz": 1}, {"2zz": 1, "3m": CRANK**2}, {"3m": CRANK, "2x": 1}, {"2y": 1},
    {"3xx": 1, "4yy": 1}, {"3xy": 1}, {"3xz": 1}, {"3yy": 1, "4yy": 1}, {"3yz": 1}, {"3zz": 1}, {"3x": 1}, {"3y": 1},
    {"4xx": 1, "4yy": -1}, {"4xy": 1}, {"4xz": 1}, {"4yz": 1}, {"4zz": 1}, {"4x": 1}, {"4y": 1},
]  # fmt: skip


@pytest.fixture(scope="module")
def tree():
    along = [np.eye(4) + length * np.eye(4)[:, :1] * np.eye(4)[3] for length in (ROD, ROCKER)]
    opened = tree_from_mdh(
        [
            Frame("1", None, "revolute", r=HEIGHT),
            Frame("2", "1", "revolute", alpha=np.pi / 2),
            Frame("3", "2", "revolute", d=CRANK),
            Frame("4", "1", "revolute", alpha=np.pi / 2, d=GROUND),
        ]
    )
    pin = Coincidence("pin", ("3", "4"), (tuple(along[0].ravel()), tuple(along[1].ravel())))
    posture = {joint: np.array([q]) for joint, q in zip("1234", (*PUBLISHED[0][0], *PUBLISHED[0][1]), strict=True)}
    return Constraints((pin,), posture).closed(opened, ("3", "4"))


@pytest.mark.parametrize(("q", "dependent", "inertia", "weight"), PUBLISHED)
def test_a_published_model_of_a_loop_is_equal(tree, q, dependent, inertia, weight):
    q, still = np.array([q]), np.zeros((1, 2))
    turned = tree.dependent_states(q)[0][0] - dependent
    np.testing.assert_allclose(np.exp(1j * turned), 1, atol=1e-10)
    rows = (joint_torque_regressor(tree, q, still, unit[None], gravity=np.zeros(3))[0] for unit in np.eye(2))
    columns = [row @ PHI.ravel() for row in rows]
    np.testing.assert_allclose(np.array(columns)[np.triu_indices(2)], inertia, atol=1e-10)
    torques = joint_torque_regressor(tree, q, still, still, gravity=GRAVITY)[0] @ PHI.ravel()
    np.testing.assert_allclose(torques, weight, atol=1e-10)


@pytest.mark.parametrize(("gravity", "rank"), [((0, 0, -9.81), 19), (GRAVITY, 21)], ids=["along the axis", "general"])
def test_base_parameters_are_combinations_of_the_published_ones(tree, gravity, rank):
    """Of the 25 published ones the loop groups six more; the rank is that of the published inertia and weight."""
    sensors = Sensors(base_wrench=False, joint_torques=True)
    base = find_base_parameters(tree, gravity=np.array(gravity), sensors=sensors)
    keys = ["m", "x", "y", "z", "xx", "yy", "zz", "xy", "xz", "yz"]
    published = np.array([[row.get(f"{k}{key}", 0.0) for k in range(1, 5) for key in keys] for row in VECTOR])
    ours = np.array([base.regroup(unit) for unit in np.eye(40)]).T
    assert base.rank == np.linalg.matrix_rank(ours, tol=1e-8) == rank
    assert np.linalg.matrix_rank(np.vstack([published, ours]), tol=1e-8) == len(VECTOR)
