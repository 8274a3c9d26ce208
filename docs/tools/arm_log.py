"""The log of README's example: the scene `arm` with a load that its model does not have, on a plate."""

from pathlib import Path

import mujoco
import numpy as np

import scenes
from docs.tools.noise.recordings import sinusoids
from ident.files.atomic import replacing
from ident.recordings.recording import Recording
from sim.simulation.simulate import simulate

LOAD, PLACE = 0.5, (0.06, 0.12, 0.0)
"""Mass, kg, and centre in the tool's frame, m, of the load: a ball with a radius of 30 mm."""

RADIUS = 0.03

SAMPLES, SEED = 1200, 2
"""12 s at 100 Hz."""

DECIMALS = {"position": 5, "force": 2, "torque": 3}
"""Decimals of the log by quantity, several of them within the noise."""


def loaded_arm() -> mujoco.MjSpec:
    """The scene `arm` with the load welded to its tool."""
    spec = scenes.load("arm")
    inertia = [0.4 * LOAD * RADIUS**2] * 3
    ball = spec.body("tool").add_body(name="load", pos=PLACE)
    ball.mass, ball.ipos, ball.inertia, ball.explicitinertial = LOAD, [0, 0, 0], inertia, True
    return spec


def recording() -> Recording:
    """The arm's motion along sums of sinusoids, with all sensors of the scene."""
    motion = sinusoids(np.random.default_rng(SEED), 4, SAMPLES / 100)
    return simulate(loaded_arm(), motion, samples=SAMPLES, seed=SEED)


def save(path: Path) -> None:
    """Writes angles, torques and the wrench of the plate as a CSV file, as a robot's controller would."""
    log = recording()
    columns, formats = {"time": log.time}, ["%.2f"]
    for name, values in log.measured.items():
        kind = name.rpartition("_")[2]
        if kind in DECIMALS:
            parts = (
                {name: values} if values.ndim == 1 else {f"{name}.{a}": x for a, x in zip("xyz", values.T, strict=True)}
            )
            columns |= parts
            formats += [f"%.{DECIMALS[kind]}f"] * len(parts)
    with replacing(path) as temporary:
        rows = np.column_stack(list(columns.values()))
        np.savetxt(temporary, rows, formats, delimiter=",", header=",".join(columns), comments="", encoding="utf-8")
