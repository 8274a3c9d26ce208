"""Contact wrenches on a mechanism in MuJoCo, and a passive fall with its contacts."""

from dataclasses import dataclass

import mujoco
import numpy as np

from ident.annotations import typed
from ident.arguments import described, is_number
from ident.errors import InputError
from sim.models.mujoco_model import mechanism_bodies
from sim.models.notes import body_name, without_log
from sim.simulation.readings import steps_per_sample
from sim.simulation.simulate import RATE


@dataclass(frozen=True, eq=False)
class Fall:
    """A passive motion with its contacts; all values of a sample are at the same instant.

    Attributes:
        time: Sample times, s (N,).
        qpos: MuJoCo's positions (N, nq).
        qvel: Its velocities (N, nv).
        qacc: Its accelerations (N, nv).
        contacts: By name of every body that was touched, the wrench `[F; τ]` that the surroundings apply to it, in its
            own frame, N and N m (N, 6); zero while nothing touches it.
    """

    time: np.ndarray
    qpos: np.ndarray
    qvel: np.ndarray
    qacc: np.ndarray
    contacts: dict[str, np.ndarray]


@typed("seconds")
@without_log()
def fall(model: mujoco.MjModel, base: str, *, seconds: float, rate: float = RATE) -> Fall:
    """Simulates a scene from its reference configuration with all controls at zero, and records motion and contacts.

    Args:
        model: Compiled model.
        base: Name of the base body of the mechanism whose contacts are recorded.
        seconds: Duration, s.
        rate: Samples per second.

    Raises:
        ModelError: The base does not exist, or the timestep does not divide the time between samples.
        InputError: The duration is too short for one sample.
    """
    if not (is_number(seconds) and 1 <= seconds * rate < np.inf):
        raise InputError(f"A fall needs at least one sample, got {described(seconds)} s at {rate:g} Hz.")
    steps = steps_per_sample(model, rate)
    samples = round(seconds * rate)
    data = mujoco.MjData(model)
    qpos, qvel, qacc = (np.empty((samples, size)) for size in (model.nq, model.nv, model.nv))
    contacts: dict[str, np.ndarray] = {}
    for k in range(samples):
        # After a step accelerations and contacts are those of the state before it; a forward call updates them.
        mujoco.mj_forward(model, data)
        qpos[k], qvel[k], qacc[k] = data.qpos, data.qvel, data.qacc
        for body, wrench in contact_wrenches(model, data, base).items():
            contacts.setdefault(body, np.zeros((samples, 6)))[k] = wrench
        mujoco.mj_step(model, data, steps)
    return Fall(np.arange(samples) / rate, qpos, qvel, qacc, contacts)


def contact_wrenches(model: mujoco.MjModel, data: mujoco.MjData, base: str) -> dict[str, np.ndarray]:
    """Wrenches of all contacts of a mechanism with its surroundings; contacts between its own bodies do not count.

    Args:
        model: Compiled model.
        data: Its state, after `mj_forward`.
        base: Name of the base body of the mechanism.

    Returns:
        By name of every body that is touched, the wrench `[F; τ]` that the surroundings apply to it, in its own frame,
        N and N m (6,).

    Raises:
        ModelError: The base does not exist.
    """
    members = mechanism_bodies(model, base)
    wrenches: dict[str, np.ndarray] = {}
    for k, contact in enumerate(data.contact):
        first, second = model.geom_bodyid[contact.geom]
        if (first in members) == (second in members):
            continue
        body = second if second in members else first
        wrench = _on_second(model, data, k, body) * (1 if body == second else -1)
        name = body_name(model, body)
        wrenches[name] = wrenches.get(name, 0) + wrench
    return wrenches


def _on_second(model: mujoco.MjModel, data: mujoco.MjData, k: int, body: int) -> np.ndarray:
    """Wrench of a contact's first geom on its second one, in the frame of a body (6,)."""
    in_contact = np.zeros(6)
    mujoco.mj_contactForce(model, data, k, in_contact)
    # The rows of a contact's frame are its axes in the world; the rows of a body's matrix are the world's in the body.
    force, torque = in_contact.reshape(2, 3) @ data.contact[k].frame.reshape(3, 3)
    torque = torque + np.cross(data.contact[k].pos - data.xpos[body], force)
    return (np.stack([force, torque]) @ data.xmat[body].reshape(3, 3)).ravel()
