"""Logs of the pendulum in odd layouts of laboratories, each with the mapping that a person would write."""

from functools import cache

import numpy as np
from swinging import pendulum as arm

import scenes
import sim
from experiments.guesses.belief import write_mapping
from experiments.guesses.guess import believed
from ident import joint_torque_regressor, read_log
from ident.recordings.smoothing import smoothed
from sim.motion.excitation import DOUBLE_PENDULUM

DEG = 180 / np.pi
GAINS = (4.2, -2.5)  # Gains of the motors, N m/A.


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


def vector(pattern, x, components="xyz"):
    """Columns of a vector (N, d) by name."""
    return {pattern.format(axis): column for axis, column in zip(components, x.T, strict=True)}


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
    angles = [{"column": f"Joint {k} angle", "unit": "deg"} for k in (1, 2)]
    speeds = {"column": "Joint 1 speed", "unit": "deg/s"}, {"column": "Joint 2 speed", "unit": "rad/s"}
    joints = [{"position": q, "velocity": dq} for q, dq in zip(angles, speeds, strict=True)]
    mapping = true(*joints, ground("Plate F{} [kN]", "Plate M{}", unit="kN", torque_unit="N mm"))
    return text(columns, ";").replace(".", ","), mapping | {"time": {"column": "Timestamp [ms]", "unit": "ms"}}


def headless():
    """Numbers alone, in degrees."""
    t, q1, q2, F, M = _parts()
    columns = {str(k): x for k, x in enumerate((t, DEG * q2, DEG * q1, *F.T, *M.T))}
    positions = [{"position": {"column": column, "unit": "deg"}} for column in "32"]
    mapping = true(*positions, {"ground": {"force": ["4", "5", "6"], "torque": ["7", "8", "9"]}})
    return text(columns).partition("\n")[2], mapping | {"time": "1", "file": {"header": False}}


def turned():
    """A preamble; a sensor turned by 90° with readings of the reaction; and a velocity of opposite sign."""
    t, q1, q2, F, M = _parts()
    turn = np.array([[0, 1, 0], [-1, 0, 0], [0, 0, 1]])
    columns = {"t": t, "q1": q1, "q2": q2}
    columns |= {"dq1": recording()["joint1_velocity"], "dq2": -recording()["joint2_velocity"]}
    columns |= vector("F{}", -F @ turn.T) | vector("M{}", -M @ turn.T)
    joints = {"position": "q1", "velocity": "dq1"}, {"position": "q2", "velocity": {"column": "dq2", "gain": -1}}
    mapping = true(*joints, ground("F{}", "M{}", rpy_deg=[0, 0, 90], applied_to_link=False))
    preamble = "Recorded on the big table\nOperator, nobody\n"
    return preamble + text(columns), mapping | {"time": "t", "file": {"skip": 2}}


def backward():
    """An encoder of opposite sign."""
    t, q1, q2, F, M = _parts()
    columns = {"time": t, "Encoder1": q1, "Encoder2": -q2, **vector("base_f{}", F), **vector("base_m{}", M)}
    joints = {"position": "Encoder1"}, {"position": {"column": "Encoder2", "gain": -1}}
    return text(columns), true(*joints, ground("base_f{}", "base_m{}"))


def opensim():
    """OpenSim's names: a centre of pressure and a free moment with some noise, angles in degrees."""
    t, q1, q2, F, M = _parts()
    point = np.stack([-M[:, 1] / F[:, 2], M[:, 0] / F[:, 2], 1 + 0 * t], axis=1)
    free = 1e-3 * np.random.default_rng(2).normal(size=F.shape)
    free[:, 2] = M[:, 2] - (point[:, 0] * F[:, 1] - point[:, 1] * F[:, 0])
    names = "/jointset/a/joint1/value", "/jointset/b/joint2/value"
    columns = {"time": t, names[0]: DEG * q1, names[1]: DEG * q2} | vector("ground_force_v{}", F)
    columns |= vector("ground_force_p{}", point) | vector("ground_torque_{}", free)
    joints = [{"position": {"column": name, "unit": "deg"}} for name in names]
    plate = {"force": "ground_force_v{}", "point": "ground_force_p{}", "free_moment": "ground_torque_{}"}
    plate = {key: [pattern.format(axis) for axis in "xyz"] for key, pattern in plate.items()}
    return text(columns, "\t"), true(*joints, {"ground": {"frame": "world", **plate}})


