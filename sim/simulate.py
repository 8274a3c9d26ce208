"""From a scene and an excitation to a recording, in MuJoCo's forward dynamics."""

import copy
import hashlib
from dataclasses import dataclass, replace

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from sim.excitation import Excitation
from sim.hand import Hand
from sim.recording import Recording

RATE = 100.0
"""Samples per second of a recording."""

SAMPLES = 943
"""Samples of the paper's recordings: 4715 / 5 and 5658 / 6 rows."""

LEAD_IN = 1.0
"""Seconds of motion before the recording starts, for servos and contacts to settle."""

LOUDEST = 1000.0
"""Largest factor on the noise."""

LOST = 0.2
"""Tracking error, in rad, from which the servos have lost the excitation: at a joint limit or out of torque."""

QUATERNION = "quaternion"
"""Unit of a channel that is an orientation, w, x, y, z."""

_JOINT_UNITS = {
    mujoco.mjtSensor.mjSENS_JOINTPOS: "",
    mujoco.mjtSensor.mjSENS_JOINTVEL: "/s",
    mujoco.mjtSensor.mjSENS_USER: "/s²",
}

_ONE_DOF = (int(mujoco.mjtJoint.mjJNT_HINGE), int(mujoco.mjtJoint.mjJNT_SLIDE))

_SENSOR_UNITS = {
    mujoco.mjtSensor.mjSENS_TOUCH: "N",
    mujoco.mjtSensor.mjSENS_FORCE: "N",
    mujoco.mjtSensor.mjSENS_TORQUE: "N m",
    mujoco.mjtSensor.mjSENS_FRAMEPOS: "m",
    mujoco.mjtSensor.mjSENS_FRAMEQUAT: QUATERNION,
}


@dataclass(frozen=True)
class Sensor:
    """A sensor as the MJCF declares it.

    Attributes:
        name: Its name, the channel's in a recording.
        unit: Unit of its readings, empty if unknown.
        part: Its place in `sensordata`.
        noise: Declared standard deviation; for an orientation, of each component of a rotation vector in rad.
        dof: Degree of freedom whose acceleration a user sensor reports, None for sensors that MuJoCo fills itself.
    """

    name: str
    unit: str
    part: slice
    noise: float
    dof: int | None


def sensors(model: mujoco.MjModel) -> list[Sensor]:
    """The sensors that a model declares.

    Raises:
        ValueError: A user sensor is not attached to a hinge or slide joint.
    """
    return [_sensor(model, i) for i in range(model.nsensor)]


def _sensor(model: mujoco.MjModel, i: int) -> Sensor:
    name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_SENSOR, i) or f"sensor{i}"
    kind = mujoco.mjtSensor(model.sensor_type[i])
    dof = None
    if kind == mujoco.mjtSensor.mjSENS_USER:
        joint = model.sensor_objid[i] if model.sensor_objtype[i] == mujoco.mjtObj.mjOBJ_JOINT else -1
        if joint < 0 or model.jnt_type[joint] not in _ONE_DOF or model.sensor_dim[i] != 1:
            raise ValueError(
                f"User sensor '{name}' must report one number of a hinge or slide joint (objtype='joint', dim='1')."
            )
        dof = int(model.jnt_dofadr[model.sensor_objid[i]])
    start = model.sensor_adr[i]
    unit = _SENSOR_UNITS.get(kind, "")
    if kind in _JOINT_UNITS:
        slide = model.jnt_type[model.sensor_objid[i]] == mujoco.mjtJoint.mjJNT_SLIDE
        unit = ("m" if slide else "rad") + _JOINT_UNITS[kind]
    return Sensor(name, unit, slice(start, start + model.sensor_dim[i]), float(model.sensor_noise[i]), dof)


