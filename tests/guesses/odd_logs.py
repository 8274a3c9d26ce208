"""Logs of the pendulum in odd layouts of laboratories, each with the mapping that a person would write."""

import re
from functools import cache

import numpy as np

import scenes
import sim
from ident.model.regressor import joint_torque_regressor
from ident.recordings.smoothing import smoothed
from sim.motion.excitation import DOUBLE_PENDULUM

DEG = 180 / np.pi
GAINS = (4.2, -2.5)
"""Gains of the motors, N m/A."""


@cache
def arm():
    """The pendulum of the scene."""
    return sim.mechanism(scenes.load("double_pendulum"), base="base")


@cache
def recording():
    """Simulated recording with the scene's noise."""
    return sim.simulate(scenes.load("double_pendulum"), DOUBLE_PENDULUM, samples=600)


@cache
def torques():
    """Torques of the joints' motors, by the true model along the motion without noise (N, 2)."""
    exact = sim.simulate(scenes.load("double_pendulum"), DOUBLE_PENDULUM, samples=600, noise_scale=0)
    q = np.stack([exact["joint1_position"], exact["joint2_position"]], axis=1)
    return joint_torque_regressor(arm().tree, *smoothed(q, 100, 15.0), gravity=arm().gravity) @ arm().known


def _parts():
    r = recording()
    return r.time, r["joint1_position"], r["joint2_position"], r["ground_force"], r["ground_torque"]


def vector(pattern, x):
    """Columns of a vector (N, 3) by name."""
    return {pattern.format(axis): column for axis, column in zip("xyz", x.T, strict=True)}


def laboratory():
    """Degrees, kN, N mm, ms, other names in another order, a thermometer, semicolons and decimal commas."""
    t, q1, q2, F, M = _parts()
    v = recording()["joint1_velocity"], recording()["joint2_velocity"]
    columns = {
        "Timestamp [ms]": 1e3 * t,
        **dict(reversed(vector("Plate F{} [kN]", F / 1e3).items())),
        **vector("Plate M{}", 1e3 * M),
        "Joint 2 angle": DEG * q2,
        "Joint 1 angle": DEG * q1,
        "Joint 1 speed": DEG * v[0],
        "Joint 2 speed": v[1],
        "room temperature": 20 + 0.1 * np.random.default_rng(0).normal(size=len(t)),
    }
    return (
        text(columns, ";").replace(".", ","),
        """
        time = { column = "Timestamp [ms]", unit = "ms" }
        [joints.joint1]
        position = { column = "Joint 1 angle", unit = "deg" }
        velocity = { column = "Joint 1 speed", unit = "deg/s" }
        [joints.joint2]
        position = { column = "Joint 2 angle", unit = "deg" }
        velocity = { column = "Joint 2 speed", unit = "rad/s" }
        [wrenches.ground]
        force = ["Plate Fx [kN]", "Plate Fy [kN]", "Plate Fz [kN]"]
        unit = "kN"
        torque = ["Plate Mx", "Plate My", "Plate Mz"]
        torque_unit = "N mm"
    """,
    )


def headless():
    """Numbers alone, in degrees."""
    t, q1, q2, F, M = _parts()
    columns = {str(k): x for k, x in enumerate((t, DEG * q2, DEG * q1, *F.T, *M.T))}
    return (
        text(columns).partition("\n")[2],
        """
        time = "1"
        [file]
        header = false
        [joints.joint1]
        position = { column = "3", unit = "deg" }
        [joints.joint2]
        position = { column = "2", unit = "deg" }
        [wrenches.ground]
        force = ["4", "5", "6"]
        torque = ["7", "8", "9"]
    """,
    )


def turned():
    """A preamble; a sensor turned by 90° with readings of the reaction; and a velocity of opposite sign."""
    t, q1, q2, F, M = _parts()
    turn = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    columns = {
        "t": t,
        "q1": q1,
        "q2": q2,
        "dq1": recording()["joint1_velocity"],
        "dq2": -recording()["joint2_velocity"],
        **vector("F{}", -F @ turn.T),
        **vector("M{}", -M @ turn.T),
    }
    return (
        "Recorded on the big table\nOperator, nobody\n" + text(columns),
        """
        time = "t"
        [file]
        skip = 2
        [joints.joint1]
        position = "q1"
        velocity = "dq1"
        [joints.joint2]
        position = "q2"
        velocity = { column = "dq2", gain = -1 }
        [wrenches.ground]
        force = ["Fx", "Fy", "Fz"]
        torque = ["Mx", "My", "Mz"]
        rpy_deg = [0, 0, 90]
        applied_to_link = false
    """,
    )


