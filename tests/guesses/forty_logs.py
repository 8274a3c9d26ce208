"""The forty logs, four of each of ten drivers and tools."""

from functools import cache

import numpy as np
import walker
from guesses.driver_logs import (
    ALPHABETICAL,
    DEG,
    UR,
    Log,
    angles_of_walker,
    base_wrench,
    fingers,
    named,
    noise,
    numbered,
    plates,
    series,
    seven,
    stamped,
    states,
    true,
    ur,
)


@cache
def logs() -> tuple[Log, ...]:
    """All of them."""
    parts = (
        *(_joint_states, _rostopic, _rtde, _franka, _iiwa),
        *(_lerobot, _opensim, _biomechanics, _gazebo, _matlab),
    )
    return tuple(log for part in parts for log in part())


def _joint_states():
    tool, panda, robot = "ROS joint_states", seven(), ur()
    patterns = tuple(f"/joint_states/{{}}/{kind}" for kind in ("position", "velocity", "effort"))
    for about, r, names in (("PlotJuggler, by name", panda, panda.joints), ("names sorted by the alphabet", robot, UR)):
        order = sorted(range(len(names)), key=names.__getitem__)
        those = [names[k] for k in order]
        columns = stamped(r, "__time", start=1.7e9)
        for pattern, x in zip(reversed(patterns), (r.tau, r.dq, r.q), strict=True):
            columns |= named(pattern, those, x[:, order])
        kinds = dict(zip(("position", "velocity", "torque"), patterns, strict=True))
        yield Log(
            tool, about, columns, r.mechanism, true(r, {k: [p.format(j) for j in names] for k, p in kinds.items()})
        )
    q, dq, tau = "position_{}", "velocity_{}", "effort_{}"
    columns = {**stamped(panda, "Time", start=1.7e9), "header.seq": np.arange(len(panda.time))}
    yield Log(
        tool, "bagpy, zero-based", columns | states(panda, q, dq, tau), panda.mechanism, numbered(panda, q, dq, tau)
    )
    q, dq, tau = (f"/joint_states/{kind}[{{}}]" for kind in ("position", "velocity", "effort"))
    columns = stamped(robot, "__time", start=1.7e9) | states(robot, q, dq, tau, order=ALPHABETICAL)
    truth = numbered(robot, q, dq, tau, order=ALPHABETICAL)
    yield Log(tool, "numbers sorted by the joints' alphabet", columns, robot.mechanism, truth)


def _rostopic():
    tool, robot, panda = "rostopic echo -p", ur(), seven()
    q, dq, tau = "field.position{}", "field.velocity{}", "field.effort{}"
    time = stamped(robot, "%time", 1e9, 1.7e9) | {"field.header.seq": np.arange(len(robot.time))}
    labels = {f"field.name{k}": np.full(len(robot.time), UR[j]) for k, j in enumerate(ALPHABETICAL)}
    rows = states(robot, q, dq, tau, order=ALPHABETICAL)
    truth = numbered(robot, q, dq, tau, order=ALPHABETICAL)
    yield Log(tool, "with the joints' names", time | labels | rows, robot.mechanism, truth)
    yield Log(tool, "names lost", time | rows, robot.mechanism, truth)
    rng = np.random.default_rng(1)
    columns = {**stamped(panda, "%time", 1e9, 1.7e9), **series("field.O_T_EE{}", noise(panda, 16))}
    columns |= states(panda, "field.q{}", "field.dq{}", "field.tau_J{}")
    columns |= series("field.q_d{}", panda.q + 1e-4) | series("field.dtau_J{}", np.gradient(panda.tau, 0.01, axis=0))
    columns |= series("field.tau_ext_hat_filtered{}", noise(panda, 7)) | series(
        "field.O_F_ext_hat_K{}", noise(panda, 6)
    )
    columns |= series("field.theta{}", panda.q + 1e-3 * rng.normal(size=panda.q.shape))
    truth = numbered(panda, "field.q{}", "field.dq{}", "field.tau_J{}")
    yield Log(tool, "franka_states", columns, panda.mechanism, truth)
    grips = np.column_stack([0.02 + 0 * panda.time, 0.02 + 0 * panda.time])
    columns = stamped(panda, "%time", 1e9, 1.7e9)
    for pattern, x in ((q, panda.q), (dq, panda.dq), (tau, panda.tau)):
        columns |= series(pattern, np.column_stack([grips if pattern == q else 0 * grips, x]))
    shifted = list(range(2, 9))
    truth = true(
        panda, {k: [p.format(i) for i in shifted] for k, p in (("position", q), ("velocity", dq), ("torque", tau))}
    )
    yield Log(tool, "two fingers before the arm", columns, panda.mechanism, truth)


