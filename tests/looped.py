"""Mechanisms with loops, drawn by hand in MJCF, and their dynamics by MuJoCo's constraint Jacobian."""

from functools import cache

import mujoco
import numpy as np
from scipy.linalg import null_space
from scipy.spatial.transform import Rotation

import sim
from ident.mechanism.mechanism import Mechanism

INERTIAL = '<inertial mass="{}" pos="0.02 {} 0.05" diaginertia="1e-3 1.2e-3 8e-4"/>'


def body(name, joint, pos, mass, inner="", axis="0 1 0", more=""):
    """A link on a hinge, or a slide, with others on it."""
    return (
        f'<body name="{name}" pos="{pos}"><joint name="{joint}" axis="{axis}" {more}/>'
        f"{INERTIAL.format(mass, 0.01 * mass)}{inner}</body>"
    )


def text(links, equality, more=""):
    return (
        '<mujoco><compiler angle="radian"/><worldbody><body name="base"><geom size=".02" mass="1"/><site name="foot"/>'
        f"{links}</body></worldbody><equality>{equality}</equality>{more}"
        '<sensor><force site="foot"/><torque site="foot"/></sensor></mujoco>'
    )


CRANK = body("crank", "crank", "0 0 0.1", 0.5, body("rod", "rod", "0 0 0.1", 0.8))
ROCKER = body("rocker", "rocker", "0.25 0 0.1", 0.7)
PIN = '<connect name="pin" body1="rod" body2="rocker" anchor="0.3 0 0.12"/>'
FOUR_BAR = text(CRANK + ROCKER, PIN)

_SIDES = CRANK + body("right", "right", "0.2 0 0.1", 0.5, body("arm", "arm", "0 0 0.15", 0.6))
FIVE_BAR = text(_SIDES, '<connect name="tip" body1="rod" body2="arm" anchor="0.1 0 0.2"/>')

# Of the rod, one half is on the crank and one on the rocker.
WELDED = text(
    CRANK + body("rocker", "rocker", "0.25 0 0.1", 0.7, body("half", "half", "0.05 0 0.15", 0.3)),
    '<weld name="joined" body1="rod" body2="half"/>',
)
SLIDER = text(
    CRANK + body("piston", "piston", "0.25 0 0", 0.4, axis="1 0 0", more='type="slide"'),
    '<connect name="pin" body1="rod" body2="piston" anchor="0.15 0 0.1"/>',
)
# A crank in a plane that turns with its carrier, and a link that follows it.
TURNED = text(
    body("turret", "yaw", "0 0 0.05", 1, CRANK + ROCKER + body("flap", "flap", "0.1 0 0", 0.3), axis="0 0 1"),
    '<connect name="pin" body1="rod" body2="rocker" anchor="0.25 0 0.07"/>'
    '<joint name="gear" joint1="flap" joint2="rocker" polycoef="0.1 -1.5 0.3 0 0"/>',
)
TENDONS = text(
    CRANK + ROCKER,
    '<tendon name="sum" tendon1="both" tendon2="third" polycoef="0.05 0.7 0.2 0 0"/>',
    '<tendon><fixed name="both"><joint joint="crank" coef="0.6"/><joint joint="rod" coef="0.9"/></fixed>'
    '<fixed name="third"><joint joint="rocker" coef="1"/></fixed></tendon>',
)
# Sums of joints alone: a differential, and a joint that follows one of its outputs.
SUMS = text(
    CRANK + ROCKER + body("flap", "flap", "0.1 0 0", 0.3),
    '<tendon name="sum" tendon1="both" tendon2="third" polycoef="0.05 0.7 0 0 0"/>'
    '<joint name="gear" joint1="flap" joint2="rod" polycoef="0.1 -1.5 0 0 0"/>',
    '<tendon><fixed name="both"><joint joint="crank" coef="0.6"/><joint joint="rod" coef="0.9"/></fixed>'
    '<fixed name="third"><joint joint="rocker" coef="1"/></fixed></tendon>',
)