def motors():
    """Currents, one in mA and one of opposite sign, at times in microseconds; gains are the true ones."""
    t, q1, q2, *_ = _parts()
    i = torques() / GAINS + 0.05 * np.random.default_rng(1).normal(size=(len(t), 2))
    columns = {"t_us": 1e6 * t, "enc1_deg": DEG * q1, "enc2_deg": DEG * q2}
    columns |= {"I_1 [A]": i[:, 0], "I_2 [mA]": 1e3 * i[:, 1]}
    currents = zip(("I_1 [A]", "I_2 [mA]"), GAINS, ("A", "mA"), strict=True)
    joints = [
        {"position": {"column": f"enc{k}_deg", "unit": "deg"}, "torque": {"column": name, "gain": gain, "unit": unit}}
        for k, (name, gain, unit) in enumerate(currents, start=1)
    ]
    return text(columns), true(*joints) | {"time": {"column": "t_us", "unit": "us"}}


def efforts():
    """Joint torques in N mm, one of them of opposite sign, beside commanded ones."""
    t, q1, q2, *_ = _parts()
    tau = 1e3 * (torques() + 0.1 * np.random.default_rng(1).normal(size=(len(t), 2)))
    columns = {"t": t, "pos_1": q1, "pos_2": q2, "cmd_pos_1": q1 + 0.01, "effort_1": tau[:, 0], "effort_2": -tau[:, 1]}
    joints = [
        {"position": f"pos_{k}", "torque": {"column": f"effort_{k}", "unit": "N mm", "gain": gain}}
        for k, gain in ((1, 1), (2, -1))
    ]
    return text(columns), true(*joints) | {"time": "t"}


LOGS = (laboratory, headless, turned, backward, opensim, motors, efforts)


def true(joint1, joint2, wrenches=None):
    """A mapping of the pendulum's columns."""
    return {"joints": {"joint1": joint1, "joint2": joint2}} | ({"wrenches": wrenches} if wrenches else {})


def ground(force, torque, **more):
    """The entry of the ground's wrench by patterns of its columns."""
    vectors = {kind: [p.format(axis) for axis in "xyz"] for kind, p in (("force", force), ("torque", torque))}
    return {"ground": vectors | more}


def text(columns, between=","):
    """A table of columns of numbers or words by name."""
    cells = ([cell if isinstance(cell, str) else f"{cell:.12g}" for cell in x] for x in columns.values())
    return "\n".join([between.join(columns), *map(between.join, zip(*cells, strict=True))]) + "\n"


def write(folder, log):
    """Writes a log, and returns its path and true mapping."""
    content, mapping = log()
    path = folder / f"{log.__name__}.csv"
    path.write_text(content, encoding="utf-8")
    return path, mapping


def belief_of(folder, columns, mechanism, **given):
    """Belief about a log of some columns, at 100 Hz unless they have a time."""
    count = len(next(iter(columns.values())))
    columns = columns if any("time" in name for name in columns) else {"time": np.arange(count) / 100} | columns
    (folder / "log.csv").write_text(text(columns), encoding="utf-8")
    return believed(mechanism, [folder / "log.csv"], **given)


def read_as_guessed(folder, belief, mechanism):
    """The log read by its guessed mapping."""
    (folder / "guessed.toml").unlink(missing_ok=True)
    write_mapping(folder / "guessed.toml", belief)
    return read_log(folder / "log.csv", mechanism, folder / "guessed.toml")
