"""Simulations step by step: of joints that follow recorded commands through servos, and of a fall with contacts."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from ident.annotations import typed
from ident.arguments import described, is_number
from ident.errors import InputError
from ident.mechanism.drives import Drive
from ident.mechanism.mechanism import Mechanism
from ident.recordings.recording import Recording
from sim.models.model_drives import changed_drives, stated_at
from sim.models.model_mechanism import mujoco_origin
from sim.models.model_update import updated_spec
from sim.models.mujoco_model import mechanism_bodies
from sim.models.notes import body_name, joint_name, without_log
from sim.simulation.readings import ONE_DOF, steps_per_sample
from sim.simulation.simulate import RATE

DIVERGED = (
    int(mujoco.mjtWarning.mjWARN_BADQPOS),
    int(mujoco.mjtWarning.mjWARN_BADQVEL),
    int(mujoco.mjtWarning.mjWARN_BADQACC),
)
"""Warnings after which MuJoCo starts again from the model's own coordinates."""


@without_log()
def rolled_out(
    mechanism: Mechanism,
    recording: Recording,
    *,
    phi: np.ndarray | None = None,
    drives: Mapping[str, Drive] | None = None,
    lag: float = 0.0,
    rates: np.ndarray | None = None,
) -> np.ndarray:
    """Joint coordinates of a model that is simulated with the commands of a recording (N, n).

    It starts at the first recorded coordinates. Contacts are left out, as are the model's actuators, whose place the
    servos of the recording take: `τ = kp (u - q) - kv q̇`.

    Args:
        mechanism: The mechanism, from a model's file or specification by `sim.mechanism`.
        recording: A recording with a command and a servo of every joint.
        phi: φ of its bodies (10 b,), by default the model's.
        drives: Drives that differ from the model's, by joint.
        lag: Time that commands act later than they are logged, s; each is held until the next one.
        rates: Joint velocities at the first sample (n,), by default zero.

    Raises:
        InputError: A joint of the model has no command, or is not in the mechanism.
        ModelError: The model cannot be updated.
    """
    joints = mechanism.tree.joints
    model, chosen = _driven(mechanism, recording, mechanism.known if phi is None else phi, drives or {})
    # Servos of light joints oscillate with some tens of hertz.
    steps = max(1, int(np.ceil(1 / (recording.rate * min(1e-3, model.opt.timestep)))))
    model.opt.timestep = 1 / (recording.rate * steps)
    data, at, dof = mujoco.MjData(model), model.jnt_qposadr[chosen], model.jnt_dofadr[chosen]
    data.qpos[at], data.qvel[dof] = recording.of_joints(joints, "position")[0], 0 if rates is None else rates
    kp = np.array([recording.servos[joint].kp for joint in joints])
    out = np.full((len(recording.time), len(joints)), np.nan)
    for k, commands in enumerate(_acting(recording, joints, steps, lag)):
        if not np.abs(data.qpos[at]).max() < 1e3 or any(data.warning[w].number for w in DIVERGED):
            break
        out[k] = data.qpos[at]
        for command in commands:
            data.qfrc_applied[dof] = kp * (command - data.qpos[at])
            mujoco.mj_step(model, data)
    return out


def _acting(recording: Recording, joints: Sequence[str], steps: int, lag: float) -> np.ndarray:
    """Acting commands in every one of some time steps after each sample (N, steps, n)."""
    commands = np.column_stack([recording[f"{joint}_command"] for joint in joints])
    step = 1 / (recording.rate * steps)
    time = recording.time[:, None] + (np.arange(steps) + 0.5) * step - lag
    return commands[np.maximum(np.searchsorted(recording.time, time, side="right") - 1, 0)]


def _driven(
    mechanism: Mechanism, recording: Recording, phi: np.ndarray, drives: Mapping[str, Drive]
) -> tuple[mujoco.MjModel, list[int]]:
    """The model with given bodies and drives, without contacts and actuators, and the ids of the joints.

    The damping of the servos is the model's.
    """
    joints = mechanism.tree.joints
    if without := [joint for joint in joints if joint not in recording.servos]:
        raise InputError(f"A simulation needs a command of every joint; {', '.join(without)} have none.")
    model = updated_spec(mechanism, phi).compile()
    model.opt.gravity = mechanism.pose[:3, :3] @ mechanism.gravity
    ids = {joint_name(model, j): j for j in range(model.njnt)}
    if others := [name for name, j in ids.items() if name not in joints or model.jnt_type[j] not in ONE_DOF]:
        raise InputError(f"A simulation needs a command of every joint of the model; {', '.join(others)} have none.")
    chosen = [ids[joint] for joint in joints]
    dof = model.jnt_dofadr[chosen]
    for j, values in changed_drives(mujoco_origin(mechanism).model, drives).items():
        for key, value in values.items():
            array, at = stated_at(model, key, j)
            array[at] = value
    # Softness of friction depends on the armature.
    mujoco.mj_setConst(model, mujoco.MjData(model))
    # As damping it is integrated implicitly, which is stable for light joints.
    kv = [recording.servos[joint].kv for joint in joints]
    model.dof_damping[dof] += np.reshape(kv, model.dof_damping[dof].shape)
    model.opt.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT | mujoco.mjtDisableBit.mjDSBL_ACTUATION
    return model, chosen


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