def _finger(side, sign):
    """A finger that stays parallel: a driver, the finger on it, and a link behind."""
    return (
        body(f"{side}_driver", f"{side}_driver", f"{sign * 0.02} 0 0.05", 0.05,
             body(f"{side}_finger", f"{side}_finger", f"{sign * 0.03} 0 0.04", 0.08), axis=f"0 {sign} 0")
        + body(f"{side}_link", f"{side}_link", f"{sign * 0.005} 0 0.06", 0.03, axis=f"0 {sign} 0")
    )  # fmt: skip


def _pin(side, sign):
    anchor = f"{-sign * 0.015} 0 0.01"
    return f'<connect name="{side}_pin" body1="{side}_finger" body2="{side}_link" anchor="{anchor}"/>'


GRIPPER_LINKS = _finger("left", -1) + _finger("right", 1)
GRIPPER_EQUALITY = (
    _pin("left", -1) + _pin("right", 1) + '<joint name="same" joint1="right_driver" joint2="left_driver"/>'
)
GRIPPER = text(GRIPPER_LINKS, GRIPPER_EQUALITY)

PARALLELOGRAM = text(
    CRANK + body("rocker", "rocker", "0.25 0 0.1", 0.7),
    '<connect name="pin" body1="rod" body2="rocker" anchor="0.25 0 0"/>',
)

# Springs, dampers and rotors of passive joints.
DRIVEN = FOUR_BAR.replace('name="rod" axis', 'name="rod" damping="0.03" armature="0.002" axis').replace(
    'name="rocker" axis', 'name="rocker" damping="0.05" stiffness="0.7" springref="0.2" axis'
)


def _universal(name, pos, mass, inner=""):
    """A rod on two hinges at right angles."""
    return body(name, f"{name}_y", pos, mass, f'<joint name="{name}_x" axis="1 0 0"/>{inner}')


def _limb(k):
    """A limb of a Delta: an arm, and a forearm that ends on the platform."""
    angle = 2 * np.pi * k / 3
    arm = body(f"arm{k}", f"arm{k}", "0 0 0", 0.4, _universal(f"forearm{k}", "0.2 0 0", 0.2))
    return f'<body pos="{0.2 * np.cos(angle):.17g} {0.2 * np.sin(angle):.17g} 0" euler="0 0 {angle:.17g}">{arm}</body>'


_DOWN = float(np.sqrt(0.5**2 - 0.35**2))
DELTA = text(
    "".join(map(_limb, range(3)))
    + body("platform", "x", f"0 0 {-_DOWN!r}", 0.3, axis="1 0 0", more='type="slide"', inner=(
        '<joint name="y" type="slide" axis="0 1 0"/><joint name="z" type="slide" axis="0 0 1"/>')),
    "".join(
        f'<connect name="tip{k}" body1="forearm{k}" body2="platform" anchor="-0.35 0 {-_DOWN!r}"/>' for k in range(3)
    ),
)  # fmt: skip
"""A Delta, whose platform only shifts, with forearms of single rods."""

# As of Cassie: a rod from the thigh to the heel bends the tarsus with the knee, and a crank on the tarsus the foot.
LEG = text(
    body("thigh", "hip", "0 0 0", 1.5, axis="0 1 0", inner=(
        body("shin", "knee", "0 0 -0.3", 0.8, inner=body("tarsus", "tarsus", "0 0 -0.3", 0.5, inner=(
            body("crank", "crank", "0 0 -0.05", 0.1, inner=body("link", "link", "-0.05 0 0.01", 0.1))
            + body("foot", "foot", "0 0 -0.3", 0.3))))
        + _universal("rod", "-0.05 0.02 -0.05", 0.2))),
    '<connect name="heel" body1="rod" body2="tarsus" anchor="-0.01 -0.02 -0.53"/>'
    '<connect name="plantar" body1="link" body2="foot" anchor="0 0 -0.25"/>',
)  # fmt: skip
# As of Digit: two cranks pitch and roll a foot by rods.
_CRANKS = "".join(
    body(f"crank{k}", f"crank{k}", f"0 {y} -0.1", 0.1, _universal(f"rod{k}", "-0.05 0 0", 0.1))
    for k, y in enumerate((-0.04, 0.04))
)
_FOOT = body("foot", "pitch", "0 0 -0.3", 0.4, '<joint name="roll" axis="1 0 0"/>')
ANKLE = text(
    body("shin", "shin", "0 0 0", 1.0, _CRANKS + _FOOT, axis="1 0 0"),
    "".join(f'<connect name="end{k}" body1="rod{k}" body2="foot" anchor="0 0 -0.2"/>' for k in range(2)),
)


