"""Pinocchio's regressors, column by column, and torques of mimic joints of the same URDF file (extra `peers`)."""

import numpy as np
import pytest
from mechanisms import random_states, random_tree

import sim
from docs.tools.mechanisms import Pinocchio
from ident import BaseMotion, base_wrench_regressor, joint_torque_regressor
from ident.geometry.inertia import PINOCCHIO, parameter_transform

pin = pytest.importorskip("pinocchio", reason="Pinocchio is in the extra 'peers'")

pytestmark = pytest.mark.extras

STATES = 3


@pytest.mark.parametrize("seed", range(100))
def test_regressors_are_equal(seed):
    rng = np.random.default_rng(seed)
    kinds = ("revolute", "prismatic", "ball", "free", "welded")
    tree = random_tree(rng, int(rng.integers(2, 31)), kinds=kinds, massless=0.1)
    gravity = 3 * rng.normal(size=3)
    peer = Pinocchio(tree, gravity)
    data = peer.model.createData()
    states = random_states(rng, tree, STATES)
    base_states = rng.uniform(-2, 2, size=(STATES, 7)), *rng.uniform(-2, 2, size=(2, STATES, 6))
    base = BaseMotion.from_free_joint(*base_states)
    Y_base = base_wrench_regressor(tree, *states, gravity=gravity, base=base)
    Y_joint = joint_torque_regressor(tree, *states, gravity=gravity, base=base)
    for k, theirs in enumerate(zip(*peer.states(states, base), strict=True)):
        Y = pin.computeJointTorqueRegressor(peer.model, data, *theirs)
        for column, i in enumerate(tree.inertial):
            in_order = parameter_transform(peer.in_joint[i])[list(PINOCCHIO)]
            expected = Y[:, 10 * (peer.joint[i] - 1) : 10 * peer.joint[i]] @ in_order
            for computed, part in ((Y_base[k], expected[:6]), (Y_joint[k], expected[peer.rows])):
                own = computed[:, 10 * column : 10 * column + 10]
                np.testing.assert_allclose(own, part, rtol=0, atol=1e-10 * abs(expected).max())


def link(name, rng):
    x, y, z = rng.uniform(-0.1, 0.1, 3)
    return (
        f'<link name="{name}"><inertial><origin xyz="{x} {y} {z}" rpy="0.3 -0.2 0.5"/>'
        f'<mass value="{rng.uniform(0.2, 2)}"/>'
        '<inertia ixx="0.01" iyy="0.012" izz="0.008" ixy="0.001" ixz="-0.002" iyz="0.0005"/></inertial></link>'
    )


def joint(name, parent, child, rng, mimic="", kind="revolute"):
    place, turn, axis = (" ".join(f"{x:.12g}" for x in rng.normal(size=3)) for _ in range(3))
    unit = np.array(axis.split(), float)
    axis = " ".join(f"{x:.15g}" for x in unit / np.linalg.norm(unit))
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/><axis xyz="{axis}"/>'
        f'<origin xyz="{place}" rpy="{turn}"/><limit lower="-3" upper="3" effort="9" velocity="9"/>{mimic}</joint>'
    )


@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
@pytest.mark.parametrize("seed", range(5))
def test_torques_of_leaders_are_pinocchios(tmp_path, seed):
    rng = np.random.default_rng(seed)
    links = "".join(link(name, rng) for name in ("base", "upper", "fore", "left", "right", "tip"))
    text = (
        f'<robot name="arm">{links}{joint("lift", "base", "upper", rng)}{joint("bend", "upper", "fore", rng)}'
        + joint("left", "fore", "left", rng)
        + joint("right", "fore", "right", rng, '<mimic joint="left" multiplier="-0.7" offset="0.2"/>')
        + joint("tip", "right", "tip", rng, '<mimic joint="lift" multiplier="0.1" offset="-0.3"/>', "prismatic")
        + "</robot>"
    )
    (tmp_path / "arm.urdf").write_text(text)
    arm = sim.mechanism(tmp_path / "arm.urdf")
    arm = arm.following(arm.mimics)
    peer = pin.buildModelFromXML(text, mimic=True)
    data = peer.createData()
    assert [name for name in peer.names if name in arm.tree.joints] == list(arm.tree.joints)
    states = rng.uniform(-1, 1, (3, 4, len(arm.tree.joints)))
    torques = joint_torque_regressor(arm.tree, *states, gravity=arm.gravity) @ arm.known
    expected = np.array([pin.rnea(peer, data, *each) for each in states.swapaxes(0, 1)])
    np.testing.assert_allclose(torques, expected, atol=1e-10 * abs(expected).max())
