"""People who walk over two force plates, in the files of a gait laboratory: an OpenSim model, `.mot` angles and forces.

A cycle's angles are Fourier series. The pelvis moves so that the centre of pressure runs along the feet: for the point
p where the ground's force acts and the centre of mass c at the height h, p = c - (h / g) c̈, harmonic by harmonic.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from opensim_files import Joint, constant, coordinate, coupler, document, linear, spatial, table

from ident.geometry.inertia import com_from_parameters, parameters_from_com
from ident.model.regressor import base_wrench_regressor

CYCLE = {
    "hip_flexion": (30, 27, 18, 8, -2, -10, -8, 10, 25, 32),
    "hip_adduction": (0, 4, 5, 3, 2, 0, -5, -4, -1, 0),
    "hip_rotation": (-2, 0, 2, 3, 3, 1, -3, -5, -4, -3),
    "knee_angle": (5, 16, 15, 8, 5, 8, 32, 58, 55, 25),
    "ankle_angle": (0, -4, 3, 7, 9, 6, -14, -9, 0, 2),
    "subtalar_angle": (2, -3, -4, -3, 0, 4, 6, 2, 1, 2),
    "mtp_angle": (5, 2, 0, 0, 6, 22, 12, 0, 2, 5),
    "arm_flex": (-18, -16, -10, 0, 9, 14, 13, 6, -4, -13),
    "arm_add": (-8, -9, -10, -10, -9, -8, -8, -9, -9, -8),
    "arm_rot": (2, 3, 4, 3, 0, -2, -3, -2, 0, 1),
    "elbow_flex": (18, 16, 17, 22, 28, 33, 34, 31, 26, 21),
    "pro_sup": (20, 22, 24, 25, 24, 21, 18, 17, 17, 18),
}
"""Angles at tenths of a cycle that begins when the foot of that side lands, degrees: from no one's recording."""

TRUNK = {
    "pelvis_tilt": (1.0, 2),
    "pelvis_list": (4.0, 1),
    "pelvis_rotation": (5.0, 1),
    "lumbar_extension": (2.0, 2),
    "lumbar_bending": (5.0, 1),
    "lumbar_rotation": (8.0, 1),
}
"""Amplitude in degrees and harmonic of the coordinates without sides."""

HARMONICS = 4
STANCE = 0.62
"""Part of a cycle in which a foot is on the ground."""

HEIGHT, ALONG, ASIDE = 0.95, 0.10, 0.09
"""Height of the pelvis, half the path of the pressure along a foot, and half the distance between feet, m."""

ROOT = ("pelvis_tilt", "pelvis_list", "pelvis_rotation", "pelvis_tx", "pelvis_ty", "pelvis_tz")
SHAPES = {
    "pelvis": (11.0, (-0.07, 0, 0), 0.09),
    "femur": (8.5, (0, -0.17, 0), 0.13),
    "tibia": (3.4, (0, -0.19, 0), 0.11),
    "patella": (0.08, (0, 0.01, 0), 0.02),
    "talus": (0.1, (0, 0, 0), 0.03),
    "calcn": (1.1, (0.1, 0.03, 0), 0.07),
    "toes": (0.2, (0.035, 0.005, 0), 0.02),
    "torso": (30.0, (-0.03, 0.3, 0), 0.2),
    "humerus": (1.9, (0, -0.17, 0), 0.09),
    "ulna": (0.6, (0, -0.12, 0), 0.07),
    "radius": (0.6, (0.03, -0.12, 0), 0.07),
    "hand": (0.45, (0, -0.07, 0), 0.04),
}
"""Mass, centre and radius of gyration of the segments."""

AXES = np.eye(3)


@dataclass(frozen=True)
class Walk:
    """Parameters of a walk.

    Attributes:
        stride: Duration of a cycle, s.
        size: Size of the limbs' swing, about 1.
        arms: Size of the motion of arms and trunk, about 1.
        lands: Time at which the right foot lands on the first plate, s.
        seconds: Length of the trial, s.
        seed: Seed of noise, and of small differences between people's cycles.
    """

    stride: float = 1.1
    size: float = 1.0
    arms: float = 1.0
    lands: float = 0.15
    seconds: float = 1.3
    seed: int = 0


