"""Meshes in packages and joints that mimic others in URDF files, and xacro files that describe these."""

import os
import re
import sys

import mujoco
import numpy as np
import pytest
from commands import sentence_of

from ident.estimation.equations import stated_drive_torques
from ident.mechanism.body import Follower
from ident.mechanism.loops import Relation
from ident.mechanism.motion import Motion
from ident.model.regressor import joint_torque_regressor
from sim.models.model_mechanism import mechanism, shapes
from sim.models.model_update import updated_spec, write_model
from sim.models.notes import ModelNote

CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'


@pytest.fixture
def robot(written):
    """Writes a robot of two links, the second with a mesh as its collision, its visual or both."""

    def write(name="arm.urdf", *, extension="", joints="", **meshes):
        shown = [f'<{kind}><geometry><mesh filename="{x}"/></geometry></{kind}>' for kind, x in meshes.items()]
        joints += '<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint>'
        links = f'<link name="a">{INERTIAL}</link><link name="b">{INERTIAL}{"".join(shown)}</link>'
        return written(name, f'<robot name="r">{extension}{joints}{links}</robot>')

    return write


@pytest.fixture(autouse=True)
def no_packages_of_this_computer(monkeypatch):
    for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(variable, raising=False)


@pytest.mark.parametrize(
    ("name", "mesh"),
    [
        ("./meshes/b.obj", "arm/urdf/meshes/b.obj"),
        ("package://arm/meshes/b.obj", "arm/meshes/b.obj"),
        ("model://hand/b.obj", "arm/urdf/hand/b.obj"),
        ("package://any/meshes/b.obj", "arm/urdf/meshes/b.obj"),
        ("package://any/far/b.obj", "arm/urdf/b.obj"),
    ],
)
def test_meshes_are_found_next_to_the_file_and_upwards(written, robot, name, mesh):
    written(mesh, CORNERS)
    model = mechanism(robot("arm/urdf/arm.urdf", collision=name)).source.model
    assert model.nmesh == 1 and model.geom_contype.tolist() == [1]


def test_meshes_are_found_in_the_packages_of_the_environment_and_of_an_option(written, robot, tmp_path, monkeypatch):
    path = robot("urdf/arm.urdf", collision="package://hand/meshes/b.obj")
    far = written("far/hand/meshes/b.obj", CORNERS).parents[2]
    written("install/share/hand/meshes/b.obj", CORNERS)
    for variable, folder in (
        ("ROS_PACKAGE_PATH", f"nowhere{os.pathsep}{far}"),
        ("ROS_PACKAGE_PATH", str(far / "hand")),
        ("AMENT_PREFIX_PATH", str(tmp_path / "install")),
    ):
        with monkeypatch.context() as here:
            here.setenv(variable, folder)
            assert mechanism(path).source.model.nmesh == 1
    for folder in (far, far / "hand"):
        arm = mechanism(path, packages=[folder])
        assert arm.source.model.nmesh == 1 and updated_spec(arm, arm.known).compile().nmesh == 1
    written("package.xml", "<package><name>hand</name></package>")
    written("meshes/b.obj", CORNERS)
    assert mechanism(path).source.model.nmesh == 1


def test_meshes_that_cannot_be_read_are_named_with_what_is_wrong(written, robot):
    for name, text in {"flat.obj": "v 0 0 0\n", "b.dae": "<COLLADA/>", "b.stl": "solid b\nendsolid b\n"}.items():
        written(name, text)
        with pytest.warns(ModelNote, match=f"A mesh is not what MuJoCo reads.*: {name}: .*; STL, OBJ and MSH"):
            assert mechanism(robot(collision=name)).source.model.nmesh == 0


def test_visuals_are_shown_where_there_are_no_collisions_and_missed_only_then(written, robot):
    written("b.obj", CORNERS)
    shown = mechanism(robot(visual="b.obj"))
    assert shown.source.model.geom_contype.tolist() == [0] and len(shapes(shown)) == 1
    assert mechanism(robot(visual="gone.dae", collision="b.obj")).source.model.geom_contype.tolist() == [1]
    with pytest.warns(ModelNote, match=r"A mesh is not found.*: gone\.stl;"):
        other = mechanism(robot(visual="b.obj", collision="gone.stl"))
    assert other.source.model.geom_contype.tolist() == [0]
    stated = '<mujoco><compiler discardvisual="true"/></mujoco>'
    assert mechanism(robot(visual="b.obj", extension=stated)).source.model.ngeom == 0


