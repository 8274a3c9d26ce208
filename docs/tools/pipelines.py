"""Other software from a log and a model to parameters: `python -m docs.tools.pipelines NAME MODEL LOG --out FOLDER`.

Each as somebody would who knows it, on joint angles and torques of a chain of hinges about axes of their frames.
"""

import json
import sys
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import BSpline, make_lsq_spline
from scipy.signal import butter, sosfiltfilt
from scipy.sparse import bsr_matrix, csr_matrix, diags, eye, hstack, kron, vstack
from scipy.sparse.linalg import splu

from ident.geometry.inertia import PINOCCHIO

WRITTEN = "made/estimate.json"
"""Path of the file of parameters within the folder."""

CUTOFF = 10.0
"""Cut-off of Pinocchio's low-pass, Hz, the best of 3, 5, 10 and 20."""

KNOTS = 0.02
"""Time between knots of CasADi's splines, s, the best of 20, 30, 40 and 50 ms."""

SLOW, SLIP = 0.05, 0.01
"""Velocities, rad/s, below which a joint's torques are left out, as friction there is anything up to breakaway, and
over which Coulomb friction changes sign where it has to be differentiable."""

ROUNDS, SMALL = 20, 0.01
"""Largest number of Gauss-Newton steps, and squared length in standard deviations of the last one."""

Answer = dict[str, Any]
"""φ of the bodies that move (n, 10), in this package's order, drives by name, and perhaps deviations of both."""


@dataclass(frozen=True)
class Log:
    """Angles, rad, and torques, N m, (N, n) at a rate in Hz, and the URDF file of what they were recorded from."""

    path: Path
    joints: tuple[str, ...]
    rate: float
    q: np.ndarray
    torque: np.ndarray

    @classmethod
    def read(cls, model: str, log: str) -> "Log":
        """A log with columns `time`, `JOINT_position` and `JOINT_torque`."""
        table = np.genfromtxt(log, delimiter=",", names=True)
        names = table.dtype.names or ()
        joints = tuple(name.removesuffix("_position") for name in names if name.endswith("_position"))
        q, torque = (np.column_stack([table[f"{joint}_{kind}"] for joint in joints]) for kind in ("position", "torque"))
        return cls(Path(model), joints, 1 / float(np.diff(table["time"]).mean()), q, torque)

    @cached_property
    def model(self) -> Any:
        """Pinocchio's model."""
        return import_module("pinocchio").buildModelFromUrdf(str(self.path))

    def answer(self, values: np.ndarray, variance: np.ndarray) -> Answer:
        """Answer from φ in Pinocchio's order and rotor inertias, viscous and Coulomb friction and offsets of joints."""
        bodies = 10 * len(self.joints)
        phi = (np.arange(0, bodies, 10)[:, None] + np.argsort(PINOCCHIO)).ravel()
        names = [f"{kind}({joint})" for kind in ("Ia", "Fv", "Fc", "offset") for joint in self.joints]
        drives = dict(zip(names, values[bodies:].tolist(), strict=True))
        std = np.sqrt(np.concatenate([variance[phi], variance[bodies:]]))
        return {"phi": values[phi].reshape(-1, 10).tolist(), "drives": drives, "std": std.tolist()}


def pinocchio(log: Log) -> Answer:
    """Low-passed angles and their differences, Pinocchio's regressor sample by sample, and `np.linalg.lstsq`."""
    regressor, data = import_module("pinocchio").computeJointTorqueRegressor, log.model.createData()
    low_pass = butter(4, CUTOFF, fs=log.rate, output="sos")
    q, torque = (sosfiltfilt(low_pass, x, axis=0) for x in (log.q, log.torque))
    dq = np.gradient(q, 1 / log.rate, axis=0)
    ddq = np.gradient(dq, 1 / log.rate, axis=0)
    rows = np.array([regressor(log.model, data, *state) for state in zip(q, dq, ddq, strict=True)])
    drives = [x[:, :, None] * np.eye(len(log.joints)) for x in (ddq, dq, np.sign(dq), np.ones_like(q))]
    used, end = abs(dq) > SLOW, round(log.rate / CUTOFF)
    # Filtered signals are wrong at both ends.
    used[:end] = used[-end:] = False
    A, b = np.concatenate([rows, *drives], axis=2)[used], torque[used]
    values, _, rank, _ = np.linalg.lstsq(A, b, rcond=None)
    variance = np.sum((b - A @ values) ** 2) / (len(b) - rank)
    return log.answer(values, variance * np.diag(np.linalg.pinv(A.T @ A)))


