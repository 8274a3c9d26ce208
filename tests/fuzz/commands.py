"""The commands that are fuzzed: their files, options with valid and invalid values, and the valid files."""

from dataclasses import dataclass
from types import ModuleType

import wrist
from marked import labels_of, trc, trial
from written_formats import write_csv, write_mat, write_mot

import scenes
from experiments import angles, identify, payload
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.simulate import simulate

Options = dict[str, tuple[str, ...]]


@dataclass(frozen=True)
class Command:
    """A command, its files by kind, and options with right and wrong values; `@KIND NAME` is a file, `@` the first."""

    module: ModuleType
    files: tuple[tuple[str, tuple[str, ...]], ...]
    right: Options
    wrong: Options
    always: tuple[str, ...] = ()


def _identify(name: str, *models: str, always: tuple[str, ...] = ()) -> Command:
    logs = *(f"{name}.{end}" for end in ("csv", "npz", "mot", "mat")), f"{name}-angles.mot+{name}-forces.csv"
    right = {
        "--base": ("base",),
        "--columns": (f"@columns {name}.toml",),
        "--cutoff": ("auto", "20"),
        "--holdout": ("0.4", "0.05"),
        "--held-out": (f"@log {name}.csv",),
        "--no-offsets": (),
        "--estimator": ("ordinary", "weighted", "trajectory"),
        "--prior": ("auto", "on", "off"),
        "--own": ("offset", "delay"),
    }
    wrong = {
        "--base": ("link1", "link2", "world", "$", ""),
        "--columns": ("absent.toml", "@", "."),
        "--cutoff": ("0", "nan", "49", "1e-9", "1e9", "x"),
        "--holdout": ("0.9", "2", "nan"),
        "--held-out": ("@", "absent.csv", "."),
        "--drive": ("viscous", "coulomb", "rotor", "stribeck", "x"),
        "--ignore": ("grip", "x", "$"),
        "--name": ("..", "a/b", "", "$", "\u202e", "x" * 300),
    }
    return Command(identify, (("model", models), ("log", logs)), right, wrong, ("--base", *always))


PLAIN = _identify("plain", "plain.xml", "arm.urdf")
COMMANDS = (
    *3 * [PLAIN],
    _identify("pad", "pad.xml", always=("--columns",)),
    Command(
        angles,
        (("model", ("marked.xml",)), ("log", ("marked.trc",))),
        {"--base": ("base",), "--scale": (), "--wrenches": ("@columns plain.csv",), "--mass": ("70",)},
        {"--base": ("x", ""), "--mass": ("0", "nan", "-1"), "--places": ("@", "absent"), "--symmetric": ("",)}
        | {"--scale-from": ("@", "absent"), "--wrenches": ("@", ".")},
        ("--base",),
    ),
    Command(
        payload,
        (("model", ("wrist.xml",)), ("log", ("wrist.csv", "wrist.npz"))),
        {"--body": ("tool",), "--sensor": ("wrist",), "--columns": ("@columns wrist.toml",)}
        | {"--holdout": ("0.4",), "--no-offsets": (), "--flange": ("link7",)},
        {"--body": ("link1", "x", "", "world"), "--sensor": ("x", ""), "--flange": ("x",), "--holdout": ("1", "nan")},
        ("--body", "--sensor", "--columns"),
    ),
)
"""The commands, `identify` more often than others."""

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
JOINTS = """time = "time"
joints.joint1.position = { column = "joint1_position", unit = "rad" }
[joints.joint2]
position = "joint2_position"
velocity = ""
acceleration = ""
"""
WRENCH = """[wrenches.{name}]
{body}
force = ["{column}_force.x", "{column}_force.y", "{column}_force.z"]
torque = ["{column}_torque.x", "{column}_torque.y", "{column}_torque.z"]
unit = "N"
position = [0, 0, {z}]
rpy_deg = [0, 0, {turn}]
"""
GROUND = JOINTS + WRENCH.format(name="ground", body="", column="ground", z=0, turn=0)
TIP = WRENCH.format(name="tip", body='body = "link2"\napplied_to_link = false', column="contact", z=0.4, turn=0)
MAPPINGS = {"plain": GROUND, "pad": GROUND + TIP}
MAPPINGS |= {"wrist": WRENCH.format(name="wrist", body='body = "tool"', column="wrist", z=0.01, turn=45)}


def write_corpus(folder):
    """Writes the valid files."""
    texts = {f"{name}.toml": text for name, text in MAPPINGS.items()} | {"arm.urdf": URDF, "wrist.xml": wrist.model()}
    for name, text in texts.items():
        (folder / name).write_text(text, encoding="utf-8")
    recordings = {"wrist": wrist.log(seconds=3.0)}
    for name, contact in (("plain", None), ("pad", "pad")):
        spec = scenes.load("double_pendulum", contact=contact)
        spec.compile()
        (folder / f"{name}.xml").write_text(spec.to_xml(), encoding="utf-8")
        recordings[name] = recording = simulate(spec, DOUBLE_PENDULUM, samples=150)
        vectors = {key: x for key, x in recording.measured.items() if x.ndim == 2}
        forces = {f"{key}.{axis}": x[:, k] for key, x in vectors.items() for k, axis in enumerate("xyz")}
        joints = {key: x for key, x in recording.measured.items() if key.startswith("joint") and x.ndim == 1}
        time = {"time": recording.time}
        write_mot(folder / f"{name}.mot", time | joints | forces, degrees="no")
        write_mot(folder / f"{name}-angles.mot", time | joints, degrees="no")
        write_csv(folder / f"{name}-forces.csv", time | forces)
        write_mat(folder / f"{name}.mat", time | joints, **vectors)
    for name, recording in recordings.items():
        for ending in ("csv", "npz"):
            recording.save(folder / f"{name}.{ending}")
    # A double pendulum with markers, and a trial of it.
    spec = scenes.load("double_pendulum")
    for body in ("base", "link1", "link2"):
        for k, at in enumerate(((0.1, 0, 0.1), (0, 0.1, 0.2), (-0.1, 0, 0.3))):
            spec.body(body).add_site(name=f"{body}_{k}", pos=at)
    model = spec.compile()
    (folder / "marked.xml").write_text(spec.to_xml(), encoding="utf-8")
    time, _, x = trial(model, 40)
    (folder / "marked.trc").write_text(trc(time, labels_of(model), x), encoding="utf-8")
