"""Servos and hands of a scene, and the commands with which they follow a desired motion."""

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from ident.errors import ModelError
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.model.regressor import joint_torque_regressor
from ident.model.tape import Program, Tape
from sim.models.couplings import couplings
from sim.models.model_mechanism import mechanism
from sim.models.mujoco_model import rest_coordinates
from sim.models.notes import body_name, joint_name
from sim.simulation.readings import ONE_DOF

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
        tree, tape, T = self.mechanism.tree, Tape(len(self.order)), np.zeros((16, len(q)))
        program = Program.of(tape, tree.poses(np.array(tape.inputs))[tree.names.index(body)].ravel().tolist())
        program.fill(T)
        program.run(q[:, self.order].T, T)
        poses = T.T.reshape(-1, 4, 4)
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
