"""Joints written back where they were found to lie, in every format, with all else as it was."""

import re

import numpy as np
import pytest
from opensim_files import Joint, coordinate, document, quietly_read
from opensim_walker import PHI

import scenes
from ident.errors import ModelError
from sim.models.model_mechanism import mechanism
from sim.models.model_update import write_model

SHIFT = np.array([0.012, 0.0, -0.003])

MJCF = """<mujoco><compiler angle="degree"/><worldbody><body name="root">
<inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<frame pos="0 1 0" euler="0 90 0"><frame euler="30 0 0"><body name="arm" pos="0.3 0.1 0">
<joint name="elbow" axis="0 0 1"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>
<body name="hand"><joint name="wrist"/><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/></body>
</body></frame></frame></body></worldbody></mujoco>"""

URDF = """<robot name="r"><link name="root"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1"
iyz="0" izz="1"/></inertial></link><link name="arm"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1"
iyz="0" izz="1"/></inertial></link><link name="hand"><inertial><mass value="1"/><inertia ixx="1" ixy="0" ixz="0" iyy="1"
iyz="0" izz="1"/></inertial></link>
<joint name="elbow" type="continuous"><origin rpy="0 0.5 0"  xyz="0.30  1e-1 2" /><parent link="root"/>
<child link="arm"/></joint><joint name="wrist" type="continuous"><parent link="arm"/><child link="hand"/>
<axis xyz="0 0 1"/></joint></robot>"""


def check(arm, path, displaced, read=mechanism):
    """Writes a model and compares all homes with those of the model before."""
    write_model(path, arm, arm.known, displaced=displaced)
    for before, after in zip(arm.tree.bodies, read(path).tree.bodies, strict=True):
        home = before.home.copy()
        home[:3, 3] += displaced.get(before.name, np.zeros(3))
        np.testing.assert_allclose(after.home, home, atol=1e-12)
        np.testing.assert_array_equal(after.twist, before.twist)


def test_mjcf_bodies_in_turned_frames_or_without_a_place(tmp_path):
    (tmp_path / "a.xml").write_text(MJCF)
    arm = mechanism(tmp_path / "a.xml")
    check(arm, tmp_path / "b.xml", {"arm": SHIFT, "hand": 2 * SHIFT})
    check(mechanism(scenes.load("arm")), tmp_path / "c.xml", {"fore": SHIFT})


def test_urdf_joints_keep_every_other_byte(tmp_path):
    (tmp_path / "a.urdf").write_text(URDF)
    arm, new = mechanism(tmp_path / "a.urdf", "root"), tmp_path / "b.urdf"

    def read(path):
        return mechanism(path, "root")

    check(arm, new, {"arm": SHIFT}, read)
    expected = URDF.replace('xyz="0.30  1e-1 2"', f'xyz="{0.3 + 0.012!r}  1e-1 {2 - 0.003!r}"')
    assert new.read_text() == expected
    check(arm, new, {"hand": SHIFT}, read)
    assert re.sub(r'<origin xyz="[^"]*"/>', "", new.read_text()) == URDF


@pytest.mark.parametrize("version", [3, 4])
def test_opensim_joints_move_with_their_frames(tmp_path, version):
    turned = np.array([0.1, -0.4, 0.2])
    joints = [
        Joint("WeldJoint", "root", "ground", "pelvis"),
        Joint("PinJoint", "hip", "pelvis", "femur", [coordinate("hip")], at=(np.array([0, -0.1, 0]), turned)),
        Joint("PinJoint", "knee", "femur", "tibia", [coordinate("knee")], at=(np.array([0, -0.4, 0]), 2 * turned)),
    ]
    path, new = tmp_path / "a.osim", tmp_path / "b.osim"
    path.write_text(document(joints, PHI, version=version))
    check(quietly_read(path), new, {"femur": SHIFT, "tibia": 2 * SHIFT}, quietly_read)
    before, after = (re.sub(r"[-+.\de]+", "#", each.read_text()) for each in (path, new))
    assert before == after
    if version == 4:
        path.write_text(path.read_text().replace("<translation>", "<other>").replace("</translation>", "</other>"))
        with pytest.raises(ModelError, match="the joint that carries 'femur' has no offset frame of its own; add one"):
            write_model(new, quietly_read(path), quietly_read(path).known, displaced={"femur": SHIFT})