def _slender(name, pos, end, mass):
    """A slender rod on a ball joint, whose spin about itself changes nothing."""
    x = np.array(end)
    own = 1e-10 * np.eye(3) + mass / 12 * (x @ x * np.eye(3) - np.outer(x, x))
    inertia, centre = (" ".join(map(repr, map(float, y))) for y in (own[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]], x / 2))
    return (
        f'<body name="{name}" pos="{pos}"><joint name="{name}" type="ball"/>'
        f'<inertial mass="{mass}" pos="{centre}" fullinertia="{inertia}"/></body>'
    )


# Rods between balls, as of Cassie and of a spatial four-bar; and a body on a ball that is welded to another limb.
ROD_ON_BALLS = LEG.replace(
    _universal("rod", "-0.05 0.02 -0.05", 0.2), _slender("rod", "-0.05 0.02 -0.05", (-0.01, -0.02, -0.53), 0.2)
)
SPATIAL = text(
    body("crank", "crank", "0 0 0.1", 0.5, _slender("rod", "0 0 0.1", (0.3, 0.03, 0.12), 0.8))
    + body("rocker", "rocker", "0.25 0.05 0.1", 0.7, axis="0.3 0.93 0.2"),
    '<connect name="pin" body1="rod" body2="rocker" anchor="0.3 0.03 0.12"/>',
)
SPHERICAL = text(
    CRANK.replace('name="rod" axis="0 1 0"', 'name="rod" type="ball"')
    + body("rocker", "rocker", "0.25 0 0.1", 0.7, _universal("half", "0.05 0 0.15", 0.3), axis="0.1 1 0"),
    '<weld name="joined" body1="rod" body2="half"/>',
)

MODELS = {
    "rod on balls": (ROD_ON_BALLS, ("hip", "knee", "crank")),
    "spatial": (SPATIAL, ("crank",)),
    "spherical": (SPHERICAL, ("crank",)),
    "delta": (DELTA, ("arm0", "arm1", "arm2")),
    "leg": (LEG, ("hip", "knee", "crank")),
    "ankle": (ANKLE, ("shin", "crank0", "crank1")),
    "four-bar": (FOUR_BAR, ("crank",)),
    "five-bar": (FIVE_BAR, ("crank", "right")),
    "welded": (WELDED, ("crank",)),
    "slider": (SLIDER, ("crank",)),
    "turned": (TURNED, ("yaw", "crank")),
    "tendons": (TENDONS, ("crank", "rocker")),
    "sums": (SUMS, ("crank", "rocker")),
    "gripper": (GRIPPER, ("left_driver",)),
    "driven": (DRIVEN, ("crank",)),
}
"""Mechanisms with the joints that are driven."""


def read(model: str, **options) -> Mechanism:
    return sim.mechanism(mujoco.MjSpec.from_string(model), **options)


@cache
def opened(name: str) -> Mechanism:
    """A mechanism of `MODELS` before its loops are closed."""
    return read(MODELS[name][0])


def closed(name: str) -> Mechanism:
    arm, driven = opened(name), MODELS[name][1]
    arm = arm.following({joint: lead for joint, lead in arm.mimics.items() if lead.joint in driven})
    return arm.closed([joint for joint in arm.tree.joints if joint not in driven], driven)


def whole_states(before, arm, states):
    """States of all joints of the tree before closure, in MuJoCo's order, from those of the independent ones (N, n).

    A ball's are those of the hinges in its place, after one another.
    """
    tree = arm.tree
    own = dict(zip((body.name for body in tree.bodies), tree.body_states(*states), strict=True))
    out = ([], [], [])
    for body in (before.bodies[i] for i in before.moving):
        if not body.is_ball:
            parts = own[body.name]
        else:
            parts = [np.tile([1.0, 0, 0, 0], (len(states[0]), 1)), *np.zeros((2, len(states[0]), 3))]
            for hinge in (each for each in tree.bodies if each.depends.startswith(f"{body.joint}.")):
                parts = _turned(parts, hinge.twist[3:], own[hinge.name])
        for column, x in zip(out, parts, strict=True):
            column.append(x)
    return tuple(np.concatenate(columns, axis=1) for columns in out)


