"""Valid files, to be damaged."""

from importlib.util import find_spec
from pathlib import Path

from written_formats import write_bag, write_c3d, write_csv, write_mat, write_mot, write_parquet, write_trc

import scenes
from ident.recordings.recording import Recording
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.simulate import simulate

from .other_files import write_other_files

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

FORMATS = {"parquet": "pyarrow", "c3d": "ezc3d", "bag": "rosbags", "mcap": "rosbags"}
"""Formats that need a package of an extra."""

OFTEN = ("csv", "npz", "pair", "mot")

LOGS = (*OFTEN, *OFTEN, "sto", "trc", "mat", *(end for end, package in FORMATS.items() if find_spec(package)))
"""Suffixes of logs, some more often than others; a pair is angles in one file and forces in another."""

PAIR = "{}-angles.mot", "{}-forces.csv"
"""Names of the files of a pair."""


def write_corpus(folder: Path) -> None:
    """Writes models, logs and mappings, named after the contact."""
    for name, contact, mapping in (("plain", None, GROUND), ("pad", "pad", GROUND + TIP)):
        spec = scenes.load("double_pendulum", contact=contact)
        spec.compile()
        (folder / f"{name}.xml").write_text(spec.to_xml(), encoding="utf-8")
        (folder / f"{name}.toml").write_text(mapping, encoding="utf-8")
        recording = simulate(spec, DOUBLE_PENDULUM, samples=150)
        for ending in ("csv", "npz"):
            recording.save(folder / f"{name}.{ending}")
        _write_others(folder, name, recording)
    (folder / "arm.urdf").write_text(URDF, encoding="utf-8")
    write_other_files(folder)


def _write_others(folder: Path, name: str, recording: Recording) -> None:
    """Writes the same recording in the formats of other programs."""
    joints = {joint: recording[f"{joint}_position"] for joint in ("joint1", "joint2")}
    wrenches = {key: recording[key] for key in recording.measured if recording[key].shape[1:] == (3,)}
    time = {"time": recording.time}
    kinds = ("position", "velocity", "acceleration")
    angles = time | {key: recording[key] for key in (f"{joint}_{kind}" for joint in joints for kind in kinds)}
    forces = {f"{key}.{axis}": x[:, k] for key, x in wrenches.items() for k, axis in enumerate("xyz")}
    for ending in ("mot", "sto"):
        write_mot(folder / f"{name}.{ending}", angles | forces, degrees="no")
    write_mot(folder / PAIR[0].format(name), angles, degrees="no")
    write_csv(folder / PAIR[1].format(name), time | forces)
    write_mat(folder / f"{name}.mat", angles, **wrenches)
    labels = {joint: x[:, None] * [1, 0, 0] for joint, x in joints.items()}
    write_trc(folder / f"{name}.trc", recording.time, labels, units="m")
    if "parquet" in LOGS:
        write_parquet(folder / f"{name}.parquet", angles | forces)
    if "c3d" in LOGS:
        write_c3d(folder / f"{name}.c3d", recording.rate, labels, recording.wrench("ground").values, list(joints))
    if "bag" in LOGS:
        states = {joint: [(float(x), 0.0, 0.0) for x in positions] for joint, positions in joints.items()}
        topics = {"/joints": (recording.time, states), "/ground": (recording.time, recording.wrench("ground").values)}
        write_bag(folder / f"{name}.bag", topics)
        write_bag(folder / f"{name}_mcap", topics)
        (folder / f"{name}.mcap").write_bytes(next((folder / f"{name}_mcap").glob("*.mcap")).read_bytes())
