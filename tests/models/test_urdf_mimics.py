"""Mimic joints of URDF files, read as they stand in the file by every release of MuJoCo."""

import numpy as np
import pytest

import sim
from ident.errors import ModelError
from ident.estimation.loads import stated_drive_torques
from ident.mechanism.body import Follower
from ident.mechanism.constraint import Relation
from ident.mechanism.motion import Motion
from ident.model.regressor import joint_torque_regressor
from sim.models.model_update import write_model
from sim.models.notes import ModelNote

pytestmark = pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")

INERTIA = '<inertia ixx="1e-4" iyy="2e-4" izz="2e-4" ixy="0" ixz="0" iyz="0"/>'


def joint(name, mimic="", kind="revolute"):
    """A link on the base, and its joint."""
    return (
        f'<link name="of_{name}"><inertial><origin xyz=".03 0 .01"/><mass value=".1"/>{INERTIA}</inertial></link>'
        f'<joint name="{name}" type="{kind}"><parent link="base"/><child link="of_{name}"/><axis xyz="0 0 1"/>'
        f'<limit lower="-1" upper="1" effort="5" velocity="5"/>{mimic}</joint>'
    )


def read(folder, *joints):
    """The mechanism of a file with joints."""
    path = folder / "hand.urdf"
    link = f'<link name="base"><inertial><mass value="1"/>{INERTIA}</inertial></link>'
    path.write_text(f'<robot name="hand">{link}{"".join(joints)}</robot>')
    return sim.mechanism(path)


RIGHT = joint("right", '<mimic joint="left" multiplier="-1.5" offset="0.1"/>')


def test_a_mimic_that_stands_before_its_leader_follows_it(tmp_path):
    arm = read(tmp_path, RIGHT, joint("left"), joint("slide", '<mimic joint="left"/>', "prismatic"))
    assert arm.mimics == {"right": Follower("left", (0.1, -1.5)), "slide": Follower("left", (0.0, 1.0))}
    row = Relation("mimic_right", (("of_right", 1.0),), (("of_left", 1.0),), (0.1, -1.5))
    assert arm.constraints.rows[0] == row
    assert "joints: left\n  dependent: right, slide" in str(arm)


def test_a_mimic_is_written_back_as_it_was(tmp_path):
    arm = read(tmp_path, RIGHT, joint("left"))
    write_model(tmp_path / "new.urdf", arm, 1.1 * arm.known)
    element = '<mimic joint="left" multiplier="-1.5" offset="0.1"/>'
    assert element in (tmp_path / "new.urdf").read_text()


@pytest.mark.parametrize(
    ("joints", "message"),
    [
        (
            (joint("left"), RIGHT, joint("tip", '<mimic joint="right" multiplier="2" offset="1"/>')),
            "joint 'tip' mimics 'right', which mimics another joint itself; write <mimic joint=\"left\" "
            r'multiplier="-3" offset="1\.2"/>\.$',
        ),
        (
            (joint("left", '<mimic joint="right"/>'), RIGHT),
            "joint 'left' mimics 'right', which follows from 'left' in turn; leave one <mimic> out",
        ),
        ((joint("left", '<mimic joint="left"/>'), joint("tip")), "'left' has to mimic one other .* of tip, not 'left'"),
        ((joint("left", "<mimic/>"), joint("tip")), "has to mimic one other joint out of tip, not ''"),
        ((joint("left", kind="fixed"), RIGHT), "'right' has to mimic one other joint out of none, not 'left'"),
        (
            (joint("a"), joint("b"), joint("c", '<mimic joint="a"/><mimic joint="b"/>')),
            "joint 'c' has to mimic one other joint out of a, b, not 'a' and 'b'",
        ),
        (
            (joint("left"), joint("right", '<mimic joint="left" multiplier="x"/>')),
            "the mimic of joint 'right' needs a finite multiplier, got 'x'",
        ),
        (
            (joint("left"), joint("right", '<mimic joint="left" offset="inf"/>')),
            "the mimic of joint 'right' needs a finite offset, got 'inf'",
        ),
    ],
    ids=["chain", "ring", "itself", "nameless", "fixed", "two", "multiplier", "offset"],
)
def test_wrong_mimics_are_one_sentence(tmp_path, joints, message):
    with pytest.raises(ModelError, match=message):
        read(tmp_path, *joints)


@pytest.mark.filterwarnings("default::sim.models.notes.ModelNote")
def test_a_mimic_of_a_joint_that_the_file_lacks_moves_by_itself(tmp_path):
    """As in models whose hands were renamed, but not what their joints mimic."""
    with pytest.warns(ModelNote, match=r"has no joint of the name .* move by themselves: 'left' \('nail'\)"):
        arm = read(tmp_path, joint("left", '<mimic joint="nail"/>'))
    assert not arm.mimics and arm.joints == ("left",)


def test_friction_and_rotor_of_a_mimic_act_on_its_leader(tmp_path):
    """Against the torque by virtual work: a joint that turns -1.5 times as fast, with viscous friction of 0.2."""
    damped = RIGHT.replace("<mimic", '<dynamics damping="0.2" friction="0.03"/><mimic')
    arms = [read(tmp_path, each, joint("left")) for each in (damped, RIGHT)]
    assert not arms[0].mimics and arms[1].mimics
    arms = [arm.following(arm.mimics).closed(["right"]) for arm in arms]
    assert {arm.tree.joints for arm in arms} == {("left",)}
    states = np.array([[0.2]]), np.array([[1.2]]), np.array([[-0.7]])
    links = [joint_torque_regressor(arm.tree, *states, gravity=arm.gravity) @ arm.known for arm in arms]
    np.testing.assert_allclose(*links, atol=1e-14)
    np.testing.assert_allclose(stated_drive_torques(arms[0], Motion(*states)), [[1.5**2 * 0.2 * 1.2 + 1.5 * 0.03]])