def _rtde():
    tool, robot = "UR RTDE", ur()
    q, dq, i = "actual_q_{}", "actual_qd_{}", "actual_current_{}"
    gains = np.array([10.5, 10.5, 10.0, 8.0, 8.0, 8.0])
    current = series(i, robot.tau / gains)
    asked = series("target_q_{}", robot.q + 1e-4) | series("target_moment_{}", robot.tau * 1.1)
    others = series("actual_TCP_pose_{}", noise(robot, 6)) | series("actual_TCP_force_{}", noise(robot, 6, 5.0, 9))
    time = stamped(robot, "timestamp", start=4000)
    columns = time | asked | states(robot, q, dq, "") | current | others
    truth = numbered(robot, q, dq) | {
        f"{j}.torque": (i.format(k), g) for k, (j, g) in enumerate(zip(UR, gains, strict=True))
    }
    yield Log(tool, "record.py with currents", columns, robot.mechanism, truth, between=" ")
    yield Log(
        tool, "positions alone", time | states(robot, q, dq, ""), robot.mechanism, numbered(robot, q, dq), asked=True
    )
    wrench, those = base_wrench(robot, "base_f{}", "base_t{}")
    yield Log(tool, "beside a sensor at the base", time | states(robot, q, "", "") | wrench, robot.mechanism,
              numbered(robot, q), those)  # fmt: skip
    q, dq, tau = "q{}", "qd{}", "joint_torque_{} [Nm]"
    columns = stamped(robot, "t") | states(robot, q, dq, tau, first=1)
    yield Log(tool, "one-based, torques in N m", columns, robot.mechanism, numbered(robot, q, dq, tau, first=1))


def _franka():
    tool, panda, hand = "Franka libfranka", seven(), seven(fingers=True)
    q, dq, tau = "state.q[{}]", "state.dq[{}]", "state.tau_J[{}]"
    columns = stamped(panda) | states(panda, q, dq, tau) | series("state.q_d[{}]", panda.q)
    columns |= series("state.tau_ext_hat_filtered[{}]", noise(panda, 7)) | series("cmd.tau_J[{}]", panda.tau)
    yield Log(tool, "logToCSV", columns, panda.mechanism, numbered(panda, q, dq, tau))
    q, dq, tau = "q_{}", "dq_{}", "tau_{}"
    yield Log(tool, "zero-based beside joints from one on", stamped(panda) | states(panda, q, dq, tau), panda.mechanism,
              numbered(panda, q, dq, tau))  # fmt: skip
    names = [f"fer_joint{k}" for k in range(1, 8)]
    kinds = {"position": panda.q, "velocity": panda.dq, "effort": panda.tau}
    columns = stamped(panda)
    for kind, x in kinds.items():
        columns |= named(f"{{}}_{kind}", names, x)
    words = {"position": "position", "velocity": "velocity", "torque": "effort"}
    truth = true(panda, {kind: [f"{name}_{word}" for name in names] for kind, word in words.items()})
    yield Log(tool, "fer_joint1 for panda_joint1", columns, panda.mechanism, truth)
    columns = stamped(hand) | states(hand, "q_{}", "dq_{}", "tau_J_{}")
    truth = numbered(hand, "q_{}", "dq_{}", "tau_J_{}") | fingers(hand)
    yield Log(tool, "fingers that are not in the log", columns, hand.mechanism, truth, asked=True)