def test_a_written_model_has_the_meshes_that_were_found(written, robot, tmp_path):
    written("in/b.obj", CORNERS)
    arm = mechanism(robot("in/arm.urdf", collision="b.obj"))
    (tmp_path / "out").mkdir()
    write_model(tmp_path / "out/arm.xml", arm, 2 * arm.known)
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "out/arm.xml")).nmesh == 1
    write_model(tmp_path / "out/arm.urdf", arm, 2 * arm.known)
    assert 'filename="b.obj"' in (tmp_path / "out/arm.urdf").read_text(encoding="utf-8")


def test_joints_may_hang_on_a_world_that_is_not_declared(robot):
    stand = '<joint name="w" type="{}"><origin xyz="0 0 1"/><parent link="{}"/><child link="a"/></joint>'
    for kind, joints in (("fixed", ("j",)), ("continuous", ("w", "j"))):
        path = robot(joints=stand.format(kind, "world"))
        arm = mechanism(path)
        assert set(arm.joints) == set(joints) and arm.tree.names == ("a", "b")
        np.testing.assert_allclose(arm.tree.bodies[0].home[:3, 3], [0, 0, 1])
        write_model(path.with_name("new.urdf"), arm, arm.known)
        assert path.with_name("new.urdf").read_bytes() == path.read_bytes()
    message = "joint 'w' has the parent 'odom', which is no link of the file; its links"
    assert message in sentence_of(mechanism, robot(joints=stand.format("fixed", "odom")))


INERTIA = '<inertia ixx="1e-4" iyy="2e-4" izz="2e-4" ixy="0" ixz="0" iyz="0"/>'


def joint(name, mimic="", kind="revolute"):
    return (
        f'<link name="of_{name}"><inertial><origin xyz=".03 0 .01"/><mass value=".1"/>{INERTIA}</inertial></link>'
        f'<joint name="{name}" type="{kind}"><parent link="base"/><child link="of_{name}"/><axis xyz="0 0 1"/>'
        f'<limit lower="-1" upper="1" effort="5" velocity="5"/>{mimic}</joint>'
    )


@pytest.fixture
def read(written):
    link = f'<link name="base"><inertial><mass value="1"/>{INERTIA}</inertial></link>'
    return lambda *joints: mechanism(written("hand.urdf", f'<robot name="hand">{link}{"".join(joints)}</robot>'))


RIGHT = joint("right", '<mimic joint="left" multiplier="-1.5" offset="0.1"/>')


@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
def test_a_mimic_that_stands_before_its_leader_follows_it(read):
    arm = read(RIGHT, joint("left"), joint("slide", '<mimic joint="left"/>', "prismatic"))
    assert arm.mimics == {"right": Follower("left", (0.1, -1.5)), "slide": Follower("left", (0.0, 1.0))}
    row = Relation("mimic_right", (("of_right", 1.0),), (("of_left", 1.0),), (0.1, -1.5))
    assert arm.constraints.rows[0] == row
    assert "joints: left\n  dependent: right, slide" in str(arm)


@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
def test_wrong_mimics_are_one_sentence(read):
    for joints, message in (
        (
            (joint("left"), RIGHT, joint("tip", '<mimic joint="right" multiplier="2" offset="1"/>')),
            'out of left, not \'right\'; write <mimic joint="left" multiplier="-3" offset="1.2"/> instead',
        ),
        ((joint("left", '<mimic joint="right"/>'), RIGHT), "joint 'left' has to mimic one .* of none, not 'right'"),
        ((joint("left", "<mimic/>"), joint("tip")), "has to mimic one .* of tip, not ''"),
        ((joint("left", kind="fixed"), RIGHT), "'right' has to mimic one .* of none, not 'left'"),
        ((joint("a"), joint("b"), joint("c", '<mimic joint="a"/><mimic joint="b"/>')), "joint 'c' has to mimic one"),
        ((joint("left"), joint("right", '<mimic joint="left" multiplier="x"/>')), "the mimic of joint 'right' needs a"),
        ((joint("left"), joint("right", '<mimic joint="left" offset="inf"/>')), "the mimic of joint 'right' needs a"),
    ):
        assert re.search(message, sentence_of(read, *joints))


def test_a_mimic_of_a_joint_that_the_file_lacks_moves_by_itself(read):
    """As in models whose hands were renamed, but not what their joints mimic."""
    with pytest.warns(ModelNote, match=r"has no joint of the name .* move by themselves: 'left' \('nail'\)"):
        arm = read(joint("left", '<mimic joint="nail"/>'))
    assert not arm.mimics and arm.joints == ("left",)


