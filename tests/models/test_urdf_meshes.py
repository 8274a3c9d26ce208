"""Meshes of URDF files are found in their packages, or named in a note; `world` need not be declared."""

import os

import mujoco
import numpy as np
import pytest

from ident.errors import ModelError
from sim.models.model_mechanism import mechanism
from sim.models.model_update import updated_spec, write_model
from sim.models.notes import ModelNote
from sim.models.shapes import shapes

CORNERS = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 2 3 4\nf 1 4 3\n"
INERTIAL = '<inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'


def robot(path, *, collision="", visual="", extension=""):
    """A robot of two links, the second with a mesh as its collision, its visual or both."""
    parts = (("collision", collision), ("visual", visual))
    meshes = "".join(f'<{k}><geometry><mesh filename="{name}"/></geometry></{k}>' for k, name in parts if name)
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        f'<robot name="r">{extension}<joint name="j" type="continuous"><parent link="a"/><child link="b"/></joint>'
        f'<link name="a">{INERTIAL}</link><link name="b">{INERTIAL}{meshes}</link></robot>',
        encoding="utf-8",
    )
    return path


def put(path, text=CORNERS):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, encoding="utf-8")


@pytest.fixture(autouse=True)
def no_packages_of_this_computer(monkeypatch):
    for variable in ("ROS_PACKAGE_PATH", "AMENT_PREFIX_PATH"):
        monkeypatch.delenv(variable, raising=False)


@pytest.mark.parametrize(
    "name, mesh",
    {
        "meshes/b.obj": "arm/urdf/meshes/b.obj",
        "./meshes/b.obj": "arm/urdf/meshes/b.obj",
        "package://arm/meshes/b.obj": "arm/meshes/b.obj",
        "package://hand/meshes/b.obj": "hand/meshes/b.obj",
        "model://hand/b.obj": "arm/urdf/hand/b.obj",
        "package://any/meshes/b.obj": "arm/urdf/meshes/b.obj",
        "package://any/far/b.obj": "arm/urdf/b.obj",
    }.items(),
)
def test_meshes_are_found_next_to_the_file_and_upwards(tmp_path, name, mesh):
    put(tmp_path / mesh)
    model = mechanism(robot(tmp_path / "arm/urdf/arm.urdf", collision=name)).source.model
    assert model.nmesh == 1 and model.geom_contype.tolist() == [1]


def test_meshes_are_found_in_the_packages_of_the_environment_and_of_an_option(tmp_path, monkeypatch):
    path = robot(tmp_path / "urdf/arm.urdf", collision="package://hand/meshes/b.obj")
    put(tmp_path / "far/hand/meshes/b.obj")
    put(tmp_path / "install/share/hand/meshes/b.obj")
    for variable, folder in (
        ("ROS_PACKAGE_PATH", f"nowhere{os.pathsep}{tmp_path / 'far'}"),
        ("ROS_PACKAGE_PATH", str(tmp_path / "far/hand")),
        ("AMENT_PREFIX_PATH", str(tmp_path / "install")),
    ):
        with monkeypatch.context() as here:
            here.setenv(variable, folder)
            assert mechanism(path).source.model.nmesh == 1
    for folder in (tmp_path / "far", tmp_path / "far/hand"):
        arm = mechanism(path, packages=[folder])
        assert arm.source.model.nmesh == 1 and updated_spec(arm, arm.known).compile().nmesh == 1
    put(tmp_path / "package.xml", "<package><name>hand</name></package>")
    put(tmp_path / "meshes/b.obj")
    assert mechanism(path).source.model.nmesh == 1


def test_meshes_that_cannot_be_read_are_named_with_what_is_wrong(tmp_path):
    for name, text in {"flat.obj": "v 0 0 0\n", "b.dae": "<COLLADA/>", "b.stl": "solid b\nendsolid b\n"}.items():
        put(tmp_path / name, text)
        with pytest.warns(ModelNote, match=f"A mesh is not what MuJoCo reads.*: {name}: .*; STL, OBJ and MSH"):
            assert mechanism(robot(tmp_path / "arm.urdf", collision=name)).source.model.nmesh == 0


def test_visuals_are_shown_where_there_are_no_collisions_and_missed_only_then(tmp_path):
    put(tmp_path / "b.obj")
    shown = mechanism(robot(tmp_path / "arm.urdf", visual="b.obj"))
    assert shown.source.model.geom_contype.tolist() == [0] and len(shapes(shown)) == 1
    both = mechanism(robot(tmp_path / "arm.urdf", visual="gone.dae", collision="b.obj"))
    assert both.source.model.geom_contype.tolist() == [1]
    with pytest.warns(ModelNote, match=r"A mesh is not found.*: gone\.stl;"):
        other = mechanism(robot(tmp_path / "arm.urdf", visual="b.obj", collision="gone.stl"))
    assert other.source.model.geom_contype.tolist() == [0]
    stated = '<mujoco><compiler discardvisual="true"/></mujoco>'
    assert mechanism(robot(tmp_path / "arm.urdf", visual="b.obj", extension=stated)).source.model.ngeom == 0


def test_a_written_model_has_the_meshes_that_were_found(tmp_path):
    put(tmp_path / "in/b.obj")
    arm = mechanism(robot(tmp_path / "in/arm.urdf", collision="b.obj"))
    (tmp_path / "out").mkdir()
    write_model(tmp_path / "out/arm.xml", arm, 2 * arm.known)
    assert mujoco.MjModel.from_xml_path(str(tmp_path / "out/arm.xml")).nmesh == 1
    write_model(tmp_path / "out/arm.urdf", arm, 2 * arm.known)
    assert 'filename="b.obj"' in (tmp_path / "out/arm.urdf").read_text(encoding="utf-8")


def test_joints_may_hang_on_a_world_that_is_not_declared(tmp_path):
    path = robot(tmp_path / "arm.urdf")
    text = path.read_text(encoding="utf-8")
    stand = '<joint name="w" type="{}"><origin xyz="0 0 1"/><parent link="{}"/><child link="a"/></joint></robot>'
    for kind, joints in (("fixed", ("j",)), ("continuous", ("w", "j"))):
        path.write_text(text.replace("</robot>", stand.format(kind, "world")), encoding="utf-8")
        arm = mechanism(path)
        assert arm.joints == joints and arm.tree.names == ("a", "b")
        np.testing.assert_allclose(arm.tree.bodies[0].home[:3, 3], [0, 0, 1])
        write_model(tmp_path / "new.urdf", arm, arm.known)
        assert (tmp_path / "new.urdf").read_bytes() == path.read_bytes()
    path.write_text(text.replace("</robot>", stand.format("fixed", "odom")), encoding="utf-8")
    with pytest.raises(
        ModelError, match="joint 'w' has the parent 'odom', which is no link of the file; its links are a, b"
    ):
        mechanism(path)