def simulate(
    spec: mujoco.MjSpec,
    excitation: Excitation,
    *,
    samples: int = SAMPLES,
    seed: int = 0,
    noise_scale: float = 1.0,
) -> Recording:
    """Runs a scene along an excitation and records all its sensors at `RATE`.

    Every servo must be a position actuator; the i-th one follows the i-th column of the excitation.

    Args:
        spec: The scene.
        excitation: Desired joint motion, with its acceleration noise.
        samples: Number of samples N.
        seed: Seed of the excitation's and of the sensors' noise.
        noise_scale: Factor on both kinds of noise; zero records the truth.

    Returns:
        The recording, true values included. Its provenance gives the scene's hash, the excitation, all other arguments
        and the largest tracking error.

    Raises:
        ValueError: The scene or an argument does not fit, or the servos lose the excitation.
    """
    if samples < 1:
        raise ValueError(f"A recording needs at least one sample, got {samples}.")
    if not 0 <= noise_scale <= LOUDEST:
        raise ValueError(f"The noise scale must be from 0 to {LOUDEST:g}, got {noise_scale:.6g}.")
    model = spec.compile()
    excitation_rng, sensor_rng = np.random.default_rng(seed).spawn(2)
    disturbed = replace(excitation, noise=noise_scale * excitation.noise)
    readings, error = _run(model, disturbed, samples, excitation_rng)
    declared = sensors(model)
    true = {s.name: readings[:, s.part.start] if _is_scalar(s) else readings[:, s.part] for s in declared}
    recording = Recording(
        time=np.arange(samples) / RATE,
        measured=true,
        true=true,
        units={s.name: s.unit for s in declared},
        noise={s.name: noise_scale * s.noise for s in declared},
        provenance={
            "scene": spec.modelname,
            "scene_sha256": hashlib.sha256(spec.to_xml().encode()).hexdigest(),
            "excitation": {key: np.asarray(x).tolist() for key, x in vars(excitation).items()},
            "rate_hz": RATE,
            "samples": samples,
            "seed": int(seed),
            "noise_scale": noise_scale,
            "tracking_error_rad": error,
        },
    )
    return with_noise(recording, sensor_rng)


def with_noise(recording: Recording, rng: np.random.Generator) -> Recording:
    """The recording with its sensors' noise drawn anew around the true values.

    Noise is Gaussian and white, and none where no level is known. An orientation is turned by a random rotation vector
    in its own axes.
    """
    measured = {}
    for name, true in recording.true.items():
        std = recording.noise.get(name, 0.0)
        if recording.units.get(name) == QUATERNION:
            turn = Rotation.from_rotvec(std * rng.normal(size=(len(true), 3)))
            measured[name] = (Rotation.from_quat(true, scalar_first=True) * turn).as_quat(scalar_first=True)
        else:
            measured[name] = true + std * rng.normal(size=true.shape)
    return replace(recording, measured=measured)


def _is_scalar(sensor: Sensor) -> bool:
    return sensor.part.stop - sensor.part.start == 1


def _run(
    model: mujoco.MjModel, excitation: Excitation, samples: int, rng: np.random.Generator
) -> tuple[np.ndarray, float]:
    """Sensor readings (N, nsensordata) and the largest tracking error in rad."""
    h = model.opt.timestep
    steps = round(1 / (RATE * h)) if h > 0 else 0
    if steps < 1 or abs(steps * RATE * h - 1) > 1e-9:
        raise ValueError(f"The scene's timestep of {h} s must divide {1 / RATE} s.")
    qpos, dof = _driven(model, len(excitation.offset))
    lead = round(LEAD_IN / h)
    time = np.arange(-lead, samples * steps) * h
    desired = excitation.trajectory(time, rng)
    plan = _plan(model, time, desired)
    filled = [(s.part, s.dof) for s in sensors(model) if s.dof is not None]

    data = mujoco.MjData(model)
    data.qpos[qpos], data.qvel[dof] = desired[0][0], desired[1][0]
    readings = np.empty((samples, model.nsensordata))
    error = 0.0
    for step in range(len(time)):
        data.ctrl[:], data.mocap_pos[:], data.mocap_quat[:] = (x[step] for x in plan)
        if step >= lead and (step - lead) % steps == 0:
            # A step leaves sensors and qacc at the state before it; a forward call puts everything at this instant.
            mujoco.mj_forward(model, data)
            k = (step - lead) // steps
            readings[k] = data.sensordata
            for part, joint_dof in filled:
                readings[k, part] = data.qacc[joint_dof]
            error = max(error, float(np.abs(data.qpos[qpos] - desired[0][step]).max()))
            if not error <= LOST:
                raise ValueError(
                    f"The servos lost the excitation after {time[step]:.2f} s by {error:.2f} rad: it must stay within "
                    "the joint and torque limits; noise on its acceleration drifts off in long recordings."
                )
        mujoco.mj_step(model, data)
    return readings, error


