"""A person who moves in the plane normal to z, on two plates that also measure her sideways sway."""

from functools import cache

import mujoco
import numpy as np
from mechanisms import sines

import ident
import sim
from ident.model.regressor import base_wrench_regressor

LEG = """<body name="thigh_{side}" pos="0 0 {z}"><joint name="hip_{side}" axis="0 0 1"/>
  <geom type="capsule" fromto="0 0 0 0.02 -0.42 0" size="0.07"/>
  <body name="foot_{side}" pos="0 -0.45 0"><joint name="knee_{side}" axis="{knee}"/>
    <geom type="capsule" fromto="0 0 0 0 -0.42 {foot}" size="0.05"/></body></body>"""
MODEL = """<mujoco><option gravity="{gravity}"/><worldbody><body name="pelvis" pos="0 1 0">
  <joint name="tx" type="slide" axis="1 0 0"/><joint name="ty" type="slide" axis="0 1 0"/>
  <joint name="tilt" axis="0 0 1"/><geom type="ellipsoid" size="0.1 0.25 0.16" pos="0.02 0.2 0" density="1100"/>{legs}
</body></worldbody></mujoco>"""
SIDEWAYS = ("Fz", "Mx", "My")
STANDS = {"right": "foot_r", "left": "foot_l"}


def text(*, gravity="0 -9.81 0", knee="0 0 1"):
    sides = ("r", 0.1, knee), ("l", -0.1, "0 0 -1")
    legs = (LEG.format(side=side, z=z, foot=z / 10, knee=axis) for side, z, axis in sides)
    return MODEL.format(gravity=gravity, legs="".join(legs))


@cache
def mechanism():
    return sim.mechanism(mujoco.MjSpec.from_string(text()))


def motion(samples, rate=100.0):
    rng, time = np.random.default_rng(0), np.arange(samples) / rate
    sizes = np.array([0.15, 0.08, 0.3, 0.6, 0.6, 0.6, 0.6])[:, None]
    size, phase = sizes * rng.uniform(0.2, 0.6, (7, 3)), rng.uniform(0, 6, (7, 3))
    w = rng.uniform(2, 9, (7, 3))
    return time, *sines(time, size, w, phase)


def recording(samples=600, *, sway=1.0):
    """Readings of plates, with sway out of the plane, and of encoders; noise of 1 N, 0.3 N m, 2 mrad and 2 mm."""
    person, rng, (time, q, dq, ddq) = mechanism(), np.random.default_rng(0), motion(samples)
    total = base_wrench_regressor(person.tree, q, dq, ddq, gravity=person.gravity) @ person.known
    total[:, 2] += sway * (40 * np.sin(5 * time) + 60 * q[:, 3])
    total[:, 3] += sway * (60 * np.sin(4 * time + 1) - 50 * q[:, 4])
    total[:, 4] += sway * (15 * np.cos(5 * time) + 25 * q[:, 5])
    right = np.clip(0.5 + 0.6 * np.sin(2.2 * time), 0.02, 0.98)[:, None]
    measured = {}
    for k, joint in enumerate(person.joints):
        measured[f"{joint}_position"] = q[:, k] + 0.002 * rng.normal(size=samples)
    for name, share in (("right", right), ("left", 1 - right)):
        values = share * total + rng.normal(size=total.shape) * [1, 1, 1, 0.3, 0.3, 0.3]
        measured |= {f"{name}_force": values[:, :3], f"{name}_torque": values[:, 3:]}
    sensors = {name: ident.Sensor(body, frame="world") for name, body in STANDS.items()}
    return ident.Recording(time, measured, sensors=sensors, held=False)
