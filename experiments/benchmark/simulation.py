"""Recorded simulations against a bare loop of MuJoCo steps."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial

import mujoco
import numpy as np

import scenes
from experiments.benchmark.timing import Effort, alternating, ratio
from experiments.data.defaults import SCENE
from ident.mechanism.motion import Motion
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.rollout import steps_per_sample
from sim.simulation.servos import servos
from sim.simulation.simulate import LEAD_IN, RATE, simulate, simulate_many

TOGETHER = 8
"""Recordings that one call simulates."""

THREADS = (1, 2)
"""Numbers of threads in which several recordings are simulated."""


@dataclass(frozen=True)
class Stepping:
    """Simulation rate in steps per second, medians.

    Attributes:
        task: Name of the function that steps.
        threads: Number of threads.
        steps: Steps of one recording.
        ours: Rate from scene and excitation to recordings of all sensors with noise, 1/s.
        native: Rate of a loop that sets prepared controls and calls `mj_step` in one thread, and reads nothing, 1/s.
        ratio: Ratio of the medians, ours to native.
        lowest: Smallest ratio of neighbouring repetitions.
        highest: Largest ratio of neighbouring repetitions.
        repetitions: Number of repetitions.
    """

    task: str
    threads: int
    steps: int
    ours: float
    native: float
    ratio: float
    lowest: float
    highest: float
    repetitions: int


def simulations(effort: Effort) -> list[Stepping]:
    """Rates of one recording, and of several in one thread and in two."""
    spec, samples = scenes.load(SCENE), effort.samples
    steps, native = _native(spec, samples)

    def stepping(task: str, threads: int, runs: int, ours: Callable[[], object]) -> Stepping:
        times = alternating((ours, native), effort.seconds, effort.least) / [runs * steps, steps]
        ours_rate, native_rate = (1 / np.median(times, axis=0)).tolist()
        return Stepping(task, threads, steps, ours_rate, native_rate, *ratio(times), len(times))

    many = partial(simulate_many, spec, DOUBLE_PENDULUM, seeds=range(TOGETHER), samples=samples)
    return [
        stepping("simulate", 1, 1, partial(simulate, spec, DOUBLE_PENDULUM, samples=samples)),
        *(stepping("simulate_many", threads, TOGETHER, partial(many, threads=threads)) for threads in THREADS),
    ]


def _native(spec: mujoco.MjSpec, samples: int) -> tuple[int, Callable[[], None]]:
    """Number of steps of a recording, and a loop of them with the controls of a recording."""
    model = spec.compile()
    driven = servos(model, len(DOUBLE_PENDULUM.offset))
    steps = round(LEAD_IN / model.opt.timestep) + steps_per_sample(model, RATE) * (samples - 1)
    time = np.arange(steps) * model.opt.timestep - LEAD_IN
    desired = Motion(*replace(DOUBLE_PENDULUM, noise=0.0).trajectory(time))
    controls = driven.commands(time, desired)

    def loop() -> None:
        data = mujoco.MjData(model)
        data.qpos[driven.qpos], data.qvel[driven.dof] = desired.q[0], desired.dq[0]
        for control in controls:
            data.ctrl[:] = control
            mujoco.mj_step(model, data)

    return steps, loop