def backward():
    """An encoder of opposite sign."""
    t, q1, q2, F, M = _parts()
    columns = {"time": t, "Encoder1": q1, "Encoder2": -q2, **vector("base_f{}", F), **vector("base_m{}", M)}
    return (
        text(columns),
        """
        [joints.joint1]
        position = "Encoder1"
        [joints.joint2]
        position = { column = "Encoder2", gain = -1 }
        [wrenches.ground]
        force = ["base_fx", "base_fy", "base_fz"]
        torque = ["base_mx", "base_my", "base_mz"]
    """,
    )


def opensim():
    """OpenSim's names: a centre of pressure and a free moment, angles in degrees."""
    t, q1, q2, F, M = _parts()
    point = np.stack([-M[:, 1] / F[:, 2], M[:, 0] / F[:, 2], 1 + 0 * t], axis=1)
    free = np.stack([0 * t, 0 * t, M[:, 2] - (point[:, 0] * F[:, 1] - point[:, 1] * F[:, 0])], axis=1)
    columns = {"time": t, "/jointset/a/joint1/value": DEG * q1, "/jointset/b/joint2/value": DEG * q2}
    columns |= vector("ground_force_v{}", F) | vector("ground_force_p{}", point) | vector("ground_torque_{}", free)
    return (
        text(columns, "\t"),
        """
        [joints.joint1]
        position = { column = "/jointset/a/joint1/value", unit = "deg" }
        [joints.joint2]
        position = { column = "/jointset/b/joint2/value", unit = "deg" }
        [wrenches.ground]
        frame = "world"
        force = ["ground_force_vx", "ground_force_vy", "ground_force_vz"]
        point = ["ground_force_px", "ground_force_py", "ground_force_pz"]
        free_moment = ["ground_torque_x", "ground_torque_y", "ground_torque_z"]
    """,
    )


def motors():
    """Currents, one in mA and one of opposite sign, at times in microseconds; gains are the true ones."""
    t, q1, q2, *_ = _parts()
    i = torques() / GAINS + 0.05 * np.random.default_rng(1).normal(size=(len(t), 2))
    columns = {
        "t_us": 1e6 * t,
        "enc1_deg": DEG * q1,
        "enc2_deg": DEG * q2,
        "I_1 [A]": i[:, 0],
        "I_2 [mA]": 1e3 * i[:, 1],
    }
    return (
        text(columns),
        """
        time = { column = "t_us", unit = "us" }
        [joints.joint1]
        position = { column = "enc1_deg", unit = "deg" }
        torque = { column = "I_1 [A]", gain = 4.2, unit = "A" }
        [joints.joint2]
        position = { column = "enc2_deg", unit = "deg" }
        torque = { column = "I_2 [mA]", gain = -2.5, unit = "mA" }
    """,
    )


def efforts():
    """Joint torques in N mm, one of them of opposite sign, beside commanded ones."""
    t, q1, q2, *_ = _parts()
    tau = 1e3 * (torques() + 0.1 * np.random.default_rng(1).normal(size=(len(t), 2)))
    columns = {"t": t, "pos_1": q1, "pos_2": q2, "cmd_pos_1": q1 + 0.01, "effort_1": tau[:, 0], "effort_2": -tau[:, 1]}
    return (
        text(columns),
        """
        [joints.joint1]
        position = "pos_1"
        torque = { column = "effort_1", unit = "N mm" }
        [joints.joint2]
        position = "pos_2"
        torque = { column = "effort_2", unit = "N mm", gain = -1 }
    """,
    )


LOGS = (laboratory, headless, turned, backward, opensim, motors, efforts)


def text(columns, between=","):
    """A table of columns by name."""
    rows = np.stack(list(columns.values()), axis=1)
    return "\n".join([between.join(columns), *(between.join(f"{x:.12g}" for x in row) for row in rows)]) + "\n"


def write(folder, log):
    """Writes a log and its true mapping; returns their paths."""
    content, mapping = log()
    path, columns = folder / f"{log.__name__}.csv", folder / "true.toml"
    path.write_text(content, encoding="utf-8")
    columns.write_text(re.sub(r"^ +", "", mapping, flags=re.MULTILINE), encoding="utf-8")
    return path, columns
