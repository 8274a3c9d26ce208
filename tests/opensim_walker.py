"""An OpenSim leg with markers and a knee that slides as it bends, and readings of cameras and a plate."""

import numpy as np
from marked import trc
from opensim_files import Joint, constant, coordinate, document, linear, quietly_read, spatial, table

from ident.geometry.inertia import parameters_from_com
from ident.model.regressor import base_wrench_regressor

PHI = {
    "pelvis": parameters_from_com(10.0, np.array([0, 0.05, 0]), np.diag([0.1, 0.1, 0.1])),
    "femur": parameters_from_com(8.0, np.array([0.01, -0.17, 0]), np.diag([0.13, 0.02, 0.13])),
    "tibia": parameters_from_com(4.0, np.array([0, -0.2, 0.01]), np.diag([0.06, 0.01, 0.06])),
}
PLANAR = ("tx", "ty", "tilt", "hip", "knee")


def markers():
    rng = np.random.default_rng(3)
    return [(f"{body}{k}", body, rng.uniform(-0.15, 0.15, 3)) for body in PHI for k in range(4)]


def knee():
    """A joint of the tibia that slides along a spline as it bends."""
    x = np.linspace(-2, 0.2, 7)
    still = [("", axis, constant(0)) for axis in np.eye(3)]
    turns, slides = ("knee", [0, 0, 1], linear(1)), ("knee", [1, 0, 0], table(x, 0.03 * np.sin(1.2 * x)))
    axes = spatial([*still[:2], turns, slides, ("", [0, 1, 0], constant(-0.4)), still[2]])
    return Joint("CustomJoint", "knee", "femur", "tibia", [coordinate("knee", limits=(-2.0, 0.2))], axes)


def leg(folder):
    """A pelvis that moves in a plane, a femur, and a tibia on a knee that slides."""
    still = [("", axis, constant(0)) for axis in np.eye(3)]
    moves = [(name, np.eye(3)[k], linear(1)) for name, k in (("tilt", 2), ("tx", 0), ("ty", 1))]
    planar = spatial([*still[:2], *moves, still[2]])
    wide = (-3.0, 3.0)
    joints = [
        Joint("CustomJoint", "root", "ground", "pelvis", [coordinate(n, limits=wide) for n in PLANAR[:3]], planar),
        Joint("PinJoint", "hip", "pelvis", "femur", [coordinate("hip")]),
        knee(),
    ]
    path = folder / "leg.osim"
    path.write_text(document(joints, PHI, markers=markers()), encoding="utf-8")
    return path


def motion(samples=60, rate=100.0):
    t = np.arange(samples) / rate
    w, size = np.array([2.0, 4.0, 3.0, 5.0, 4.5]), np.array([0.3, 0.05, 0.2, 0.5, 0.6])
    arg = w * t[:, None] + np.arange(5)
    offset = np.array([0.4, 0.9, 0.1, 0.2, -0.8])
    return t, offset + size * np.sin(arg), size * w * np.cos(arg), -size * w**2 * np.sin(arg)


def trial(folder, path):
    """Writes `walk.trc` and `walk.mot` with readings of cameras and a plate; returns times and coordinates."""
    leg_, rng = quietly_read(path), np.random.default_rng(0)
    t, q, dq, ddq = motion()
    poses = leg_.tree.poses(q)
    labels = [name for name in leg_.sites if name in {marker for marker, _, _ in markers()}]
    sites = [(leg_.tree.names.index(body), place) for body, place in (leg_.sites[name] for name in labels)]
    x = np.stack([poses[:, b] @ place[:, 3] for b, place in sites], axis=1)[..., :3]
    (folder / "walk.trc").write_text(trc(t, labels, x + 0.001 * rng.normal(size=x.shape)), encoding="utf-8")
    wrench = base_wrench_regressor(leg_.tree, q, dq, ddq, gravity=leg_.gravity) @ leg_.known
    force, moment = wrench[:, :3], wrench[:, 3:]
    point = np.zeros((len(t), 3))
    point[:, 0], point[:, 2] = moment[:, 2] / force[:, 1], -moment[:, 0] / force[:, 1]
    free = moment - np.cross(point, force)
    columns = {"v": force, "p": point, "m": free}
    names = [f"ground_force_1_{kind}{axis}" for kind in columns for axis in "xyz"]
    rows = np.column_stack([t, *columns.values()])
    head = f"walk\nversion=1\nnRows={len(t)}\nnColumns={rows.shape[1]}\ninDegrees=yes\nendheader\n"
    lines = ["\t".join(["time", *names]), *("\t".join(map(repr, row.tolist())) for row in rows)]
    (folder / "walk.mot").write_text(head + "\n".join(lines) + "\n", encoding="utf-8")
    return t, q
