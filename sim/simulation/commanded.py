"""Simulation of a model whose joints follow recorded commands through their servos."""

from collections.abc import Mapping, Sequence

import mujoco
import numpy as np

from ident.errors import InputError
from ident.mechanism.drives import Drive
from ident.mechanism.mechanism import Mechanism
from ident.recordings.recording import Recording
from sim.models.model_drives import changed_drives, stated_at
from sim.models.model_mechanism import mujoco_origin
from sim.models.model_update import updated_spec
from sim.models.notes import joint_name, without_log
from sim.simulation.readings import ONE_DOF

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
