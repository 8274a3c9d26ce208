"""Motions of the humanoid scene as in laboratory trials: standing, swaying, squats, arm swings, steps.

Angles are prescribed as functions of time. The pose of the pelvis follows from a foot that stays on the floor, the
angles of an arm from a hand that holds a rail. There is no balance control: the forces are those that the motion needs
(`ident.model.regressor`), distributed over feet and hand.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import Rotation

from ident.errors import InputError
from ident.estimation.recorded_motion import base_motion, joint_states
from ident.geometry.se3 import continuous_quaternions, inverse, pose, without_jumps
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree

ACTIVITIES = ("standing", "swaying", "squats", "arm swings", "steps")

RAIL = np.array([0.22, -0.25, 1.1])
"""Position at which the right hand holds the rail, m; the person faces x and stands above the origin."""

STANCE = {"hip_flexion": 0.15, "knee": 0.3, "ankle": 0.15}
"""Angles of both legs in stance: knees slightly bent, feet flat, rad."""

SUBTALAR = np.array([0.714, 0.205, 0.669])
"""Roll, pitch and yaw of the left foot per small angle of its oblique subtalar joint; the right foot's pitch has the
opposite sign."""

RESTLESS = (
    *("lumbar_bending", "lumbar_flexion", "thoracic_flexion", "thoracic_twist", "neck"),
    *("shoulder", "elbow", "pronation", "wrist_flexion", "wrist_deviation"),
)
"""Joints with small motions at all times; those of the arms on both sides."""

_FIRST = np.array([1 / 280, -4 / 105, 1 / 5, -4 / 5, 0, 4 / 5, -1 / 5, 4 / 105, -1 / 280])
_SECOND = np.array([-1 / 560, 8 / 315, -1 / 5, 8 / 5, -205 / 72, 8 / 5, -1 / 5, 8 / 315, -1 / 560])

Angles = dict[str, np.ndarray]


@dataclass(frozen=True)
class Style:
    """Variation of an activity between persons and trials.

    Attributes:
        pace: Repetitions per second, Hz.
        size: Size of the motion, about 1.
        rail: True if the right hand holds the rail.
        seed: Seed of the motion of joints that the activity does not prescribe.
    """

    pace: float = 0.5
    size: float = 1.0
    rail: bool = True
    seed: int = 0


def motion(tree: Tree, activity: str, time: np.ndarray, style: Style = Style()) -> Motion:
    """Motion of a person, with the pelvis as moving base.

    Args:
        tree: The humanoid with the base `pelvis`.
        activity: One of `ACTIVITIES`.
        time: Sample times, s (N,).
        style: Its variation.

    Raises:
        InputError: There is no such activity.
    """
    if activity not in ACTIVITIES:
        raise InputError(f"A person does one of {', '.join(ACTIVITIES)}, got '{activity}'.")
    # With such steps, s, the error of finite differences of eighth order is rounding only.
    step = 2e-3
    steps = step * np.arange(-4, 5)
    points = coordinates(tree, activity, (time[:, None] + steps).ravel(), style).reshape(len(time), len(steps), -1)
    rates = (weights @ points for weights in (_FIRST / step, _SECOND / step**2))
    states = np.stack([points[:, 4], *rates])
    return Motion(*joint_states(tree, states[..., 7:]), base_motion(states[..., :7]))


def coordinates(tree: Tree, activity: str, time: np.ndarray, style: Style) -> np.ndarray:
    """Position and quaternion of the pelvis, and coordinates of the joints (N, 7 + n_q)."""
    angles, swinging = _PRESCRIBED[activity](time, style)
    angles = {**_restless(tree, time, style), **_legs(len(time), STANCE), **angles}
    q = _q(tree, len(time), angles)
    pelvis = _pelvis(tree, q, swinging)
    if style.rail:
        angles |= _arm(tree, q, pelvis)
        q = _q(tree, len(time), angles)
    return np.hstack([pelvis[:, :3, 3], continuous_quaternions(pelvis[:, :3, :3]), q])


def _q(tree: Tree, samples: int, angles: Angles) -> np.ndarray:
    """Joint coordinates (N, n_q) from angles by joint (N,), rotation vectors (N, 3) or quaternions (N, 4)."""
    columns = []
    for body in tree.bodies:
        x = angles.get(body.joint)
        if not body.is_ball:
            columns.append(np.zeros((samples, body.coordinates)) if x is None else x[:, None])
        elif x is None:
            columns.append(np.tile([1.0, 0, 0, 0], (samples, 1)))
        else:
            columns.append(Rotation.from_rotvec(x).as_quat(scalar_first=True) if x.shape[1] == 3 else without_jumps(x))
    return np.hstack(columns)


def _pelvis(tree: Tree, q: np.ndarray, swinging: np.ndarray) -> np.ndarray:
    """Poses of the pelvis with which the standing foot stays at its place in upright stance (N, 4, 4).

    Args:
        tree: The humanoid.
        q: Joint coordinates (N, n_q).
        swinging: True while the left foot swings and the right one stands (N,).
    """
    feet = [tree.names.index(f"{side}_foot") for side in ("left", "right")]
    stance = tree.poses(_q(tree, 1, _legs(1, STANCE)))[0, feet]
    upright = pose(np.eye(3), np.array([-stance[0, 0, 3], 0.0, 0.08 - stance[0, 2, 3]]))
    poses = tree.poses(q)[:, feet]
    left, right = ((upright @ stance[k]) @ inverse(poses[:, k]) for k in range(2))
    return np.where(swinging[:, None, None], right, left)


def _legs(samples: int, angles: Mapping[str, float | np.ndarray]) -> Angles:
    """Angles of both legs, equal on both sides."""
    sides = ("left", "right")
    return {f"{side}_{joint}": np.broadcast_to(x, samples) for side in sides for joint, x in angles.items()}


def _restless(tree: Tree, time: np.ndarray, style: Style) -> Angles:
    """Small motions of trunk, neck, arms and wrists at all times."""
    rng, angles = np.random.default_rng(style.seed), Angles()
    for body in tree.bodies:
        if body.joint.removeprefix("left_").removeprefix("right_") in RESTLESS:
            freedoms = body.freedoms
            angles[body.joint] = _waves(rng, time, style, (freedoms, 0.025))[:, slice(None) if freedoms > 1 else 0]
    return angles


def _waves(rng: np.random.Generator, time: np.ndarray, style: Style, size: tuple[int, float]) -> np.ndarray:
    """Sums of three sines with random frequencies and phases (N, k)."""
    count, amplitude = size
    frequency = style.pace * rng.uniform(0.5, 2.5, (3, count))
    phase, share = rng.uniform(0, 2 * np.pi, (3, count)), rng.uniform(0.4, 1, (3, count))
    waves = share * np.sin(2 * np.pi * frequency * time[:, None, None] + phase)
    return style.size * amplitude * waves.sum(axis=1)


def _standing(time: np.ndarray, style: Style) -> tuple[Angles, np.ndarray]:
    sway = _waves(np.random.default_rng(style.seed + 1), time, style, (2, 0.005)).T
    legs = _legs(len(time), {"ankle": STANCE["ankle"] + sway[0], "hip_flexion": STANCE["hip_flexion"] + sway[1]})
    return legs, np.zeros(len(time), bool)


def _swaying(time: np.ndarray, style: Style) -> tuple[Angles, np.ndarray]:
    phase = 2 * np.pi * style.pace * time
    ankle, hip = style.size * 0.05 * np.sin(phase), style.size * 0.15 * np.sin(phase + 3)
    legs = _legs(len(time), {"hip_flexion": STANCE["hip_flexion"] + hip})
    legs |= {
        joint: x + ankle * joint.endswith("ankle")
        for joint, x in _aside(style.size * 0.06 * np.sin(0.7 * phase)).items()
    }
    legs |= {"lumbar_bending": 0.2 * style.size * np.sin(1.3 * phase)}
    return legs, np.zeros(len(time), bool)


def _aside(angle: np.ndarray) -> Angles:
    """Angles of both legs tilted equally, so that the pelvis moves to the right; axes on the right are mirrored."""
    angles, (roll, pitch, yaw) = Angles(), SUBTALAR
    subtalar = -angle / roll
    for side, sign in (("left", 1.0), ("right", -1.0)):
        angles |= {f"{side}_hip_abduction": sign * angle, f"{side}_subtalar": subtalar}
        angles |= {f"{side}_ankle": STANCE["ankle"] - sign * pitch * subtalar}
        angles |= {f"{side}_hip_rotation": -sign * yaw * subtalar}
    return angles


def _squats(time: np.ndarray, style: Style) -> tuple[Angles, np.ndarray]:
    deep = style.size * np.sin(np.pi * style.pace * time) ** 2
    legs = {
        "hip_flexion": STANCE["hip_flexion"] + 0.9 * deep,
        "knee": STANCE["knee"] + 0.9 * deep,
        "ankle": STANCE["ankle"] + 0.2 * deep,
    }
    return _legs(len(time), legs), np.zeros(len(time), bool)


def _arm_swings(time: np.ndarray, style: Style) -> tuple[Angles, np.ndarray]:
    phase = 2 * np.pi * style.pace * time
    swing = style.size * np.sin(phase)
    angles = Angles()
    for side, sign in (("left", 1.0), ("right", -1.0)):
        raised = 0.25 * np.sin(0.6 * phase) ** 2
        angles[f"{side}_shoulder"] = np.stack([sign * raised, -sign * 0.7 * swing, 0.2 * swing], axis=1)
        angles[f"{side}_elbow"] = 0.6 + 0.45 * np.sin(phase + sign)
        angles[f"{side}_pronation"] = 0.5 * np.sin(0.8 * phase + sign)
        angles[f"{side}_wrist_deviation"] = 0.2 * np.sin(1.7 * phase)
    angles["thoracic_twist"] = 0.25 * swing
    angles["neck"] = np.stack([0.1 * swing, 0.25 * np.sin(0.9 * phase), 0.3 * np.sin(1.1 * phase)], axis=1)
    return angles, np.zeros(len(time), bool)


def _steps(time: np.ndarray, style: Style) -> tuple[Angles, np.ndarray]:
    """Steps in place: while one leg is lifted the other one stands; in between both are in stance."""
    phase = style.pace * time
    left = np.floor(phase) % 2 == 0
    lift = style.size * np.sin(np.pi * phase) ** 6
    angles = _standing(time, Style(style.pace, 0.0, style.rail, style.seed))[0]
    # Before a leg is lifted the pelvis moves over the other one.
    aside = 0.1 * np.sin(np.pi * phase) ** 5
    angles |= _aside(aside)
    for side, own in (("left", left), ("right", ~left)):
        lifted = np.where(own, lift, 0.0)
        angles[f"{side}_hip_flexion"] = STANCE["hip_flexion"] + 0.9 * lifted
        angles[f"{side}_knee"] = STANCE["knee"] + 1.2 * lifted
        angles[f"{side}_ankle"] -= 0.2 * lifted
        angles[f"{side}_hip_rotation"] += 0.2 * lifted * np.sin(4 * phase)
        angles[f"{side}_hip_abduction"] += 0.2 * lifted
        angles[f"{side}_toes"] = 0.3 * lifted
    return angles, left


def _arm(tree: Tree, q: np.ndarray, pelvis: np.ndarray) -> Angles:
    """Angles of the right arm with its palm at the rail."""
    names = tree.names
    shoulder, elbow, hand = (names.index(n) for n in ("right_upper_arm", "right_forearm:right_elbow", "right_hand"))
    thorax = names.index("thorax")
    socket = pelvis @ tree.poses(q)[:, thorax] @ tree.bodies[shoulder].home
    target = (inverse(socket) @ np.append(RAIL, 1.0))[:, :3]
    upper = tree.bodies[elbow].home[:3, 3]
    straight = _q(tree, 1, Angles())
    poses = tree.poses(straight)[0]
    fore = (inverse(poses[elbow]) @ poses[hand])[:3, 3] + [0, 0, -0.06]
    # The elbow follows from the distance by the law of cosines, then the shoulder from the direction.
    a, b, c = np.linalg.norm(upper), np.linalg.norm(fore), np.linalg.norm(target, axis=1)
    if (c >= a + b).any():
        raise InputError("The rail is out of reach; a smaller motion is needed (size).")
    bent = np.pi - np.arccos((a**2 + b**2 - c**2) / (2 * a * b))
    reached = upper + np.stack([b * np.sin(bent), 0 * bent, -b * np.cos(bent)], axis=1)
    turns = np.cross(reached, target)
    scalar = c * c + (reached * target).sum(axis=1)
    quaternion = np.hstack([scalar[:, None], turns])
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    still = np.zeros(len(q))
    resting = {f"right_{joint}": still for joint in ("pronation", "wrist_flexion", "wrist_deviation")}
    return {"right_shoulder": quaternion, "right_elbow": bent, **resting}


_PRESCRIBED: dict[str, Callable[[np.ndarray, Style], tuple[Angles, np.ndarray]]] = {
    "standing": _standing,
    "swaying": _swaying,
    "squats": _squats,
    "arm swings": _arm_swings,
    "steps": _steps,
}
