"""Forty logs with the column names of ten drivers and tools, four of each, each with its true mapping."""

from collections import namedtuple
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import walker
import wrist
from guesses.odd_logs import DEG, text, vector
from random_models import inverse_dynamics
from scipy.io import savemat

import sim
from ident import base_wrench_regressor

UR = ("shoulder_pan_joint", "shoulder_lift_joint", "elbow_joint", "wrist_1_joint", "wrist_2_joint", "wrist_3_joint")
"""Joints of Universal Robots from the base on; ROS often sorts them alphabetically."""

FINGERS = ("panda_finger_joint1", "panda_finger_joint2")

Robot = namedtuple("Robot", "mechanism joints time q dq tau base")
"""An arm and its recording: times (N,), states and torques (N, n), and the ground's wrench on the base (N, 6)."""
ALPHABETICAL = sorted(range(6), key=UR.__getitem__)  # Joints of the six-axis robot in ROS's order.
PLAIN, EPOCH, STAMPS = ("time", 1.0, 0.0), ("__time", 1.0, 1.7e9), ("%time", 1e9, 1.7e9)
"""Name, factor and start of columns of times."""


def ur():
    """A robot with joints like Universal Robots'."""
    return recorded(UR)


def seven(pattern="panda_joint{}", fingers=()):
    """A robot like Franka's or KUKA's with seven joints, perhaps with fingers."""
    return recorded(tuple(pattern.format(k) for k in range(1, 8)), fingers)


@cache
def recorded(joints, fingers=()):
    """A motion of six seconds of an arm, with its torques and base wrench."""
    text = wrist.model(
        beyond="".join(
            f'<body name="of_{name}"><joint name="{name}" type="slide" axis="0 1 0"/>'
            '<inertial mass="0.05" pos="0 0 0.03" diaginertia="1e-5 1e-5 1e-5"/></body>'
            for name in fingers
        )
    )
    for k in range(7, 0, -1):
        own = f'<joint name="{joints[k - 1]}" axis="0 0 1"/>' if k <= len(joints) else ""
        text = text.replace(f'<joint name="joint{k}" axis="0 0 1"/>', own)
    text = text.replace("<worldbody>", '<worldbody><body name="base">').replace("</worldbody>", "</body></worldbody>")
    spec = mujoco.MjSpec.from_string(text)
    rng, mechanism, n = np.random.default_rng(3), sim.mechanism(spec, base="base"), len(joints)
    time, *states = wrist.motion(6.0, 50.0)
    q, dq, ddq = (x[:, :n] for x in states)
    tau = inverse_dynamics(spec.compile(), q, dq, ddq)[0][:, :n]
    resting = [np.pad(x, ((0, 0), (0, len(mechanism.joints) - n))) for x in (q, dq, ddq)]
    ground = base_wrench_regressor(mechanism.tree, *resting, gravity=mechanism.gravity) @ mechanism.known
    tau = tau + np.array([0.6, 0.6, 0.4, 0.2, 0.1, 0.06, 0.02])[:n] * np.tanh(dq / 0.05)
    tau = tau + 0.02 * np.ptp(tau, axis=0) * rng.normal(size=tau.shape)
    ground = ground + 0.01 * np.ptp(ground, axis=0) * rng.normal(size=ground.shape)
    q, dq = q + 1e-5 * rng.normal(size=q.shape), dq + 1e-3 * rng.normal(size=q.shape)
    return Robot(mechanism, joints, time, q, dq, tau, ground)


@dataclass(frozen=True, eq=False)
class Log:
    """A log of a tool; `truth` has the column of each `JOINT.KIND` and its factor to SI, `asked` if some is open."""

    tool: str
    about: str
    columns: Mapping[str, Any]
    mechanism: Any
    truth: Mapping[str, tuple[str, float] | None]
    wrenches: Mapping[tuple[str, ...], str | None] = field(default_factory=dict)
    asked: bool = False
    between: str = ","
    header: bool = True

    def write(self, folder: Path) -> Path:
        if self.between == "mat":
            savemat(folder / "log.mat", self.columns)
            return folder / "log.mat"
        content = text(self.columns, self.between)
        (folder / "log.csv").write_text(content if self.header else content.partition("\n")[2], encoding="utf-8")
        return folder / "log.csv"


def series(pattern, x):
    """Numbered columns of an array (N, d), from zero on."""
    return {pattern.format(k): column for k, column in enumerate(x.T)}


