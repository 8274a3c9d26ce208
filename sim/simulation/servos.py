"""Commands by which a scene's servos, and the hands in it, follow a desired motion."""

from dataclasses import dataclass

import mujoco
import numpy as np

from ident.errors import ModelError
from sim.models.names import body_name
from sim.simulation.hand import Hand
from sim.simulation.inverse_dynamics import Chain, chain
from sim.simulation.sensors import ONE_DOF

Motion = tuple[np.ndarray, np.ndarray, np.ndarray]
"""Positions, velocities and accelerations of the driven joints (N, n)."""


@dataclass(frozen=True, eq=False)
class Servos:
    """The position servos of a scene; the i-th one follows the i-th column of a motion.

    Attributes:
        model: The compiled scene.
        qpos: Addresses of the driven joints' positions (n,).
        dof: Addresses of their velocities (n,).
        chain: What the joints move.
        held: For each mocap body, in MuJoCo's order, the body that a weld ties to it.
    """

    model: mujoco.MjModel
    qpos: np.ndarray
    dof: np.ndarray
    chain: Chain
    held: tuple[int, ...]

    def commands(self, time: np.ndarray, desired: Motion) -> np.ndarray:
        """Commands for a desired motion.

        A position servo's force `kp (u - q) - kv q̇` becomes a computed torque τ plus feedback,
        `τ + kp (q_d - q) + kv (q̇_d - q̇)`, by the command `u = q_d + (kv q̇_d + τ) / kp`; τ is what the desired motion
        of the free mechanism needs. A hand is a mocap body; it follows the desired pose of the body that it is tied to.

        Args:
            time: Times, s (N,).
            desired: Motion at these times.

        Returns:
            Rows of `sim.simulation.rollout.COMMAND` (N, nu + 7 nmocap).
        """
        q, dq, _ = desired
        kp, kv = self.model.actuator_gainprm[:, 0], -self.model.actuator_biasprm[:, 2]
        position = q + (kv * dq + self.torques(desired)) / kp
        poses = [Hand().poses(time, *self.chain.poses(body, q - self.home)) for body in self.held]
        return np.concatenate([position, *(p for p, _ in poses), *(r for _, r in poses)], axis=1)

    def torques(self, desired: Motion) -> np.ndarray:
        """What a motion of the free mechanism needs: of its links, rotors, dampers and springs (N, n)."""
        q, dq, ddq = desired
        model, joints = self.model, self.model.dof_jntid[self.dof]
        drives = model.dof_armature[self.dof] * ddq + model.dof_damping[self.dof] * dq
        springs = model.jnt_stiffness[joints] * (q - model.qpos_spring[self.qpos])
        return self.chain.torques(q - self.home, dq, ddq) + drives + springs

    @property
    def home(self) -> np.ndarray:
        """Positions of the driven joints as the model draws them, rad or m (n,)."""
        return self.model.qpos0[self.qpos]


def servos(model: mujoco.MjModel, joints: int) -> Servos:
    """The servos that drive a number of joints.

    Raises:
        ModelError: The scene has other actuators than so many position servos on hinges or slides, or a mocap body
            that holds nothing.
    """
    is_position = (model.actuator_gainprm[:, 0] > 0) & (model.actuator_biasprm[:, 1] == -model.actuator_gainprm[:, 0])
    on_joint = model.actuator_trntype == mujoco.mjtTrn.mjTRN_JOINT
    ids = model.actuator_trnid[:, 0]
    if model.nu != joints or not (is_position & on_joint).all() or not np.isin(model.jnt_type[ids], ONE_DOF).all():
        raise ModelError(
            f"An excitation of {joints} joints needs as many position servos, the scene has {model.nu} actuators."
        )
    return Servos(model, model.jnt_qposadr[ids], model.jnt_dofadr[ids], chain(model, ids), _held(model))


def _held(model: mujoco.MjModel) -> tuple[int, ...]:
    welds = model.eq_type == mujoco.mjtEq.mjEQ_WELD
    ties = dict(zip(model.eq_obj2id[welds].tolist(), model.eq_obj1id[welds].tolist(), strict=True))
    held = []
    for mocap in range(model.nmocap):
        body = int(np.flatnonzero(model.body_mocapid == mocap)[0])
        if body not in ties:
            raise ModelError(f"Mocap body '{body_name(model, body)}' needs a weld whose body1 is what it holds.")
        held.append(ties[body])
    return tuple(held)
