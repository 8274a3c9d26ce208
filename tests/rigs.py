"""Seven-joint arms in laboratories' logs: friction, delayed clocks, and files with their own names and units."""

from functools import cache

import mujoco
import numpy as np
import wrist
from scipy.signal import butter, sosfiltfilt

from ident.model.regressor import joint_torque_regressor

HAND = {"mass": 0.73, "com": (0.0, 0.01, 0.06), "inertia": (2e-3, 2e-3, 1e-3, 0, 0, 0)}
"""The hand of the model."""

NO_HAND = {"mass": 1e-9, "com": (0, 0, 0), "inertia": (1e-12, 1e-12, 1e-12, 0, 0, 0)}

VISCOUS = np.array([1.0, 1.2, 0.8, 0.9, 0.5, 0.4, 0.4])
"""Viscous friction, N m s."""

COULOMB = np.array([0.9, 1.1, 0.7, 0.8, 0.5, 0.35, 0.3])
"""Coulomb friction, N m."""


@cache
def moved(seconds, rate, seed=0, stands=-1.0):
    """Times, angles, velocities, and torques without hand and friction along the motion of `wrist.motion` (N, 7).

    Args:
        seconds: Duration, s; `rate` in Hz, and `seed` of the motion.
        stands: Time at rest at the end, after a second of slowing down, s; -1 for none.
    """
    t, step = np.arange(round(seconds * rate)) / rate, 1e-4
    behind, at, ahead = (_until(t + dt, seconds - stands) for dt in (-step, 0, step))
    speed, change = (ahead - behind) / (2 * step), (ahead - 2 * at + behind) / step**2
    q, dq, ddq = wrist.along(at, seed)
    ddq = ddq * speed[:, None] ** 2 + dq * change[:, None]
    dq = dq * speed[:, None]
    arm = mujoco.MjModel.from_xml_string(wrist.model(tool=NO_HAND))
    data, torques = mujoco.MjData(arm), np.empty_like(q)
    for k in range(len(t)):
        data.qpos[:], data.qvel[:], data.qacc[:] = q[k], dq[k], ddq[k]
        mujoco.mj_inverse(arm, data)
        torques[k] = data.qfrc_inverse
    return t, q, dq, torques


def _until(t, end):
    """Time along a motion that slows down within the second before the end, and stops there."""
    late = np.clip(t - end + 1, 0, 1)
    return np.minimum(t, end - 1) + late - late**3 + late**4 / 2


def friction(dq):
    """Torques of viscous and Coulomb friction (N, 7)."""
    return VISCOUS * dq + COULOMB * np.tanh(dq / 1e-3)


def coupled(matrix, seconds, rate, stands, seed=6):
    """Times, angles and torques of motors whose angles are `matrix` times the first six joints', with friction on them.

    Args:
        matrix: Coupling of the motors (6, 6).
        seconds: Duration, s; `rate` in Hz, `stands` as for `moved`, and `seed` of the noise.
    """
    rng, gear = np.random.default_rng(seed), np.abs(matrix).max(axis=1)
    t, q, dq, torque = moved(seconds, rate, stands=stands)
    turned, turns = q[:, :6] @ matrix.T, dq[:, :6] @ matrix.T
    torque = torque[:, :6] @ np.linalg.inv(matrix)
    torque = torque + (0.3 * VISCOUS[:6] * turns / gear + 0.3 * COULOMB[:6] * np.tanh(turns / 0.1)) / gear
    torque = torque + 0.02 * torque.std(axis=0) * rng.normal(size=torque.shape)
    return t, turned + 1e-3 * rng.normal(size=turned.shape), torque


def late_clock(t, rng):
    """Time stamps with some delays, and the rows that exist: holes of 16 ms."""
    step = t[1] - t[0]
    stamps = t + np.where(rng.random(len(t)) < 0.05, rng.uniform(0, 0.4 * step, len(t)), 0)
    there = np.ones(len(t), bool)
    for first in rng.integers(10, len(t) - 10, 4):
        there[first : first + max(2, round(0.016 / step))] = False
    return stamps, there


def with_runs_missing(x, rng):
    """Channels (N, k) with runs of samples that are NaN."""
    x = x.copy()
    for first in rng.integers(10, len(x) - 10, 4):
        x[first : first + rng.integers(2, 8), rng.integers(x.shape[1])] = np.nan
    return x


def write_log(path, columns):
    """A CSV file, empty cells for NaN."""
    rows = [",".join("" if np.isnan(x) else f"{x:.7g}" for x in row) for row in zip(*columns.values(), strict=True)]
    path.write_text("\n".join([",".join(columns), *rows, ""]), encoding="utf-8")


def by_hand(arm, logs, cutoff=5.0, holdout=0.4):
    """Relative RMS of each torque by the usual pipeline: all low-passed, least squares with offset and friction.

    Args:
        arm: The mechanism.
        logs: Times (N,), angles and torques (N, n) of each log, NaN where missing.
        cutoff: Cut-off, Hz.
        holdout: Fraction at the end of each log that is predicted.
    """
    fitted, judged = [], []
    for t, q, torque in logs:
        step = float(np.median(np.diff(t)))
        grid = np.arange(t[0], t[-1], step)
        raw = np.concatenate([_filled(grid, t, q), _filled(grid, t, torque)], axis=1)
        x = sosfiltfilt(butter(2, 2 * step * cutoff, output="sos"), raw, axis=0)
        n = q.shape[1]
        dq = np.gradient(x[:, :n], step, axis=0)
        ddq = np.gradient(dq, step, axis=0)
        Y = joint_torque_regressor(arm.tree, x[:, :n], dq, ddq, gravity=arm.gravity)
        own = [each[:, :, None] * np.eye(n) for each in (np.ones_like(dq), dq, np.sign(dq))]
        rows, edge, split = np.concatenate([Y, *own], axis=2), round(0.5 / step), round((1 - holdout) * len(grid))
        fitted.append((rows[edge:split], x[edge:split, n:]))
        judged.append((rows[split + edge : -edge], raw[split + edge : -edge, n:]))
    A, b = (np.concatenate(each) for each in zip(*fitted, strict=True))
    values = np.linalg.lstsq(A.reshape(-1, A.shape[2]), b.ravel(), rcond=1e-8)[0]
    A, b = (np.concatenate(each) for each in zip(*judged, strict=True))
    return np.sqrt(((b - A @ values) ** 2).mean(axis=0) / (b**2).mean(axis=0))


def _filled(grid, t, x):
    there = np.isfinite(x)
    return np.stack([np.interp(grid, t[ok], each[ok]) for each, ok in zip(x.T, there.T, strict=True)], axis=1)
