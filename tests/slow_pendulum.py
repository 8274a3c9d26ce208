"""Recordings of the paper's pendulum in motions that are slow for its sensors' resolution, or with a joint at rest."""

import numpy as np
from mechanisms import sines
from recorded_faults import PENDULUM, angles_and_wrench

import ident

NOISE = np.array([0.5, 0.5, 0.5, 0.1, 0.05, 0.05])  # Noise of the scene's wrench, N and N m.


TIME = np.arange(800) / 100


def rounded(x, step):
    return step * np.round(x / step) if step else x


def motion(rng, speed, rests=None):
    """Angles, velocities and accelerations (800, 2) each."""
    w = 2 * np.pi * speed * np.array([[0.23, 0.41, 0.67], [0.31, 0.53, 0.79]])
    size, phase = 0.6 * np.array([[1, 0.4, 0.2], [0.8, 0.5, 0.2]]), rng.uniform(0, 2 * np.pi, (2, 3))
    if rests is not None:
        size[1] = 0
    states = sines(TIME, size, w, phase)
    states[0][:, 1] += rests or 0.0
    return states


def recorded(seed=0, *, speed=0.5, rests=None, forces=0.0, moments=0.0, angles=0.0, noise=0.0, jitter=1e-3):
    """Angles and a wrench at 100 Hz in steps of some size; `rests` is the angle of a second joint that rests."""
    rng = np.random.default_rng(seed)
    states = motion(rng, speed, rests)
    wrench = ident.base_wrench_regressor(PENDULUM.tree, *states, gravity=PENDULUM.gravity) @ PENDULUM.known
    wrench = wrench + noise * NOISE * rng.normal(size=wrench.shape)
    q = states[0] + jitter * rng.normal(size=states[0].shape) * [1, rests is None]
    wrench = np.hstack([rounded(wrench[:, :3], forces), rounded(wrench[:, 3:], moments)])
    return angles_and_wrench(TIME, rounded(q, angles), wrench)