@dataclass(frozen=True)
class Laboratory:
    """Standard deviations of a laboratory's noise: of angles in degrees, of the pelvis in m, of forces in N."""

    angle: float = 0.4
    pelvis: float = 0.002
    force: float = 1.5
    late: float = 0.0
    rate: float = 100.0


def joints(scale, *, arms=True):
    """A person's joints as in OpenSim's models, of 22 bodies, or of 10 without arms, patellae and toes.

    Args:
        scale: Factor of lengths by body.
        arms: True for all bodies.
    """
    at = lambda body, *p: (scale[body] * np.array(p), np.zeros(3))  # noqa: E731

    def custom(name, parent, child, turns, where):
        zero = [("", axis, constant(0)) for axis in AXES]
        given = [(c, axis, linear(1)) for c, axis in turns]
        left = [x for x in AXES if not any(x @ np.asarray(axis) for _, axis in turns)]
        given += [("", axis, constant(0)) for axis in left]
        own = [coordinate(c) for c, _ in turns]
        return Joint("CustomJoint", name, parent, child, own, spatial([*given, *zero]), at=where)

    z, x, y = AXES[2], AXES[0], AXES[1]
    root = [(ROOT[0], z, linear(1)), (ROOT[1], x, linear(1)), (ROOT[2], y, linear(1))]
    root += [(name, axis, linear(1)) for name, axis in zip(ROOT[3:], AXES, strict=True)]
    out = [Joint("CustomJoint", "ground_pelvis", "ground", "pelvis", [coordinate(c) for c in ROOT], spatial(root))]
    bend = np.linspace(-0.2, 2.2, 9)
    for side, s in (("r", 1), ("l", -1)):
        own = lambda stem, side=side: f"{stem}_{side}"  # noqa: E731
        hip = [(own("hip_flexion"), z), (own("hip_adduction"), s * x), (own("hip_rotation"), s * y)]
        out.append(custom(own("hip"), "pelvis", own("femur"), hip, at("pelvis", -0.07, -0.07, 0.08 * s)))
        k, along = own("knee_angle"), scale[own("femur")]
        slides = [
            (k, x, table(bend, -0.02 * along * np.sin(bend))),
            (k, y, table(bend, -0.41 * along + 0.012 * along * np.sin(bend) ** 2)),
            (k, z, table(bend, 0.002 * s * np.sin(bend))),
        ]
        turns = [(k, -z, linear(1)), (k, x, table(bend, 0.05 * s * np.sin(bend))), ("", y, constant(0))]
        out.append(
            Joint("CustomJoint", own("knee"), own("femur"), own("tibia"), [coordinate(k)], spatial(turns + slides))
        )
        if arms:
            beta = [(own("knee_angle_beta"), -z)]
            out.append(
                custom(own("patellofemoral"), own("femur"), own("patella"), beta, at(own("femur"), 0.04, -0.39, 0))
            )
        ankle = [(own("ankle_angle"), np.array([-0.105, -0.174 * s, 0.979]))]
        out.append(_pin(own("ankle"), own("tibia"), own("talus"), ankle, at(own("tibia"), 0, -0.4, 0)))
        tilted = [(own("subtalar_angle"), np.array([0.787, 0.604, -0.121 * s]) * s)]
        out.append(_pin(own("subtalar"), own("talus"), own("calcn"), tilted, at(own("talus"), -0.05, -0.04, 0.008 * s)))
        if arms:
            toes = [(own("mtp_angle"), np.array([-0.58, 0, 0.815 * s]) * s)]
            out.append(_pin(own("mtp"), own("calcn"), own("toes"), toes, at(own("calcn"), 0.18, -0.002, 0.001)))
    back = [("lumbar_extension", z), ("lumbar_bending", x), ("lumbar_rotation", y)]
    out.append(custom("back", "pelvis", "torso", back, at("pelvis", -0.1, 0.08, 0)))
    for side, s in (("r", 1), ("l", -1)) if arms else ():
        own = lambda stem, side=side: f"{stem}_{side}"  # noqa: E731
        shoulder = [(own("arm_flex"), z), (own("arm_add"), s * x), (own("arm_rot"), s * y)]
        out.append(custom(own("shoulder"), "torso", own("humerus"), shoulder, at("torso", 0, 0.37, 0.17 * s)))
        elbow = [(own("elbow_flex"), np.array([0.2 * s, 0.02 * s, 0.98]))]
        out.append(_pin(own("elbow"), own("humerus"), own("ulna"), elbow, at(own("humerus"), 0.01, -0.29, 0)))
        turn = [(own("pro_sup"), np.array([0.05 * s, 0.998 * s, 0.04]))]
        out.append(_pin(own("radioulnar"), own("ulna"), own("radius"), turn, at(own("ulna"), 0, -0.01, 0.02 * s)))
        out.append(
            Joint("WeldJoint", own("wrist"), own("radius"), own("hand"), at=at(own("radius"), -0.01, -0.24, 0.01 * s))
        )
    return out


