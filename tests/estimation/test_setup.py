import numpy as np
from scipy.spatial.transform import Rotation

from ident.estimation.equations import COMPONENTS, Equations
from ident.estimation.setup_parameters import setup_parameters
from ident.geometry.se3 import pose
from ident.mechanism.body import BASE, Body, ball_twist
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.parameters.base_parameters import find_base_parameters


def test_joints_are_displaced_as_a_whole_where_something_shows_it():
    """Torques do not show a shift along the axis of all joints before; nothing shows one of the first joint of all."""
    R = Rotation.from_euler("y", 90, degrees=True).as_matrix()
    hinge, z = [0, 0, 0, 0, 0, 1], np.array([0, 0, 0, 1, 0, 0])
    tree = Tree(
        (
            Body("thigh", BASE, np.eye(4), hinge, "hip"),
            Body("shank", 0, pose(R, np.array([0, 0, -0.4])), hinge, "knee"),
            Body("link", 1, pose(np.eye(3), np.array([0.3, 0, 0])), hinge, "ankle", massless=True),
            Body("foot", 2, np.eye(4), z, "subtalar"),
            Body("toes", 3, np.eye(4), np.zeros(6)),
            Body("ball", 3, pose(np.eye(3), np.array([0.1, 0.1, 0])), ball_twist(np.zeros(3)), "ball"),
        )
    )
    mechanism = Mechanism(tree, np.array([0, 0, -9.81]), np.zeros(50), centre_std=0.01)
    equations = Equations(mechanism, find_base_parameters(mechanism), channels=COMPONENTS)

    def own(moving=False, **priors):
        each = setup_parameters(equations, [], priors, moving=moving)
        return {x.name: (x.std, x.link) for x in each if x.kind == "centre"}

    expected = {f"centre_{axis}({joint})": "" for joint in ("knee", "ankle", "ball") for axis in "xyz"}
    expected |= {"centre_z(knee)": "-hip", "centre_x(ankle)": "knee"}
    assert own() == own(moving=True) == {name: (0.01, link) for name, link in expected.items()}
    stated = own(**{"centre": 0.002, "centre(knee)": 0.03, "centre(ball)": 0})
    assert stated == {
        name: (0.03 if "knee" in name else 0.002, link) for name, link in expected.items() if "ball" not in name
    }
    equations = Equations(mechanism, find_base_parameters(mechanism), torques=(0,), channels=("torque(hip)",))
    assert {*expected} - {*own()} == {"centre_z(knee)"}
    assert {*expected} == {*own(moving=True)}
