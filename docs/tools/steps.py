"""A bare loop of MuJoCo steps."""

from collections.abc import Callable
from dataclasses import replace

import mujoco
import numpy as np

from ident.mechanism.motion import Motion
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.rollout import steps_per_sample
from sim.simulation.servos import servos
from sim.simulation.simulate import LEAD_IN, RATE


def bare_loop(spec: mujoco.MjSpec, samples: int) -> Callable[[], None]:
    """Loop over the steps of a recording with its controls, which reads nothing."""
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

    return loop