def _pin(name, parent, child, turns, where):
    """A custom joint about one oblique axis."""
    ((c, axis),) = turns
    axis = axis / np.linalg.norm(axis)
    across = np.linalg.svd(axis[None])[2][1:]
    still = [("", a, constant(0)) for a in AXES]
    inside = spatial([(c, axis, linear(1)), *(("", a, constant(0)) for a in across), *still])
    return Joint("CustomJoint", name, parent, child, [coordinate(c)], inside, at=where)


def names(*, arms=True):
    """Names of the person's bodies."""
    return [joint.child for joint in joints(dict.fromkeys(_all(), 1.0), arms=arms)]


def _all():
    middle = ("pelvis", "torso")
    return [*middle, *(f"{stem}_{side}" for stem in SHAPES if stem not in middle for side in "rl")]


def person(seed=None, *, arms=True, lengths=0.03, inertias=0.2):
    """Text of the model's file: the true one, or with a seed a wrong one.

    Args:
        seed: Seed of the model's errors; None for the truth.
        arms: True for all bodies.
        lengths: Standard deviation of the logarithm of lengths.
        inertias: The same for masses and moments; centres have errors of this part of the radius of gyration.
    """
    rng = np.random.default_rng(seed)
    off = 0.0 if seed is None else 1.0
    scale = {name: np.exp(off * lengths * rng.normal()) for name in _all()}
    phi = {}
    for name in names(arms=arms):
        mass, centre, radius = SHAPES[name.removesuffix("_r").removesuffix("_l")]
        heavier, thicker = np.exp(off * inertias * rng.normal(size=2))
        centre = np.array(centre) + off * inertias * radius * rng.normal(size=3)
        central = mass * radius**2 * np.diag([1.0, 0.35, 1.0]) * heavier * thicker
        phi[name] = parameters_from_com(mass * heavier, centre, central)
    bend = np.linspace(-0.2, 2.2, 9)
    beta = table(bend, 0.8 * np.sin(0.6 * bend))
    sides = "rl" if arms else ""
    constraints = "".join(coupler(f"knee_angle_{s}", f"knee_angle_beta_{s}", beta) for s in sides)
    return document(joints(scale, arms=arms), phi, constraints=constraints)


def masses(model):
    """Masses of a mechanism's bodies by name."""
    return {b: com_from_parameters(p)[0] for b, p in zip(model.bodies, model.known.reshape(-1, 10), strict=True)}


class Series:
    """Sums of harmonics of all coordinates, some of which have additions: value, and two derivatives."""

    def __init__(self, stride, count):
        self.w = 2 * np.pi / stride
        self.coefficients = np.zeros((count, 12), complex)
        self.speed = np.zeros(count)

    def __call__(self, time):
        k = 1j * self.w * np.arange(self.coefficients.shape[1])
        waves = np.exp(time[:, None] * k)
        first = self.speed * time[:, None]
        q, dq, ddq = ((waves * k**d @ self.coefficients.T).real for d in range(3))
        return q + first, dq + self.speed, ddq


def harmonics(values, count):
    """Coefficients of samples over a cycle, up to a harmonic."""
    c = np.fft.rfft(values, axis=0) / len(values)
    c[1:] *= 2
    return c[: count + 1]