def columns_of(robot, *patterns, first=0, order=None, labels=None, clock=PLAIN, scale=(1.0, 1.0, 1.0)):
    """Columns of positions, velocities and torques named by patterns, `scale` times SI units, and their mapping."""
    name, factor, start = clock
    columns, truth, order = {name: factor * (robot.time + start)}, {}, list(order or range(len(robot.joints)))
    firsts = first if isinstance(first, Sequence) else (first,) * 3
    values = {"position": robot.q, "velocity": robot.dq, "torque": robot.tau}
    for (kind, x), pattern, number, size in zip(values.items(), patterns, firsts, scale, strict=False):
        sizes = np.broadcast_to(size, len(robot.joints))
        for place, k in enumerate(order) if pattern else ():
            name = pattern.format(labels[k] if labels else place + number)
            columns[name], truth[f"{robot.joints[k]}.{kind}"] = x[:, k] * sizes[k], (name, 1 / sizes[k])
    return columns, truth


def arm(tool, about, robot, *patterns, beside=None, wrench=(), asked=False, lacking=(), **how):
    """A log of an arm, arguments as for `columns_of`; `wrench` has patterns of the ground's force and moment."""
    columns, truth = columns_of(robot, *patterns, **how)
    parts = [vector(pattern, x) for pattern, x in zip(wrench, (robot.base[:, :3], robot.base[:, 3:]), strict=False)]
    ground = {name: x for part in parts for name, x in part.items()}
    truth |= {f"{joint}.position": None for joint in lacking}
    wrenches = {tuple(ground): None} if ground else {}
    columns |= (beside or {}) | ground
    return Log(tool, about, columns, robot.mechanism, truth, wrenches, asked)


def noise(robot, columns, size=1.0, seed=5):
    """Columns independent of the motion (N, columns)."""
    return size * np.cumsum(np.random.default_rng(seed).normal(size=(len(robot.time), columns)), axis=0) / 30


def three(pattern, position="position", velocity="velocity", torque="effort"):
    """Patterns of the three quantities."""
    return [pattern.replace("*", kind) for kind in (position, velocity, torque)]


def _ros():
    tool, panda, robot = "ROS joint_states", seven(), ur()
    by_name, numbered, fields = three("/joint_states/{}/*"), three("/joint_states/*[{}]"), three("field.*{}")
    by_alphabet = sorted(range(7), key=panda.joints.__getitem__)
    sequence = np.arange(len(robot.time))
    yield arm(tool, "PlotJuggler, by name", panda, *by_name, labels=panda.joints, order=by_alphabet, clock=EPOCH)
    yield arm(tool, "names sorted by the alphabet", robot, *by_name, labels=UR, order=ALPHABETICAL, clock=EPOCH)
    clock, beside = ("Time", 1.0, 1.7e9), {"header.seq": sequence}
    yield arm(tool, "bagpy, zero-based", panda, *three("*_{}"), clock=clock, beside=beside)
    yield arm(tool, "numbers sorted by the joints' alphabet", robot, *numbered, order=ALPHABETICAL, clock=EPOCH)
    tool, labels = "rostopic echo -p", np.full((len(sequence), 6), [UR[k] for k in ALPHABETICAL])
    for about, names in (("with the joints' names", series("field.name{}", labels)), ("names lost", {})):
        beside = {"field.header.seq": sequence} | names
        yield arm(tool, about, robot, *fields, order=ALPHABETICAL, clock=STAMPS, beside=beside)
    beside = series("field.O_T_EE{}", noise(panda, 16)) | series("field.q_d{}", panda.q + 1e-4)
    beside |= series("field.dtau_J{}", np.gradient(panda.tau, 0.02, axis=0))
    beside |= series("field.tau_ext_hat_filtered{}", noise(panda, 7)) | series("field.O_F_ext_hat_K{}", noise(panda, 6))
    beside |= series("field.theta{}", panda.q + 1e-3 * np.random.default_rng(1).normal(size=panda.q.shape))
    patterns = "field.q{}", "field.dq{}", "field.tau_J{}"
    yield arm(tool, "franka_states", panda, *patterns, clock=STAMPS, beside=beside)
    grips = np.full((len(panda.time), 2), 0.02)
    beside = {name: x for k, pattern in enumerate(fields) for name, x in series(pattern, grips * (k == 0)).items()}
    yield arm(tool, "two fingers before the arm", panda, *fields, first=2, clock=STAMPS, beside=beside)


