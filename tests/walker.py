"""A person of six bodies who stands on two plates and holds a rail: truth by MuJoCo's inverse dynamics."""

from functools import cache

import mujoco
import numpy as np
from mechanisms import sines

import sim
from ident.geometry.se3 import inverse, pose
from ident.recordings.wrench import transform_wrench

ROOT = ("tx", "ty", "tz", "yaw", "lean", "tilt")
MODEL = """
<mujoco><option gravity="0 0 -9.81"/><worldbody><body name="pelvis" pos="0 0 1">{root}
  <geom type="ellipsoid" size="0.1 0.16 0.25" pos="0.02 0 0.2" density="1100"/>{limbs}</body></worldbody></mujoco>
"""
LEGS = "".join(
    f"""<body name="thigh_{side}" pos="0 {y} 0"><joint name="hip_{side}" axis="0 1 0"/>
      <geom type="capsule" fromto="0 0 0 0.02 0 -0.42" size="0.06"/>
      <body name="foot_{side}" pos="0 0 -0.45"><joint name="knee_{side}" axis="{-y} 1 0"/>
        <geom type="capsule" fromto="0 0 0 0 0.01 -0.42" size="0.04"/></body></body>"""
    for side, y in (("r", -0.1), ("l", 0.1))
)
ARM = """<body name="arm" pos="0 -0.2 0.4"><joint name="shoulder" axis="0.3 1 0"/>
        <geom type="capsule" fromto="0 0 0 0.1 0 -0.5" size="0.03"/></body>"""
AXES = ("1 0 0", "0 1 0", "0 0 1", "0 0 1", "0 1 0", "1 0 0")
SLIDES = "".join(
    f'<joint name="{name}" type="{"slide" if k < 3 else "hinge"}" axis="{axis}"/>'
    for k, (name, axis) in enumerate(zip(ROOT, AXES, strict=True))
)
JOINTED, SMALL = (MODEL.format(root=SLIDES, limbs=limbs) for limbs in (LEGS + ARM, ARM))
TAKEN = {"right": "foot_r", "left": "foot_l", "rail": "arm"}  # Body on each plate and on the rail.


@cache
def mechanism(model=JOINTED):
    return sim.mechanism(mujoco.MjSpec.from_string(model))


@cache
def motion(samples=600, rate=100.0):
    rng, time = np.random.default_rng(0), np.arange(samples) / rate
    sizes = np.array([0.1, 0.1, 0.06, 0.3, 0.2, 0.2, 0.5, 0.4, 0.5, 0.4, 0.6])[:, None]
    size, phase = sizes * rng.uniform(0.2, 0.6, (11, 3)), rng.uniform(0, 6, (11, 3))
    w = rng.uniform(2, 8, (11, 3))
    return time, *sines(time, size, w, phase)


@cache
def truth(source=JOINTED):
    """Total wrench on the person about the world's origin (N, 6), and poses of bodies (N, 4, 4)."""
    model = mujoco.MjModel.from_xml_string(source)
    data, (time, q, dq, ddq) = mujoco.MjData(model), motion()
    names = [model.body(b).name for b in range(1, model.nbody)]
    total, places = np.empty((len(time), 6)), {name: np.empty((len(time), 4, 4)) for name in names}
    for k in range(len(time)):
        data.qpos, data.qvel, data.qacc = q[k, : model.nq], dq[k, : model.nq], ddq[k, : model.nq]
        mujoco.mj_inverse(model, data)
        axes, anchors = data.xaxis[:6], data.xanchor[:6]
        forces, moments = np.vstack([axes[:3], np.cross(anchors[3:], axes[3:])]), np.vstack([0 * axes[:3], axes[3:]])
        screws = np.hstack([forces, moments])
        total[k] = np.linalg.solve(screws, data.qfrc_inverse[:6])
        for name, poses in places.items():
            body = data.body(name)
            poses[k] = pose(body.xmat.reshape(3, 3), body.xpos)
    return total, places


def shares():
    """Shares of plates and rail in the total wrench; the right plate's share is zero at times, or all."""
    time = motion()[0]
    rail = 0.1 + 0.05 * np.sin(3 * time)
    right = (1 - rail) * np.clip(0.5 + 0.9 * np.sin(2.2 * time + 0.3), 0, 1)
    return {"right": right, "left": 1 - rail - right, "rail": rail}


def wrenches():
    total, _ = truth()
    return {name: share[:, None] * total for name, share in shares().items()}


def columns():
    time, q, dq, ddq = motion()
    out = {"time": time}
    for k, joint in enumerate(mechanism().tree.joints):
        out |= {f"q_{joint}": q[:, k], f"dq_{joint}": dq[:, k], f"ddq_{joint}": ddq[:, k]}
    return out


def in_frame(T, wrench):
    return transform_wrench(inverse(T), wrench)


def centre_of_pressure(wrench):
    """Point on the surface z = 0 and moment about z of wrenches in a plate's frame; arbitrary where no force acts."""
    F, M = wrench[:, :3], wrench[:, 3:]
    with np.errstate(divide="ignore", invalid="ignore"):
        point = np.stack([-M[:, 1] / F[:, 2], M[:, 0] / F[:, 2]], axis=1)
    return point, np.where(F[:, 2] == 0, 0, M[:, 2] - point[:, 0] * F[:, 1] + point[:, 1] * F[:, 0])