def gait(model, walk):
    """Motion of a walk as a `Series` of the model's coordinates; the right foot lands at 0."""
    rng = np.random.default_rng((walk.seed, 7))
    order = model.tree.joints
    series = Series(walk.stride, len(order))
    for k, name in enumerate(order):
        stem, side = (name[:-2], name[-1]) if name[-2:] in ("_r", "_l") else (name, "")
        c = np.zeros(HARMONICS + 1, complex)
        if stem in CYCLE:
            size = walk.arms if stem in ("arm_flex", "arm_add", "arm_rot", "elbow_flex", "pro_sup") else walk.size
            c = harmonics(np.radians(CYCLE[stem]), HARMONICS)
            c[1:] *= size
            if side == "l":
                c = c * np.exp(-1j * np.pi * np.arange(HARMONICS + 1))
        elif stem in TRUNK:
            amplitude, harmonic = TRUNK[stem]
            c[harmonic] = np.radians(amplitude) * walk.arms * np.exp(1j * (0.4 + k))
        small = 0.05 * np.abs(c).max() * (rng.normal(size=HARMONICS) + 1j * rng.normal(size=HARMONICS))
        series.coefficients[k, 1 : HARMONICS + 1] = c[1:] + small / (1 + np.arange(HARMONICS))
        series.coefficients[k, 0] = c[0]
    x, y, z = (order.index(name) for name in ROOT[3:])
    series.speed[x] = 1.25 * walk.size / walk.stride
    series.coefficients[y, :3] = HEIGHT, 0, 0.022 * walk.size**2 * np.exp(1j * np.pi * 0.75)
    samples = 96
    time = np.arange(samples) / samples * walk.stride
    wanted = pressure(walk, time)
    for _ in range(4):
        total = needed(model, series, time)
        at = np.stack([total[:, 5], -total[:, 3]], axis=1) / total[:, 1:2]
        gap = harmonics(wanted - at, 6)
        gap /= (1 + (np.arange(7) * series.w) ** 2 * HEIGHT / 9.8)[:, None]
        series.coefficients[x, :7] += gap[:, 0]
        series.coefficients[z, :7] += gap[:, 1]
    return series


def feet(walk, time):
    """Centre of pressure on each foot (N, 2), along and across, and the number of its step, by side."""
    length, out = 1.25 * walk.size, {}
    for side, begin, aside in (("r", 0.0, ASIDE), ("l", 0.5, -ASIDE)):
        step, phase = np.divmod(time / walk.stride - begin, 1)
        along = (step + begin) * length + ALONG * (2 * np.minimum(phase / STANCE, 1) - 1)
        out[side] = np.stack([along, np.full_like(time, aside)], axis=1), step
    return out


def on_the_right(walk, time):
    """Share of the load on the right foot (N,)."""
    x = np.interp(time / walk.stride % 1, [0, STANCE - 0.5, 0.5, STANCE, 1], [0, 1, 1, 0, 0])
    return x * x * (3 - 2 * x)


def pressure(walk, time):
    """The centre of pressure of both feet, along and across (N, 2)."""
    right, share = on_the_right(walk, time)[:, None], feet(walk, time)
    return right * share["r"][0] + (1 - right) * share["l"][0]


def needed(model, series, time):
    """Wrench of the ground, about the world's origin (N, 6)."""
    q, dq, ddq = series(time)
    return base_wrench_regressor(model.tree, q, dq, ddq, gravity=model.gravity) @ model.known


def split(walk, time, total):
    """Each foot's part of a wrench about the origin: force, point and free moment (N, 3) by side."""
    force, share = total[:, :3], on_the_right(walk, time)
    at = np.stack([total[:, 5], -total[:, 3]], axis=1) / force[:, 1:2]
    off, out = at - pressure(walk, time), {}
    middle = np.insert(at, 1, 0.0, axis=1)
    free = total[:, 3:] - np.cross(middle, force)
    for side, (under, _) in feet(walk, time).items():
        part = (share if side == "r" else 1 - share)[:, None]
        out[side] = part * force, np.insert(under + off, 1, 0.0, axis=1), part * free
    return out