def _rtde():
    tool, robot, q, dq, clock = "UR RTDE", ur(), "actual_q_{}", "actual_qd_{}", ("timestamp", 1.0, 4000.0)
    gains = np.array([10.5, 10.5, 10.0, 8.0, 8.0, 8.0])
    beside = series("target_q_{}", robot.q + 1e-4) | series("target_moment_{}", robot.tau * 1.1)
    beside |= series("actual_TCP_pose_{}", noise(robot, 6)) | series("actual_TCP_force_{}", noise(robot, 6, 5.0, 9))
    how = {"clock": clock, "scale": (1.0, 1.0, 1 / gains), "beside": beside}
    yield replace(arm(tool, "record.py with currents", robot, q, dq, "actual_current_{}", **how), between=" ")
    yield arm(tool, "positions alone", robot, q, dq, clock=clock)
    yield arm(tool, "beside a sensor at the base", robot, q, clock=clock, wrench=("base_f{}", "base_t{}"))
    clock, patterns = ("t", 1.0, 0.0), ("q{}", "qd{}", "joint_torque_{} [Nm]")
    yield arm(tool, "one-based, torques in N m", robot, *patterns, first=1, clock=clock)


def _franka():
    tool, panda, hand = "Franka libfranka", seven(), seven(fingers=FINGERS)
    patterns = "state.q[{}]", "state.dq[{}]", "state.tau_J[{}]"
    beside = series("state.q_d[{}]", panda.q) | series("state.tau_ext_hat_filtered[{}]", noise(panda, 7))
    yield arm(tool, "logToCSV", panda, *patterns, beside=beside | series("cmd.tau_J[{}]", panda.tau))
    yield arm(tool, "zero-based beside joints from one on", panda, "q_{}", "dq_{}", "tau_{}")
    yield arm(tool, "fer_joint1 for panda_joint1", panda, *three("fer_joint{}_*"), first=1)
    about, patterns = "fingers that are not in the log", ("q_{}", "dq_{}", "tau_J_{}")
    yield arm(tool, about, hand, *patterns, lacking=FINGERS, asked=True)


def _iiwa():
    tool, iiwa = "KUKA iiwa FRI", seven("lbr_iiwa_joint_{}")
    beside = series("commandedJointPosition_{}", iiwa.q) | series("externalTorque_{}", noise(iiwa, 7))
    patterns, clock = ("measuredJointPosition_{}", "", "measuredTorque_{}"), ("timestamp", 1.0, 0.0)
    yield arm(tool, "FRI's names", iiwa, *patterns, clock=clock, beside=beside)
    yield arm(tool, "data recorder", iiwa, "axisQMsr_nr{}", "", "axisTMsr_nr{}", clock=("Time", 1.0, 0.0))
    patterns, clock = ("A{} [deg]", "", "T{} [Nm]"), ("t [ms]", 1e3, 0.0)
    yield arm(tool, "A1 in degrees", iiwa, *patterns, first=1, clock=clock, scale=(DEG, 1.0, 1.0))
    yield arm(tool, "iiwa_stack", iiwa, "field.position.a{}", "", "field.torque.a{}", first=1, clock=STAMPS)


def _lerobot():
    tool, robot, joints = "LeRobot", ur(), seven("joint{}")
    q, tau, clock = "observation.state.{}", "observation.effort.{}", ("timestamp", 1.0, 0.0)
    frames = {"frame_index": np.arange(len(robot.time)), "index": 7 + np.arange(len(robot.time))}
    beside = frames | series("action.{}", robot.q + 1e-3)
    yield arm(tool, "states alone", robot, q, clock=clock, beside=beside, asked=True)
    yield arm(tool, "states and efforts", robot, q, "", tau, clock=clock, beside=beside)
    beside = frames | series("action.{}", DEG * joints.q)
    yield arm(tool, "degrees", joints, q, "", tau, clock=clock, beside=beside, scale=(DEG, 1.0, 1.0))
    yield arm(tool, "all in one state", robot, q, q, q, first=(0, 6, 12), clock=clock, beside=frames)


