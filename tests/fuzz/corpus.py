"""Files that are right, to be damaged."""

from pathlib import Path

import scenes
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.simulate import simulate

URDF = """<?xml version="1.0" encoding="utf-8"?>
<robot name="arm">
  <link name="base"><inertial><mass value="4"/>
    <inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="link1"><inertial><origin xyz="0 0 0.2" rpy="0.1 0 0"/><mass value="3.7"/>
    <inertia ixx="0.01" iyy="0.01" izz="0.006" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <link name="link2"><inertial><origin xyz="0.1 0 0.2"/><mass value="13"/>
    <inertia ixx="0.4" iyy="0.4" izz="0.05" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="joint1" type="revolute"><parent link="base"/><child link="link1"/><axis xyz="1 0 0"/>
    <limit lower="-3" upper="3" effort="9" velocity="9"/></joint>
  <joint name="joint2" type="revolute"><parent link="link1"/><child link="link2"/><origin xyz="0 0 0.425"/>
    <axis xyz="1 0 0"/><limit lower="-3" upper="3" effort="9" velocity="9"/></joint>
</robot>
"""

GROUND = """time = "time"
[joints.joint1]
position = { column = "joint1_position", unit = "rad" }
[joints.joint2]
position = "joint2_position"
velocity = ""
acceleration = ""
[wrenches.ground]
force = ["ground_force.x", "ground_force.y", "ground_force.z"]
torque = ["ground_torque.x", "ground_torque.y", "ground_torque.z"]
unit = "N"
position = [0, 0, 0]
quaternion = [1, 0, 0, 0]
"""

TIP = """[wrenches.tip]
body = "link2"
force = ["contact_force.x", "contact_force.y", "contact_force.z"]
torque = ["contact_torque.x", "contact_torque.y", "contact_torque.z"]
position = [0, 0, 0.4]
rpy_deg = [0, 0, 0]
applied_to_link = false
"""

MODELS = {"plain": ("plain.xml", "arm.urdf"), "pad": ("pad.xml",)}
"""Models that explain each log."""

LOGS = ("csv", "npz")


def write_corpus(folder: Path) -> None:
    """Writes models, logs and mappings, named after the contact."""
    for name, contact, mapping in (("plain", None, GROUND), ("pad", "pad", GROUND + TIP)):
        spec = scenes.load("double_pendulum", contact=contact)
        spec.compile()
        (folder / f"{name}.xml").write_text(spec.to_xml(), encoding="utf-8")
        (folder / f"{name}.toml").write_text(mapping, encoding="utf-8")
        recording = simulate(spec, DOUBLE_PENDULUM, samples=150)
        for ending in LOGS:
            recording.save(folder / f"{name}.{ending}")
    (folder / "arm.urdf").write_text(URDF, encoding="utf-8")
