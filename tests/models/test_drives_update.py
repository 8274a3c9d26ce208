"""Drives that are written into models, and what the written models predict."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import driven_arm
import mujoco
import numpy as np

import sim
from ident.mechanism.drives import Drive
from sim.models.model_update import write_model

CLASSES = driven_arm.text(**{key: (2.0, 2.0, 2.0) for key in ("damping", "frictionloss", "armature")}).replace(
    "<worldbody>", '<default><joint damping="9" armature="1" stiffness="5"/></default><worldbody>'
)

URDF = """<?xml version="1.0"?>
<robot name="arm">
  <link name="base"/>
  <joint name="turn" type="revolute"><!-- geared -->
    <parent link="base"/><child link="one"/><axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="9" velocity="9"/>
    <dynamics friction="0.5"   damping="1.0"/>
  </joint>
  <link name="one"><inertial><mass value="1"/><origin xyz="0.1 0 0"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="bend" type="revolute">
    <parent link="one"/><child link="two"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="9" velocity="9"/>
  </joint>
  <link name="two"><inertial><mass value="1"/><origin xyz="0.1 0 0"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
</robot>
"""

NEW = {"turn": Drive(1.25, 0.75, 0.5), "bend": Drive(0.125, 0.0625, 0.03125, 3.0)}


def test_numbers_are_set_on_the_joint_whatever_its_class_has(tmp_path):
    (tmp_path / "arm.xml").write_text(CLASSES, encoding="utf-8")
    arm = sim.mechanism(tmp_path / "arm.xml")
    write_model(tmp_path / "new.xml", arm, arm.known, NEW)
    written = sim.mechanism(tmp_path / "new.xml")
    assert written.drives["turn"] == NEW["turn"]
    assert written.drives["bend"] == replace(NEW["bend"], springref=written.drives["bend"].springref)
    assert written.drives["lift"] == arm.drives["lift"]
    np.testing.assert_allclose(written.known, arm.known, rtol=1e-12, atol=1e-15)
    joints = {joint.get("name"): joint for joint in ET.parse(tmp_path / "new.xml").iter("joint") if joint.get("name")}
    assert joints["turn"].get("damping") == "1.25" and joints["bend"].get("stiffness") == "3.0"
    # What does not change is not stated anew.
    assert joints["turn"].get("stiffness") == "0.0" and joints["lift"].get("damping") == "2.0"


SERVOS = """<mujoco><default><default class="stiff"><position kp="7" dampratio="1"/></default>
  <default class="own"><general gainprm="9" biasprm="0 -9 -1"/></default></default>
  <worldbody><body><joint name="a"/><geom size="1"/><body><joint name="b" axis="0 1 0"/><geom size="1"/></body>
  <body><joint name="c" axis="0 1 0"/><geom size="1"/></body></body></worldbody>
  <actuator><motor name="free" joint="a"/><position name="pa" class="stiff" joint="a"/></actuator>
  <actuator><general name="pb" class="own" joint="b" biastype="affine"/></actuator>
  <actuator><position name="pc" joint="c" kp="3" kv="0.5"/></actuator>
  </mujoco>"""


def test_gains_of_position_actuators_are_set_whatever_their_classes_have(tmp_path):
    (tmp_path / "arm.xml").write_text(SERVOS, encoding="utf-8")
    arm = sim.mechanism(tmp_path / "arm.xml")
    new = {"a": arm.drives["a"].with_servo(20.0, 1.5), "b": arm.drives["b"].with_servo(30.0, 2.5)}
    assert new["a"] != arm.drives["a"] and new["b"] != arm.drives["b"]
    write_model(tmp_path / "new.xml", arm, arm.known, new | {"c": arm.drives["c"]})
    written = sim.mechanism(tmp_path / "new.xml")
    gains = {each.name: (each.kp, each.kv, each.kind) for own in written.drives.values() for each in own.actuators}
    assert gains == {
        "free": (0, 0, "motor"),
        "pa": (20.0, 1.5, "position"),
        "pb": (30.0, 2.5, "position"),
        "pc": (3.0, 0.5, "position"),
    }
    model = mujoco.MjModel.from_xml_path(str(tmp_path / "new.xml"))
    data = mujoco.MjData(model)
    data.qpos[:], data.qvel[:], data.ctrl[:] = 0.1, 0.2, 0.3
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(data.qfrc_actuator[:2], [0.3 + 20 * 0.2 - 1.5 * 0.2, 30 * 0.2 - 2.5 * 0.2], rtol=1e-12)
    same = {"c": arm.drives["c"].with_servo(3.0, 0.5)}
    assert same == {"c": arm.drives["c"]} and Drive().with_servo(1.0, 1.0) == Drive()


def test_of_urdf_only_the_numbers_of_dynamics_change(tmp_path):
    (tmp_path / "arm.urdf").write_text(URDF, encoding="utf-8")
    arm = sim.mechanism(tmp_path / "arm.urdf")
    write_model(tmp_path / "new.urdf", arm, arm.known, NEW)
    expected = URDF.replace('friction="0.5"   damping="1.0"', 'friction="0.75"   damping="1.25"')
    expected = expected.replace(
        '<joint name="bend" type="revolute">\n    ',
        '<joint name="bend" type="revolute">\n    <dynamics damping="0.125" friction="0.0625"/>\n    ',
    )
    assert (tmp_path / "new.urdf").read_text(encoding="utf-8") == expected
    write_model(tmp_path / "same.urdf", arm, arm.known, arm.drives)
    assert (tmp_path / "same.urdf").read_text(encoding="utf-8") == URDF