def _iiwa():
    tool, iiwa = "KUKA iiwa FRI", seven("lbr_iiwa_joint_{}")
    q, dq, tau = "measuredJointPosition_{}", "", "measuredTorque_{}"
    columns = stamped(iiwa, "timestamp") | states(iiwa, q, dq, tau)
    columns |= series("commandedJointPosition_{}", iiwa.q) | series("externalTorque_{}", noise(iiwa, 7))
    yield Log(tool, "FRI's names", columns, iiwa.mechanism, numbered(iiwa, q, dq, tau))
    q, tau = "axisQMsr_nr{}", "axisTMsr_nr{}"
    columns = stamped(iiwa, "Time") | states(iiwa, q, "", tau)
    yield Log(tool, "data recorder", columns, iiwa.mechanism, numbered(iiwa, q, "", tau))
    q, tau = "A{} [deg]", "T{} [Nm]"
    columns = stamped(iiwa, "t [ms]", 1e3) | series(q, DEG * iiwa.q, 1) | series(tau, iiwa.tau, 1)
    truth = true(iiwa, {"position": [q.format(k) for k in range(1, 8)]}, {"position": 1 / DEG})
    truth |= true(iiwa, {"torque": [tau.format(k) for k in range(1, 8)]})
    yield Log(tool, "A1 in degrees", columns, iiwa.mechanism, truth)
    q, tau = "field.position.a{}", "field.torque.a{}"
    columns = stamped(iiwa, "%time", 1e9, 1.7e9) | states(iiwa, q, "", tau, first=1)
    yield Log(tool, "iiwa_stack", columns, iiwa.mechanism, numbered(iiwa, q, "", tau, first=1))


def _lerobot():
    tool, robot, arm = "LeRobot", ur(), seven("joint{}")
    q, tau = "observation.state.{}", "observation.effort.{}"
    time = stamped(robot, "timestamp") | {
        "frame_index": np.arange(len(robot.time)),
        "index": 7 + np.arange(len(robot.time)),
    }
    columns = time | states(robot, q, "", "") | series("action.{}", robot.q + 1e-3)
    yield Log(tool, "states alone", columns, robot.mechanism, numbered(robot, q), asked=True)
    columns = columns | series(tau, robot.tau)
    yield Log(tool, "states and efforts", columns, robot.mechanism, numbered(robot, q, "", tau))
    columns = time | series(q, DEG * arm.q) | series(tau, arm.tau) | series("action.{}", DEG * arm.q)
    truth = true(arm, {"position": [q.format(k) for k in range(7)]}, {"position": 1 / DEG})
    yield Log(tool, "degrees", columns, arm.mechanism, truth | true(arm, {"torque": [tau.format(k) for k in range(7)]}))
    columns = time | series("observation.state.{}", np.hstack([robot.q, robot.dq, robot.tau]))
    parts = [[f"observation.state.{k + n}" for k in range(6)] for n in (0, 6, 12)]
    truth = true(robot, dict(zip(("position", "velocity", "torque"), parts, strict=True)))
    yield Log(tool, "all in one state", columns, robot.mechanism, truth)


def _opensim():
    parts = ("{}_ground_force_v{}", "{}_ground_force_p{}", "{}_ground_torque_{}")
    inside = ("ground_force_{}_v{}", "ground_force_{}_p{}", "ground_torque_{}_{}")
    for about, names, patterns, factor in (
        ("/value, radians", "/jointset/leg/{}/value", parts, 1.0),
        ("degrees", "{}", inside, DEG),
        ("numbered plates", "{}", parts, 1.0),
        ("plates by side in words", "{}", ("{}.force.v{}", "{}.force.p{}", "{}.moment.{}"), 1.0),
    ):
        angles, truth = angles_of_walker(names, factor)
        sides = {"numbered plates": ("1", "2"), "plates by side in words": ("right", "left")}.get(about, ("r", "l"))
        forces, those = plates(*patterns, dict(zip("rl", sides, strict=True)))
        yield Log("OpenSim", about, angles | forces, walker.mechanism(), truth, those, between="\t")


