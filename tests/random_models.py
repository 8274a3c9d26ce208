"""Random MuJoCo models with all kinds of joints, and their states; and an arm with drives."""

import mujoco
import numpy as np
from mechanisms import unit_vector

import scenes

ARM = """
<mujoco><option><flag contact="disable"/></option><worldbody>
  <body name="base"><geom size=".1" density="500"/><site name="ground"/>
  <body name="upper" pos="0 0 .3"><joint name="shoulder" axis="0 1 0" armature=".05" damping=".4"/>
    <geom type="capsule" fromto="0 0 0 .3 0 0" size=".04"/>
  <body name="lower" pos=".3 0 0"><joint name="elbow" axis="0 0 1" armature=".02" damping=".2"/>
    <geom type="capsule" fromto="0 0 0 .25 .05 0" size=".03"/></body></body></body></worldbody>
<sensor><force site="ground"/><torque site="ground"/></sensor></mujoco>
"""
CHAINS = ([], ["hinge"], ["slide"], ["ball"], ["hinge", "hinge"], ["slide", "hinge"], ["slide", "slide", "ball"])
"""Joints of one body, the first next to its parent; MuJoCo allows no hinge beside a ball."""

CLASSES = """
<default><joint damping=".4" armature=".2"/>
  <default class="dry"><joint frictionloss=".3"/>
    <default class="sprung"><joint stiffness="2" springref="-.4"/></default>
  </default>
  <default class="tuned"><joint springdamper=".3 .7" armature="1.5"/></default>
</default>
"""
"""Classes of driven joints."""


def numbers(x):
    return " ".join(map(repr, np.asarray(x, float).tolist()))


def drive_attributes(rng, kind):
    """A class, numbers of its own, or both, for a joint."""
    stated = {
        "class": str(rng.choice(["dry", "sprung", "tuned"])),
        "damping": f"{rng.uniform(0, 1):.3f}",
        "frictionloss": f"{rng.uniform(0, 1):.3f}",
        "armature": f"{rng.uniform(0.1, 1):.3f}",
        "stiffness": f"{rng.uniform(0, 5):.3f}",
        **({"springref": f"{rng.normal():.3f}"} if kind in ("hinge", "slide") else {}),
    }
    return "".join(f' {key}="{value}"' for key, value in stated.items() if rng.random() < 0.5)


def random_model(rng, bodies, floating=False, drives=None):
    """Random axes, anchors and references, turned body and inertial frames, branches, welded bodies."""

    def driven(kind):
        return drive_attributes(drives, kind) if drives else ""

    def joint(name, kind):
        axis = f' axis="{numbers(unit_vector(rng))}" ref="{rng.normal():.3f}"' if kind != "ball" else ""
        position = f' pos="{numbers(rng.normal(size=3))}"'
        return f'<joint name="{name}" type="{kind}"{position}{axis}{driven(kind)}/>'

    def body(i):
        chain = CHAINS[rng.choice(len(CHAINS), p=[0.15, 0.3, 0.15, 0.1, 0.1, 0.1, 0.1])] if i else []
        joints = "".join(joint(f"j{i}{'abc'[k]}", kind) for k, kind in enumerate(chain))
        if i == 0:
            joints = f'<joint type="free" name="root"{driven("free")}/>' if floating else '<site name="ground"/>'
        principal = np.sort(rng.uniform(0.002, 0.02, 3))
        principal[2] = min(principal[2], 0.9 * (principal[0] + principal[1]))
        children = "".join(body(k) for k in range(1, bodies) if parents[k] == i)
        return (
            f'<body name="b{i}" pos="{numbers(rng.normal(size=3))}" quat="{numbers(rng.normal(size=4))}">{joints}'
            f'<inertial mass="{rng.uniform(0.1, 5)!r}" pos="{numbers(rng.normal(size=3))}" '
            f'quat="{numbers(rng.normal(size=4))}" diaginertia="{numbers(principal)}"/>{children}</body>'
        )

    parents = [-1] + [int(rng.integers(0, k)) for k in range(1, bodies)]
    sensors = "" if floating else '<force site="ground"/><torque site="ground"/>'
    classes = CLASSES if drives else ""
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian"/>{classes}<option gravity="{numbers(3 * rng.normal(size=3))}"/>'
        f"<worldbody>{body(0)}</worldbody><sensor>{sensors}</sensor></mujoco>"
    )


def random_model_states(rng, model, samples):
    """qpos with unit quaternions, qvel and qacc."""
    qpos = rng.uniform(-2, 2, size=(samples, model.nq))
    for k in range(samples):
        mujoco.mj_normalizeQuat(model, qpos[k])
    return qpos, rng.uniform(-2, 2, size=(samples, model.nv)), rng.uniform(-2, 2, size=(samples, model.nv))


def inverse_dynamics(model, qpos, qvel, qacc):
    """MuJoCo's forces (N, nv) and sensor readings (N, nsensordata); joints after those of the motion rest."""
    data, n = mujoco.MjData(model), qvel.shape[1]
    forces, readings = np.empty((len(qpos), model.nv)), np.empty((len(qpos), model.nsensordata))
    for k in range(len(qpos)):
        data.qpos[: qpos.shape[1]], data.qvel[:n], data.qacc[:n] = qpos[k], qvel[k], qacc[k]
        mujoco.mj_inverse(model, data)
        forces[k], readings[k] = data.qfrc_inverse, data.sensordata
    return forces, readings


def forces_between(model, before, now, after, step):
    """MuJoCo's forces (nv,) at a configuration, whose rates are differences to those a step before and after, s."""
    rates = np.zeros((2, model.nv))
    mujoco.mj_differentiatePos(model, rates[0], step, before, now)
    mujoco.mj_differentiatePos(model, rates[1], step, now, after)
    return inverse_dynamics(model, now[None], rates.mean(axis=0)[None], np.diff(rates, axis=0) / step)[0][0]


def humanoid():
    model = scenes.load("humanoid").compile()
    model.opt.disableflags |= int(mujoco.mjtDisableBit.mjDSBL_CONTACT)
    model.jnt_stiffness[:], model.dof_damping[:] = 0, 0
    return model
