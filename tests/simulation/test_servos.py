import mujoco
import numpy as np
import pytest
from random_models import inverse_dynamics

import scenes
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.servos import servos

TIME = np.arange(-20, 20) / 20
SERVO = '<position joint="j" kp="1"/>'


@pytest.fixture(params=[None, *scenes.CONTACTS, "pad handle"])
def model(request):
    return scenes.load("double_pendulum", tilt_deg=5, contact=request.param).compile()


def free(model):
    """The mechanism alone: MuJoCo's inverse dynamics would count contacts and limits in."""
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    return model


def states(model, driven, desired):
    full = np.tile(model.qpos0, (len(TIME), 1)), *np.zeros((2, len(TIME), model.nv))
    full[0][:, driven.qpos], full[1][:, driven.dof], full[2][:, driven.dof] = desired
    return full


def test_a_command_makes_the_servo_give_the_torque_that_the_desired_motion_needs(model):
    driven, desired = servos(model, 2), DOUBLE_PENDULUM.trajectory(TIME)
    commands = driven.commands(TIME, desired)
    needed, _ = inverse_dynamics(free(model), *states(model, driven, desired))
    data = mujoco.MjData(model)
    for k in range(len(TIME)):
        data.qpos[driven.qpos], data.qvel[driven.dof] = desired[0][k], desired[1][k]
        data.ctrl[:] = commands[k, : model.nu]
        mujoco.mj_forward(model, data)
        np.testing.assert_allclose(data.qfrc_actuator[driven.dof], needed[k, driven.dof], rtol=0, atol=1e-10)


@pytest.mark.parametrize("gravity", [0, int(mujoco.mjtDisableBit.mjDSBL_GRAVITY)])
def test_rotors_dampers_and_springs_take_torque_too(model, gravity):
    rng = np.random.default_rng(0)
    free(model).opt.disableflags |= gravity
    model.dof_armature[:], model.dof_damping[:] = rng.uniform(0.1, 2, size=(2, model.nv))
    model.jnt_stiffness[:], model.qpos_spring[:] = rng.uniform(0.1, 2, size=(2, model.nq))
    driven, desired = servos(model, 2), DOUBLE_PENDULUM.trajectory(TIME)
    needed, _ = inverse_dynamics(model, *states(model, driven, desired))
    np.testing.assert_allclose(driven.torques(desired), needed[:, driven.dof], rtol=0, atol=1e-10)


def test_commands_come_in_the_order_of_the_actuators():
    spec = scenes.load("double_pendulum")
    straight = servos(spec.compile(), 2)
    spec.actuator("servo1").target, spec.actuator("servo2").target = "joint2", "joint1"
    crossed = servos(spec.compile(), 2)
    q, dq, ddq = DOUBLE_PENDULUM.trajectory(TIME)
    commands = crossed.commands(TIME, (q[:, ::-1], dq[:, ::-1], ddq[:, ::-1]))
    np.testing.assert_allclose(commands[:, ::-1], straight.commands(TIME, (q, dq, ddq)), rtol=0, atol=1e-12)


@pytest.mark.parametrize(("contact", "held"), [("handle", "load_cell"), ("pad handle", "load_cell_handle")])
def test_a_hand_goes_with_what_it_holds(contact, held):
    model = scenes.load("double_pendulum", contact=contact).compile()
    driven, desired = servos(model, 2), DOUBLE_PENDULUM.trajectory(TIME)
    position, quaternion = np.split(driven.commands(TIME, desired)[:, model.nu :], [3], axis=1)
    data = mujoco.MjData(model)
    for k in range(len(TIME)):
        data.qpos[driven.qpos] = desired[0][k]
        mujoco.mj_kinematics(model, data)
        cell = data.body(held)
        assert 0 < np.linalg.norm(position[k] - cell.xpos) < 0.04
        assert 0.99 < abs(quaternion[k] @ cell.xquat) <= 1 + 1e-12


@pytest.mark.parametrize(
    ("joint", "actuator"),
    [("hinge", '<motor joint="j"/>'), ("ball", '<position joint="j" kp="1"/>'), ("hinge", ""), ("hinge", 2 * SERVO)],
)
def test_servos_drive_one_hinge_or_slide_each(joint, actuator):
    body = f'<body><joint name="j" type="{joint}"/><geom size="1"/></body>'
    model = mujoco.MjModel.from_xml_string(
        f"<mujoco><worldbody>{body}</worldbody><actuator>{actuator}</actuator></mujoco>"
    )
    with pytest.raises(ValueError, match=f"1 joints needs as many position servos, the scene has {model.nu} act"):
        servos(model, 1)