@dataclass(frozen=True)
class Trial:
    """A trial: the truth and the laboratory's measurements.

    Attributes:
        time: Sample times, s (N,).
        q: True coordinates of the model's joints (N, n).
        beside: Share of the weight on feet beside the plates (N,).
        plates: Force, point and free moment of both plates (N, 9) each.
        joints: Names of the coordinates.
    """

    time: np.ndarray
    q: np.ndarray
    beside: np.ndarray
    plates: Sequence[np.ndarray]
    joints: Sequence[str]


def trial(model, walk, laboratory=Laboratory(), chair=None):
    """A walk over two plates, one for the right foot's first step and the other for the left one's.

    Args:
        model: The true person.
        walk: Parameters of the walk.
        laboratory: Noise of the laboratory.
        chair: Share of the load on something without a sensor, a function of time.
    """
    rng, series = np.random.default_rng((walk.seed, 1)), gait(model, walk)
    time = np.arange(round(walk.seconds * laboratory.rate)) / laboratory.rate
    since, late = time - walk.lands, time - walk.lands - laboratory.late
    total = needed(model, series, late)
    if chair is not None:
        total = total - chair(model, series, late, total)
    steps, plates, beside = feet(walk, late), [], np.zeros(len(time))
    weight = 9.8 * sum(masses(model).values())
    for side, (force, point, free) in split(walk, late, total).items():
        there = (steps[side][1] == 0)[:, None]
        beside += np.where(there, 0, force)[:, 1] / weight
        force, free = force * there, free * there
        moment = np.cross(point, force) + free + 0.1 * laboratory.force * rng.normal(size=force.shape)
        force = force + laboratory.force * rng.normal(size=force.shape)
        plates.append(_pressed(force, moment))
    return Trial(time, series(since)[0], beside, plates, model.tree.joints)


def _pressed(force, moment):
    """Point and moment in laboratories' convention: below 10 N the point is at the origin, and the wrench is zero."""
    on = (force[:, 1] > 10)[:, None]
    point = np.insert(np.stack([moment[:, 2], -moment[:, 0]], axis=1) / force[:, 1:2], 1, 0.0, axis=1)
    free = (moment - np.cross(point, force)) * [0, 1, 0]
    return np.where(on, np.hstack([force, point, free]), 0.0)


def mot(path, columns, *, degrees):
    """Writes a motion file."""
    table = np.column_stack(list(columns.values()))
    head = f"name\nversion=1\nnRows={len(table)}\nnColumns={table.shape[1]}\ninDegrees={degrees}\nendheader\n"
    rows = "\n".join("\t".join(f"{x:.8f}" for x in row) for row in table)
    path.write_text(head + "\t".join(columns) + "\n" + rows + "\n", encoding="utf-8")


def write(folder, name, measured, laboratory=Laboratory(), seed=0):
    """Writes the files of a trial, and returns them joined as for the commands."""
    rng = np.random.default_rng((seed, 2))
    angles = {"time": measured.time}
    for joint, x in zip(measured.joints, measured.q.T, strict=True):
        slides = joint in ROOT[3:]
        std = laboratory.pelvis if slides else laboratory.angle
        angles[joint] = (x if slides else np.degrees(x)) + std * rng.normal(size=len(x))
    forces = {"time": measured.time}
    for k, values in enumerate(measured.plates):
        prefix = f"{k}_" if k else ""
        keys = [f"{prefix}ground_force_{kind}{axis}" for kind in "vp" for axis in "xyz"]
        keys += [f"{prefix}ground_torque_{axis}" for axis in "xyz"]
        forces |= dict(zip(keys, values.T, strict=True))
    mot(folder / f"{name}_ik.mot", angles, degrees="yes")
    mot(folder / f"{name}_grf.mot", forces, degrees="no")
    return f"{folder / f'{name}_ik.mot'}+{folder / f'{name}_grf.mot'}"


COLUMNS = "".join(
    f"""[wrenches.{name}]
frame = "world"
on = "calcn_{side}"
force = ["{prefix}ground_force_vx", "{prefix}ground_force_vy", "{prefix}ground_force_vz"]
point = ["{prefix}ground_force_px", "{prefix}ground_force_py", "{prefix}ground_force_pz"]
free_moment = ["{prefix}ground_torque_x", "{prefix}ground_torque_y", "{prefix}ground_torque_z"]
"""
    for name, side, prefix in (("plate1", "r", ""), ("plate2", "l", "1_"))
)