def _driven(model: mujoco.MjModel, joints: int) -> tuple[np.ndarray, np.ndarray]:
    """Addresses in qpos and qvel of the joints that the servos drive."""
    on_joint = (model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT).all()
    is_position = (model.actuator_gainprm[:, 0] > 0).all() and (
        model.actuator_biasprm[:, 1] == -model.actuator_gainprm[:, 0]
    ).all()
    if model.nu != joints or not (on_joint and is_position):
        raise ValueError(
            f"An excitation of {joints} joints needs as many position servos, the scene has {model.nu} actuators."
        )
    ids = model.actuator_trnid[:, 0]
    return model.jnt_qposadr[ids], model.jnt_dofadr[ids]


def _plan(
    model: mujoco.MjModel, time: np.ndarray, desired: tuple[np.ndarray, np.ndarray, np.ndarray]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Servo commands (T, nu), and positions (T, nmocap, 3) and quaternions (T, nmocap, 4) of hands.

    A position servo's force `kp (u - q) - kv q̇` becomes a computed torque τ plus feedback,
    `τ + kp (q_d - q) + kv (q̇_d - q̇)`, by the command `u = q_d + (kv q̇_d + τ) / kp`; τ is what the desired motion of the
    free mechanism needs. A hand is a mocap body; it follows the desired pose of the body that it is tied to.
    """
    qpos, dof = _driven(model, desired[0].shape[1])
    kp, kv = model.actuator_gainprm[:, 0], -model.actuator_biasprm[:, 2]
    held = _held_bodies(model)
    hand = Hand()
    free = copy.copy(model)
    free.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data = mujoco.MjData(free)
    torque = np.empty_like(desired[0])
    position, quaternion = np.empty((len(time), len(held), 3)), np.empty((len(time), len(held), 4))
    for k, (t, q, dq, ddq) in enumerate(zip(time, *desired, strict=True)):
        data.qpos[qpos], data.qvel[dof], data.qacc[dof] = q, dq, ddq
        mujoco.mj_inverse(free, data)
        torque[k] = data.qfrc_inverse[dof]
        for i, body in enumerate(held):
            position[k, i], quaternion[k, i] = hand.pose(t, data.xpos[body], data.xquat[body])
    return desired[0] + (kv * desired[1] + torque) / kp, position, quaternion


def _held_bodies(model: mujoco.MjModel) -> list[int]:
    """For each mocap body, in MuJoCo's order, the body that a weld ties to it."""
    welds = model.eq_type == mujoco.mjtEq.mjEQ_WELD
    ties = dict(zip(model.eq_obj2id[welds].tolist(), model.eq_obj1id[welds].tolist(), strict=True))
    held = []
    for mocap in range(model.nmocap):
        body = int(np.flatnonzero(model.body_mocapid == mocap)[0])
        if body not in ties:
            raise ValueError(f"Mocap body '{model.body(body).name}' needs a weld whose body1 is what it holds.")
        held.append(ties[body])
    return held
