"""Recordings of a scene along an excitation, by MuJoCo's forward dynamics and the scene's servos."""

import hashlib
import os
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from ident.annotations import typed
from ident.arguments import described, is_number
from ident.errors import InputError, ModelError
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.model.regressor import joint_torque_regressor
from ident.recordings.recording import Recording
from sim.models.couplings import couplings
from sim.models.model_mechanism import mechanism
from sim.models.mujoco_model import rest_coordinates
from sim.models.notes import body_name, joint_name, refusals
from sim.motion.excitation import DesiredMotion
from sim.simulation.readings import ONE_DOF, QUATERNION, play, sensors, steps_per_sample

LIFT = np.array([0.0, 0.0, 0.02])
"""Constant displacement of a hand from the desired pose of the held body, m; upwards it supports the arm."""

SHIFT, TURN = (0.01, (0.31, 0.43, 0.53)), (0.03, (0.37, 0.47, 0.61))
"""Amplitude and frequencies, Hz, of slow deviations: of the displacement along the world's axes, m, and of the rotation
vector in the axes of the held body, rad."""


@dataclass(frozen=True, eq=False)
class Servos:
    """The position servos of a scene; the i-th one follows the i-th column of a motion.

    Attributes:
        model: The compiled scene.
        qpos: Addresses of the driven joints' positions (n,).
        dof: Addresses of their velocities (n,).
        mechanism: All bodies, with only the driven joints moving and the others in the reference configuration.
        order: Columns of a motion in the order of the mechanism's joints (n,).
        held: For each mocap body, in MuJoCo's order, the name of the body that is connected to it by a weld.
    """

    model: mujoco.MjModel
    qpos: np.ndarray
    dof: np.ndarray
    mechanism: Mechanism
    order: list[int]
    held: tuple[str, ...]

    def commands(self, time: np.ndarray, desired: Motion) -> np.ndarray:
        """Commands for a desired motion.

        A position servo's force `kp (u - q) - kv q̇` becomes a computed torque τ plus feedback,
        `τ + kp (q_d - q) + kv (q̇_d - q̇)`, by the command `u = q_d + (kv q̇_d + τ) / kp`; τ is the torque for the desired
        motion of the mechanism without contacts. A hand is a mocap body; it follows the desired pose of the held body.

        Args:
            time: Times, s (N,).
            desired: Motion of the driven joints at these times.

        Returns:
            Rows of `sim.simulation.readings.COMMAND` (N, nu + 7 nmocap).
        """
        q, dq = desired.q, desired.dq
        kp, kv = self.model.actuator_gainprm[:, 0], -self.model.actuator_biasprm[:, 2]
        position = q + (kv * dq + self.torques(desired)) / kp
        poses = [held_by(time, *self.poses(body, q)) for body in self.held]
        return np.concatenate([position, *(p for p, _ in poses), *(r for _, r in poses)], axis=1)

    def torques(self, desired: Motion) -> np.ndarray:
        """Torques for a motion without contacts, including those of links, rotors, dampers and springs (N, n)."""
        q, dq, ddq = desired.states
        model, joints = self.model, self.model.dof_jntid[self.dof]
        drives = model.dof_armature[self.dof] * ddq + model.dof_damping[self.dof] * dq
        springs = model.jnt_stiffness[joints] * (q - model.qpos_spring[self.qpos])
        phi, states = self.mechanism.known, (x[:, self.order] for x in desired.states)
        nonzero = np.flatnonzero(phi)
        Y = joint_torque_regressor(
            self.mechanism.tree, *states, gravity=self.mechanism.gravity, columns=nonzero.tolist()
        )
        links = np.empty_like(q)
        links[:, self.order] = Y @ phi[nonzero]
        return links + drives + springs

    def poses(self, body: str, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Positions, m (N, 3), and quaternions, w, x, y, z (N, 4), of a body in the world."""
        tree = self.mechanism.tree
        poses = tree.poses(q[:, self.order])[:, tree.names.index(body)]
        return poses[:, :3, 3], Rotation.from_matrix(poses[:, :3, :3]).as_quat(scalar_first=True)


def held_by(time: np.ndarray, position: np.ndarray, quaternion: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Positions and quaternions of a hand, from the desired ones of the held body (N, 3) and (N, 4)."""
    shift, turn = (size * np.sin(2 * np.pi * np.outer(time, frequencies)) for size, frequencies in (SHIFT, TURN))
    turned = Rotation.from_quat(quaternion, scalar_first=True) * Rotation.from_rotvec(turn)
    return position + LIFT + shift, turned.as_quat(scalar_first=True)


def servos(model: mujoco.MjModel, joints: int) -> Servos:
    """The servos of a scene, which must drive a given number of joints.

    Raises:
        ModelError: The scene has other actuators than that number of position servos on hinges or slides, or a mocap
            body without a weld.
    """
    is_position = (model.actuator_gainprm[:, 0] > 0) & (model.actuator_biasprm[:, 1] == -model.actuator_gainprm[:, 0])
    on_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    ids = model.actuator_trnid[:, 0]
    if model.nu != joints or not (is_position & on_joint).all() or not np.isin(model.jnt_type[ids], ONE_DOF).all():
        raise ModelError(
            f"An excitation of {joints} joints needs as many position servos, the scene has {model.nu} actuators."
        )
    return moved_by(model, ids)


def moved_by(model: mujoco.MjModel, joints: Sequence[int]) -> Servos:
    """Servos on some hinges and slides, by their ids; all other joints stay in the reference configuration."""
    free = mechanism(model, beyond=(), ignore=[coupling.name for coupling in couplings(model)], drives=False)
    rest, names = rest_coordinates(model, beyond=()), [joint_name(model, j) for j in joints]
    moved = free.fixed({name: q for name, q in rest.items() if name not in names})
    order = [names.index(joint) for joint in moved.tree.joints]
    qpos, dof = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
    return Servos(model, qpos, dof, moved, order, _held(model))


def _held(model: mujoco.MjModel) -> tuple[str, ...]:
    welds = model.eq_type == mujoco.mjtEq.mjEQ_WELD
    ties = dict(zip(model.eq_obj2id[welds].tolist(), model.eq_obj1id[welds].tolist(), strict=True))
    held = []
    for mocap in range(model.nmocap):
        body = int(np.flatnonzero(model.body_mocapid == mocap)[0])
        if not ties.get(body):
            raise ModelError(f"Mocap body '{body_name(model, body)}' needs a weld whose body1 is what it holds.")
        held.append(body_name(model, ties[body]))
    return tuple(held)


RATE = 100.0
"""Default of the samples per second of a recording."""

SAMPLES = 943
"""Samples of the paper's recordings: 4715 / 5 and 5658 / 6 rows."""

LONGEST = 1_000_000
"""Largest number of samples of a recording: desired motions and readings of all steps are in memory."""

LEAD_IN = 1.0
"""Seconds of motion before the recording starts, for servos and contacts to settle."""


@typed("noise_scale")
def simulate(
    spec: mujoco.MjSpec,
    excitation: DesiredMotion,
    *,
    samples: int = SAMPLES,
    seed: int = 0,
    noise_scale: float = 1.0,
    rate: float = RATE,
) -> Recording:
    """Simulates a scene along an excitation and records all its sensors.

    Every servo must be a position actuator; the i-th one follows the i-th column of the excitation.

    Args:
        spec: The scene.
        excitation: Desired joint motion, with its acceleration noise.
        samples: Number of samples N.
        seed: Seed of the excitation's and of the sensors' noise.
        noise_scale: Factor on both kinds of noise; zero records the true values.
        rate: Samples per second, Hz; the scene's timestep must divide the time between samples.

    Returns:
        The recording, including true values. Its provenance has the scene's hash, the excitation, all other arguments
        and the largest tracking error.

    Raises:
        ModelError: MuJoCo cannot compile the scene, or it has other actuators or sensors than needed.
        InputError: An argument does not fit, or the servos fail to follow the excitation.
    """
    return simulate_many(spec, excitation, seeds=[seed], samples=samples, noise_scale=noise_scale, rate=rate)[0]


@typed("noise_scale")
def simulate_many(
    spec: mujoco.MjSpec,
    excitation: DesiredMotion,
    *,
    seeds: Sequence[int],
    samples: int = SAMPLES,
    noise_scale: float = 1.0,
    rate: float = RATE,
    threads: int | None = None,
) -> list[Recording]:
    """The recordings of `simulate` with several seeds, identical to the bit, in MuJoCo's thread pool.

    Args:
        spec: The scene.
        excitation: Desired joint motion, with its acceleration noise.
        seeds: A seed for each recording.
        samples: Number of samples N.
        noise_scale: Factor on all noise.
        rate: Samples per second, Hz.
        threads: Number of threads, by default one for each processor.

    Raises:
        ModelError: As for `simulate`.
        InputError: As for `simulate`, or the number of threads is not positive.
    """
    if not hasattr(excitation, "trajectory"):
        raise InputError(f"excitation needs a desired motion, as an Excitation; got {described(excitation)}.")
    threads = (os.cpu_count() or 1) if threads is None else threads
    if not 1 <= samples <= LONGEST:
        raise InputError(f"A recording needs 1 to {LONGEST} samples, got {samples}.")
    loudest = 1000
    if not (is_number(noise_scale) and 0 <= noise_scale <= loudest):
        raise InputError(f"The noise scale must be from 0 to {loudest}, got {described(noise_scale)}.")
    if wrong := [seed for seed in seeds if seed < 0]:
        raise InputError(f"A seed is a whole number from zero, got {wrong[0]}.")
    if threads < 1:
        raise InputError(f"A simulation needs at least one thread, got {threads}.")
    with refusals("The scene"):
        model = spec.compile()
    scene = {"scene": spec.modelname, "scene_sha256": hashlib.sha256(spec.to_xml().encode()).hexdigest()}
    settings = {"excitation": {key: np.asarray(x).tolist() for key, x in vars(excitation).items()}, "rate_hz": rate}
    disturbed = excitation.with_noise(noise_scale)
    recordings = []
    # The steps of as many simulations as there are threads are in memory, some 4 MB each.
    for first in range(0, len(seeds), threads):
        batch = seeds[first : first + threads]
        generators = [np.random.default_rng(seed).spawn(2) for seed in batch]
        runs = _runs(model, disturbed, (samples, rate), [rng for rng, _ in generators], len(batch))
        for seed, (_, rng), readings, error in zip(batch, generators, *runs, strict=True):
            given = {"samples": samples, "seed": int(seed), "noise_scale": noise_scale}
            origin = scene | settings | given | {"tracking_error_rad": float(error)}
            recordings.append(with_noise(_exact(model, readings, rate, noise_scale, origin), rng))
    return recordings


def _exact(
    model: mujoco.MjModel, readings: np.ndarray, rate: float, noise_scale: float, provenance: dict[str, Any]
) -> Recording:
    """Recording of all sensors without noise, from their readings (N, nsensordata)."""
    declared = sensors(model)
    true = {s.name: readings[:, s.part.start] if s.is_scalar else readings[:, s.part] for s in declared}
    return Recording(
        time=np.arange(len(readings)) / rate,
        measured=true,
        true=true,
        units={s.name: s.unit for s in declared},
        noise={s.name: noise_scale * s.noise for s in declared},
        provenance=provenance,
    )


def with_noise(recording: Recording, rng: np.random.Generator) -> Recording:
    """The recording with new random noise of its sensors around the true values.

    Noise is Gaussian and white, and zero for channels without a known level. An orientation is rotated by a random
    rotation vector in its own axes.
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


def _runs(
    model: mujoco.MjModel,
    excitation: DesiredMotion,
    sampling: tuple[int, float],
    rngs: Sequence[np.random.Generator],
    threads: int,
) -> tuple[np.ndarray, np.ndarray]:
    """Sensor readings (B, N, nsensordata) and largest tracking errors in rad (B,), one run for each generator."""
    samples, rate = sampling
    steps, lead = steps_per_sample(model, rate), round(LEAD_IN / model.opt.timestep)
    driven = servos(model, excitation.joints)
    instants = lead + steps * np.arange(samples)
    time = np.arange(-lead, instants[-1] - lead + 1) * model.opt.timestep
    desired = [Motion(*excitation.trajectory(time, rng)) for rng in rngs]
    qpos, qvel = np.tile(model.qpos0, (len(rngs), 1)), np.zeros((len(rngs), model.nv))
    qpos[:, driven.qpos], qvel[:, driven.dof] = [x.q[0] for x in desired], [x.dq[0] for x in desired]
    commands = np.stack([driven.commands(time, motion) for motion in desired])
    read = play(model, qpos, qvel, commands, instants, threads=threads)
    errors = abs(read.qpos[..., driven.qpos] - [x.q[instants] for x in desired])
    error = errors.max(axis=-1)
    # Servos that lag by more, rad, are at a joint limit or a torque limit.
    followed = error <= 0.2
    if not followed.all():
        run, k = np.argwhere(~followed)[0]
        # If the simulation diverges all errors are NaN.
        joint = joint_name(model, int(model.actuator_trnid[int(errors[run, k].argmax()), 0]))
        who = f"The servo of joint '{joint}'" if np.isfinite(error[run, k]) else "The servos"
        raise InputError(
            f"{who} lost the excitation after {time[instants[k]]:.2f} s by {error[run, k]:.2f} "
            "rad: it must stay within the joint and torque limits; noise on its acceleration drifts off in long "
            "recordings."
        )
    for sensor in sensors(model):
        if sensor.dof is not None:
            read.sensordata[..., sensor.part.start] = read.qacc[..., sensor.dof]
    return read.sensordata, error.max(axis=1)