def _turned(states, axis, hinge):
    """Quaternion, angular velocity and its rate in a body's frame, of a body on a hinge on another (N, …)."""
    turn = Rotation.from_rotvec(hinge[0] * axis)
    q = (Rotation.from_quat(states[0], scalar_first=True) * turn).as_quat(scalar_first=True)
    before, rate, own = turn.inv().apply(states[1]), turn.inv().apply(states[2]), hinge[1] * axis
    return q, before + own, rate - np.cross(own, before) + hinge[2] * axis


def by_mujoco(name, arm, states):
    """Gaps and rates of the constraints (N, m), torques of the driven joints (N, n), wrenches at the base (N, 6).

    The torques follow by virtual work from those of a tree, along the null space of MuJoCo's constraint Jacobian; the
    accelerations, without those of rods that may spin, are those that the constraint forces, from Lagrange's
    multipliers, leave with these torques.
    """
    model = mujoco.MjModel.from_xml_string(MODELS[name][0])
    data, driven = mujoco.MjData(model), [int(model.joint(joint).dofadr[0]) for joint in arm.tree.joints]
    gaps, rates, torques, wrenches, accelerations = [], [], [], [], []
    n, turning = len(driven), np.isin(model.jnt_type[model.dof_jntid], int(mujoco.mjtJoint.mjJNT_BALL))
    before, size = opened(name).tree, (len(states[0]), 1)
    along = [whole_states(before, arm, (states[0], np.tile(e, size), 0 * states[2]))[1] for e in np.eye(n)]

    def jacobian(q, dq=None, step=0.0):
        data.qpos[:] = q
        if dq is not None:
            mujoco.mj_integratePos(model, data.qpos, dq, step)
        mujoco.mj_fwdPosition(model, data)
        J = data.efc_J.reshape(data.nefc, -1).copy()
        equalities = data.efc_type == int(mujoco.mjtConstraint.mjCNSTR_EQUALITY)
        return J[equalities], data.efc_pos[equalities].copy()

    for k, (q, dq, ddq) in enumerate(zip(*whole_states(before, arm, states), strict=True)):
        step = 1e-5
        dJ = (jacobian(q, dq, step)[0] - jacobian(q, dq, -step)[0]) / (2 * step)
        J, gap = jacobian(q)
        Z = null_space(J, rcond=1e-9)
        not_spinning = ~turning | (Z.shape[1] == n)
        if Z.shape[1] == n:
            Z = Z @ np.linalg.inv(Z[driven])
        else:
            # A rod between balls spins, so that our motion has to be one of those that are free.
            own = np.stack([x[k] for x in along], axis=1)
            assert abs(Z @ (Z.T @ own) - own).max() < 1e-9
            Z = own
        model.opt.disableflags = int(mujoco.mjtDisableBit.mjDSBL_EQUALITY)
        data.qpos[:], data.qvel[:], data.qacc[:] = q, dq, ddq
        mujoco.mj_inverse(model, data)
        model.opt.disableflags = 0
        tau = Z.T @ data.qfrc_inverse
        wrenches.append(data.sensordata.copy())
        M = np.zeros((model.nv, model.nv))
        for column, unit in zip(M, np.eye(model.nv), strict=True):
            mujoco.mj_mulM(model, data, column, unit)
        force = np.zeros(model.nv)
        force[driven] = tau
        system = np.block([[M, J.T], [J, np.zeros((len(J), len(J)))]])
        right = np.concatenate([force + data.qfrc_passive - data.qfrc_bias, -dJ @ dq])
        accelerations.append(np.linalg.lstsq(system, right, rcond=1e-11)[0][: model.nv] - ddq)
        accelerations[-1] *= not_spinning
        gaps.append(gap)
        rates.append(J @ dq)
        torques.append(tau)
    return tuple(map(np.array, (gaps, rates, torques, wrenches, accelerations)))