@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
def test_friction_and_rotor_of_a_mimic_act_on_its_leader(read):
    """Against the torque by virtual work: a joint that turns -1.5 times as fast, with viscous friction of 0.2."""
    damped = RIGHT.replace("<mimic", '<dynamics damping="0.2" friction="0.03"/><mimic')
    arms = [read(each, joint("left")) for each in (damped, RIGHT)]
    assert not arms[0].mimics and arms[1].mimics
    arms = [arm.following(arm.mimics).closed(["right"]) for arm in arms]
    assert {arm.tree.joints for arm in arms} == {("left",)}
    states = np.array([[0.2]]), np.array([[1.2]]), np.array([[-0.7]])
    links = [joint_torque_regressor(arm.tree, *states, gravity=arm.gravity) @ arm.known for arm in arms]
    np.testing.assert_allclose(*links, atol=1e-14)
    np.testing.assert_allclose(stated_drive_torques(arms[0], Motion(*states)), [[1.5**2 * 0.2 * 1.2 + 1.5 * 0.03]])


LINK = f'<link name="{{}}">{INERTIAL}</link>'.replace('value="1"', 'value="{}"')
JOINT = '<joint name="j" type="continuous"><parent link="base"/><child link="l1"/></joint></robot>'
HEAD = '<robot name="arm" xmlns:xacro="http://www.ros.org/wiki/xacro">'
PARTS = f'{HEAD}<xacro:macro name="part" params="name m">{LINK.format("${name}", "${m}")}</xacro:macro></robot>'
XACRO = (
    f'{HEAD}<xacro:arg name="mass" default="2"/><xacro:include filename="parts.xacro"/>'
    f'<xacro:part name="base" m="1"/><xacro:part name="l1" m="$(arg mass)"/>{JOINT}'
)
URDF = HEAD + LINK.format("base", 1) + LINK.format("l1", 2) + JOINT


@pytest.fixture
def files(tmp_path):
    for name, text in (("parts.xacro", PARTS), ("arm.urdf.xacro", XACRO), ("arm.urdf", URDF), ("named.urdf", XACRO)):
        (tmp_path / name).write_text(text, encoding="utf-8")
    return tmp_path


@pytest.mark.extras
@pytest.mark.parametrize("name", ["arm.urdf.xacro", "named.urdf"])
def test_a_xacro_file_is_the_urdf_file_that_it_describes(files, name):
    pytest.importorskip("xacrodoc", reason="xacrodoc is in the extra 'xacro'")
    arm, plain = mechanism(files / name, "base"), mechanism(files / "arm.urdf", "base")
    assert arm.tree.joints == plain.tree.joints == ("j",)
    assert arm.tree == plain.tree
    np.testing.assert_array_equal(arm.known, plain.known)
    write_model(files / "new.urdf", arm, 2 * arm.known)
    np.testing.assert_allclose(mechanism(files / "new.urdf", "base").known, 2 * plain.known, rtol=1e-12)


@pytest.mark.extras
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("xacro:part name", "xacro:nope name", "unknown macro name: xacro:nope"),
        ("parts.xacro", "absent.xacro", "absent.xacro"),
        ("$(arg mass)", "${mass}", "'mass' is not defined"),
        ('<xacro:arg name="mass" default="2"/>', "", "substitution argument mass"),
        ("$(arg mass)", "${__import__('os').getcwd()}", "invalid name"),
    ],
)
def test_what_cannot_be_expanded_is_one_sentence_with_a_cure(files, old, new, message):
    pytest.importorskip("xacrodoc", reason="xacrodoc is in the extra 'xacro'")
    (files / "arm.urdf.xacro").write_text(XACRO.replace(old, new), encoding="utf-8")
    sentence = sentence_of(mechanism, files / "arm.urdf.xacro", "base")
    assert message in sentence and "no xacro file that can be expanded (" in sentence
    assert sentence.endswith("write the URDF file yourself: xacro arm.urdf.xacro [ARG:=VALUE] > arm_expanded.urdf.")


@pytest.mark.extras
def test_without_the_package_the_sentence_names_the_extra(files, monkeypatch):
    monkeypatch.setitem(sys.modules, "xacrodoc", None)
    for name in ("arm.urdf.xacro", "named.urdf"):
        own = f'-e ".[xacro]"; or write the URDF file yourself: xacro {name} '
        assert own in sentence_of(mechanism, files / name)
    assert mechanism(files / "arm.urdf", "base").tree.joints == ("j",)
