"""A pendulum's motion at any time, for recordings with streams at their own times."""

from functools import cache

import numpy as np
from scipy.interpolate import make_interp_spline

import ident
import scenes
import sim
from sim.motion.excitation import DOUBLE_PENDULUM

JOINTS = ("joint1", "joint2")
NOISE = {"joint1_position": 0.001, "joint2_position": 0.001, "ground_force": 0.5, "ground_torque": 0.05}


@cache
def pendulum():
    return sim.mechanism(scenes.load("double_pendulum"), base="base")


@cache
def _truth():
    """Curves through noise-free sensor readings at 100 Hz, and their last time."""
    exact = sim.simulate(scenes.load("double_pendulum"), DOUBLE_PENDULUM, noise_scale=0)
    return {name: make_interp_spline(exact.time, exact[name], 5) for name in NOISE}, exact.time[-1]


def ticks(rate, jitter=0.0, rng=None):
    end = _truth()[1]
    time = np.arange(0, end, 1 / rate)
    return time if rng is None else np.clip(time + rng.uniform(-jitter, jitter, len(time)), 0, end)


def sampled(rng, name, time, missing=0.0, gap=()):
    """Noisy samples at some times, some of them missing and none in a gap."""
    values = _truth()[0][name](time)
    values += NOISE[name] * rng.normal(size=values.shape)
    values[rng.uniform(size=values.shape) < missing] = np.nan
    kept = np.ones(len(time), bool) if not gap else (time < gap[0]) | (time > gap[1])
    return time[kept], values[kept]


def streams(rng, *, angles=100.0, jitter=0.0, wrench=100.0, missing=0.0, gap=()):
    clocks = {"joint": ticks(angles, jitter, rng), "ground": ticks(wrench)}
    return {name: sampled(rng, name, clocks[name[:5] if name[0] == "j" else "ground"], missing, gap) for name in NOISE}


def motion(time):
    curves = [_truth()[0][f"{joint}_position"] for joint in JOINTS]
    return ident.Motion(*(np.stack([curve(time, d) for curve in curves], axis=1) for d in range(3)))


def z_of(psi, covariance):
    truth = ident.find_base_parameters(pendulum()).regroup(pendulum().known)
    return (psi[: len(truth)] - truth) / np.sqrt(np.diag(covariance)[: len(truth)])


def identified(streams, **fields):
    return ident.identify(pendulum(), ident.Recording.from_streams(streams, **fields), holdout=0)