def casadi(log: Log) -> Answer:
    """Splines of the angles and all parameters together, by Gauss-Newton steps with CasADi's derivatives.

    Angles and torques are weighted by the deviations of their residuals.
    """
    ca, (samples, n) = import_module("casadi"), log.q.shape
    states, theta = [ca.SX.sym(name, n) for name in ("q", "dq", "ddq")], ca.SX.sym("theta", 14 * n)
    torque = inverse_dynamics(ca, log.model, states, theta)
    derivatives = ca.jacobian(torque, ca.vertcat(*states)), ca.jacobian(torque, theta)
    dynamics = ca.Function("dynamics", [*states, theta], [torque, *derivatives]).map(samples)

    at = np.arange(samples) / log.rate
    ends, inner = np.repeat([[0.0], [at[-1]]], 5, axis=1), np.linspace(0, at[-1], round(at[-1] / KNOTS) + 1)
    spline = make_lsq_spline(at, log.q, np.concatenate([ends[0], inner, ends[1]]), k=5)
    single = BSpline(spline.t, np.eye(len(spline.c)), 5)
    bases = [kron(csr_matrix(single(at, nu=order)), eye(n), format="csr") for order in range(3)]
    known = np.concatenate([body.toDynamicParameters() for body in log.model.inertias[1:]])
    c, x = spline.c.ravel(), np.concatenate([known, np.zeros(4 * n)])
    used = np.stack([np.ones_like(log.q, bool), abs((bases[1] @ c).reshape(samples, n)) > SLOW])
    for _ in range(ROUNDS):
        motion = [(basis @ c).reshape(samples, n) for basis in bases]
        outputs = dynamics(*(part.T for part in motion), np.tile(x[:, None], samples))
        # CasADi puts the columns of all samples beside each other.
        predicted, by_state, by_theta = (np.array(y).reshape(n, samples, -1).swapaxes(0, 1) for y in outputs)
        left = np.stack([log.q - motion[0], log.torque - predicted[:, :, 0]])
        weights = (used / np.std(left, axis=1, keepdims=True, where=used)).ravel()
        blocks, starts = np.split(by_state, 3, axis=2), np.arange(samples + 1)
        through = sum(bsr_matrix((y, starts[:-1], starts)) @ basis for y, basis in zip(blocks, bases, strict=True))
        rows = [hstack([bases[0], csr_matrix((samples * n, len(x)))]), hstack([through, by_theta.reshape(-1, len(x))])]
        J = (diags(weights) @ vstack(rows)).tocsc()
        H = J.T @ J
        # What nothing determines stays where it is.
        factor = splu((H + diags(1e-9 * H.diagonal() + 1e-12)).tocsc())
        step = factor.solve(J.T @ (weights * left.ravel()))
        c, x = c + step[: len(c)], x + step[len(c) :]
        if step @ (H @ step) < SMALL:
            break
    return log.answer(x, np.diag(factor.solve(np.eye(len(step))[:, len(c) :])[len(c) :]))


def inverse_dynamics(ca: Any, model: Any, states: list[Any], theta: Any) -> Any:
    """Torques (n,) as CasADi's expressions, by Lagrange's equations, with friction.

    L = Σ ½ m v·v + v·(ω × h) + ½ ω·Iω + g·(m p + R h)      h = m r, all about the origins p of the links
    """
    q, dq, ddq = states
    phi, n, R, p = theta, q.numel(), ca.DM.eye(3), ca.DM.zeros(3)
    v, w, L = ca.DM.zeros(3), ca.DM.zeros(3), 0
    for k in range(n):
        place, name = model.jointPlacements[k + 1], model.joints[k + 1].shortname()
        axis, offset = ca.DM(np.eye(3)["XYZ".index(name[-1])]), ca.DM(place.translation)
        turn = ca.DM.eye(3) + ca.sin(q[k]) * ca.skew(axis) + (1 - ca.cos(q[k])) * ca.mpower(ca.skew(axis), 2)
        turn = ca.DM(place.rotation) @ turn
        v, w = turn.T @ (v + ca.cross(w, offset)), turn.T @ w + axis * dq[k]
        p, R = p + R @ offset, R @ turn
        m, h, (xx, xy, yy, xz, yz, zz) = phi[0], phi[1:4], ca.vertsplit(phi[4:10])
        inertia, phi = ca.blockcat([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]), phi[10:]
        L += m * ca.dot(v, v) / 2 + ca.dot(v, ca.cross(w, h)) + ca.dot(w, inertia @ w) / 2
        L += ca.dot(ca.DM(model.gravity.linear), m * p + R @ h)
    rate = ca.jtimes(ca.gradient(L, dq), ca.vertcat(q, dq), ca.vertcat(dq, ddq))
    rotor, viscous, coulomb, constant = ca.vertsplit(phi, n)
    return rate - ca.gradient(L, q) + rotor * ddq + viscous * dq + coulomb * ca.tanh(dq / SLIP) + constant


def validated(name: str, log: Log) -> Answer:
    """One of those that `multicontact validate` compares with, and the CPU time of what it does not need itself, s."""
    start = time.process_time()
    peers = import_module("experiments.studies.validation.peers")

    class Given(peers.Given):  # type: ignore[misc, name-defined]
        def values(self, phi: np.ndarray, drives: Mapping[str, float]) -> Answer:
            return {"phi": phi[-len(log.joints) :].tolist(), "drives": dict(drives)}

    part = peers.TorqueLog(log.rate, log.q, log.torque)
    given = Given(log.path, peers.Equations.of_wrench(peers.mechanism(log.path)), [part], part)
    around = time.process_time() - start
    answer, _ = peers.PEERS[name](given)
    return {**answer, "around": around}


PEERS: Mapping[str, Callable[[Log], Answer]] = {
    "pinocchio": pinocchio,
    "casadi": casadi,
    **{name: partial(validated, name) for name in ("FIGAROH", "mujoco.sysid")},
}
"""All of them by name."""

if __name__ == "__main__":
    name, model, log, _, out = sys.argv[1:]
    answer = PEERS[name](Log.read(model, log))
    (Path(out) / WRITTEN).write_text(json.dumps(answer), encoding="utf-8")