def _walkers():
    """Persons on two plates, a row each: names of angles, patterns of forces and moments, sides, unit of angles."""
    outside, inside = ("{}_ground_force_{}{}", "{}_ground_torque_{}"), ("ground_force_{}_{}{}", "ground_torque_{}_{}")
    addb, feet = ("ground_force_{}_{}{}", "ground_force_{}_m{}"), ("foot_r", "foot_l")
    words, moments = ("{}.force.{}{}", "{}.moment.{}"), ("ground_force_{}_{}{}", "ground_moment_{}_m{}")
    for tool, about, names, (force, moment), sides, factor in (
        ("OpenSim", "/value, radians", "/jointset/leg/{}/value", outside, "rl", 1.0),
        ("OpenSim", "degrees", "{}", inside, "rl", DEG),
        ("OpenSim", "numbered plates", "{}", outside, "12", 1.0),
        ("OpenSim", "plates by side in words", "{}", words, ("right", "left"), 1.0),
        ("AddBiomechanics", "plates", "{}", addb, "12", 1.0),
        ("AddBiomechanics", "plates and degrees", "{}", addb, "12", DEG),
        ("AddBiomechanics", "feet", "{}", addb, feet, 1.0),
        ("AddBiomechanics", "moments", "{}", moments, "12", 1.0),
    ):
        (time, q, *_), mechanism, both = walker.motion(), walker.mechanism(), walker.wrenches()
        columns, truth, wrenches = {"time": time}, {}, {}
        for joint, x in zip(mechanism.tree.joints, q.T, strict=True):
            scale = 1.0 if joint in ("tx", "ty", "tz") else factor
            columns[names.format(joint)], truth[f"{joint}.position"] = scale * x, (names.format(joint), 1 / scale)
        for foot, side, wrench in zip("rl", sides, (both["right"] + both["rail"], both["left"]), strict=True):
            at, free = walker.centre_of_pressure(wrench)
            at = np.nan_to_num(np.column_stack([at, 0 * free]), posinf=0, neginf=0)
            forces, points = ([force.format(side, kind, axis) for axis in "xyz"] for kind in "vp")
            about_point = [moment.format(side, axis) for axis in "xyz"]
            values = np.hstack([wrench[:, :3], at, np.column_stack([0 * free, 0 * free, free])])
            columns |= dict(zip([*forces, *points, *about_point], values.T, strict=True))
            wrenches[tuple(forces + about_point)] = f"foot_{foot}"
        rarely = {name: x[::2] for name, x in columns.items()}
        yield Log(tool, about, rarely, mechanism, truth, wrenches, between="\t")


def _gazebo():
    tool, panda, iiwa, robot, clock = "Gazebo", seven(), seven("iiwa_joint_{}"), ur(), ("sim_time", 1.0, 0.0)
    yield arm(tool, "by name", panda, *three("panda_joint{}.*"), first=1, clock=clock)
    scoped = three("lbr::joint_{}::*", torque="force")
    yield arm(tool, "scoped names from zero on", iiwa, *scoped, clock=clock)
    about, patterns = "numbers sorted by the joints' alphabet", three("joint_state.*.{}")
    yield arm(tool, about, robot, *patterns, order=ALPHABETICAL, clock=("clock", 1.0, 0.0))
    about, wrench = "force_torque plugin at the base", ("wrench.force.{}", "wrench.torque.{}")
    yield arm(tool, about, robot, "ur5::{}::position", labels=UR, clock=clock, wrench=wrench)


def _matlab():
    tool, panda, robot = "MATLAB and Simulink", seven("joint{}"), ur()
    matrices = {"t": panda.time, "q": panda.q, "dq": panda.dq, "tau": panda.tau}
    vectors = arm(tool, "matrices in a .mat", panda, "q.{}", "dq.{}", "tau.{}")
    yield replace(vectors, columns=matrices, between="mat")
    yield arm(tool, "q(1) to q(7)", panda, "q({})", "dq({})", "tau({})", first=1, clock=("Time", 1.0, 0.0))
    numbers, clock = ("{}", "{}", "{}"), ("1", 1.0, 0.0)
    whole = arm(tool, "writematrix of [t q dq tau]", panda, *numbers, first=(2, 9, 16), clock=clock)
    yield replace(whole, header=False)
    block = dict(zip(map(str, range(8, 14)), robot.base.T, strict=True))
    bare = arm(tool, "writematrix of [t q F]", robot, "{}", first=2, clock=clock, beside=block)
    yield replace(bare, wrenches={tuple(block): None}, header=False)


LOGS = (*_ros(), *_rtde(), *_franka(), *_iiwa(), *_lerobot(), *_walkers(), *_gazebo(), *_matlab())