def _biomechanics():
    for about, parts, sides, factor in (
        ("plates", ("ground_force_{}_v{}", "ground_force_{}_p{}", "ground_force_{}_m{}"), ("1", "2"), 1.0),
        ("plates and degrees", ("ground_force_{}_v{}", "ground_force_{}_p{}", "ground_force_{}_m{}"), ("1", "2"), DEG),
        ("feet", ("ground_force_{}_v{}", "ground_force_{}_p{}", "ground_force_{}_m{}"), ("foot_r", "foot_l"), 1.0),
        ("moments", ("ground_force_{}_v{}", "ground_force_{}_p{}", "ground_moment_{}_m{}"), ("1", "2"), 1.0),
    ):
        angles, truth = angles_of_walker("{}", factor)
        forces, those = plates(*parts, dict(zip("rl", sides, strict=True)))
        yield Log("AddBiomechanics", about, angles | forces, walker.mechanism(), truth, those, between="\t")


def _gazebo():
    tool, panda, iiwa, robot = "Gazebo", seven(), seven("iiwa_joint_{}"), ur()
    q, dq, tau = (f"panda_joint{{}}.{kind}" for kind in ("position", "velocity", "effort"))
    columns = stamped(panda, "sim_time") | states(panda, q, dq, tau, first=1)
    yield Log(tool, "by name", columns, panda.mechanism, numbered(panda, q, dq, tau, first=1))
    q, dq, tau = (f"lbr::joint_{{}}::{kind}" for kind in ("position", "velocity", "force"))
    columns = stamped(iiwa, "sim_time") | states(iiwa, q, dq, tau)
    yield Log(tool, "scoped names from zero on", columns, iiwa.mechanism, numbered(iiwa, q, dq, tau))
    q, dq, tau = (f"joint_state.{kind}.{{}}" for kind in ("position", "velocity", "effort"))
    columns = stamped(robot, "clock") | states(robot, q, dq, tau, order=ALPHABETICAL)
    truth = numbered(robot, q, dq, tau, order=ALPHABETICAL)
    yield Log(tool, "numbers sorted by the joints' alphabet", columns, robot.mechanism, truth)
    wrench, those = base_wrench(robot, "wrench.force.{}", "wrench.torque.{}")
    columns = stamped(robot, "sim_time") | named("ur5::{}::position", UR, robot.q) | wrench
    truth = true(robot, {"position": [f"ur5::{name}::position" for name in UR]})
    yield Log(tool, "force_torque plugin at the base", columns, robot.mechanism, truth, those)


def _matlab():
    tool, panda, robot = "MATLAB and Simulink", seven("joint{}"), ur()
    columns = {"t": panda.time, "q": panda.q, "dq": panda.dq, "tau": panda.tau}
    truth = numbered(panda, "q.{}", "dq.{}", "tau.{}")
    yield Log(tool, "matrices in a .mat", columns, panda.mechanism, truth, between="mat")
    q, dq, tau = "q({})", "dq({})", "tau({})"
    columns = stamped(panda, "Time") | states(panda, q, dq, tau, first=1)
    yield Log(tool, "q(1) to q(7)", columns, panda.mechanism, numbered(panda, q, dq, tau, first=1))
    block = np.hstack([panda.time[:, None], panda.q, panda.dq, panda.tau])
    kinds = {k: [str(2 + n + j) for j in range(7)] for k, n in (("position", 0), ("velocity", 7), ("torque", 14))}
    yield Log(
        tool, "writematrix of [t q dq tau]", series("{}", block), panda.mechanism, true(panda, kinds), header=False
    )
    block = np.hstack([robot.time[:, None], robot.q, robot.base])
    those = {tuple(str(k) for k in range(8, 14)): None}
    truth = true(robot, {"position": [str(2 + j) for j in range(6)]})
    yield Log(tool, "writematrix of [t q F]", series("{}", block), robot.mechanism, truth, those, header=False)
