"""Direction of gravity that explains a recording best, in the frame of a base at rest or in the axes of its poses."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from scipy import linalg
from scipy.spatial.transform import Rotation

from ident.estimation.preparation import Prepared
from ident.geometry.se3 import roll_pitch_yaw
from ident.judgement.diagnosis import TIE
from ident.judgement.model_fit import EXPLAINED, FAR_BETTER, SAMPLES, ModelFit
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion

AXIS, AWAY = np.cos(np.radians(8)), np.cos(np.radians(15))
"""Cosine of the angle from an axis up to which a fitted direction is taken as that axis; and of the one from the stated
direction up to which the set-up's tilt of gravity explains it."""

TURNS = 0.4, 0.2, 0.1, 0.05, 0.025, 0.0125
"""Turns by which a direction is searched about the best axis or corner, rad: first less than half their distance."""

BRAKING = -0.02
"""Mean power of the torques over their size, below which they would drive against friction, so that their signs are
wrong: masses and springs return their energy."""


class GravityCheck(NamedTuple):
    """Directions of gravity in the base frame, compared.

    Attributes:
        stated: Misfit of the stated direction.
        misfit: Misfit of the direction that explains best.
        rpy_deg: Orientation of the base in the world with that direction: roll, pitch and yaw, degrees.
        joint: Joint of which another zero would explain the same; None if there is none.
        possible: True if it explains far more than the stated one, whatever other signs do.
        suspicious: True if it also explains more than other signs do.
    """

    stated: float
    misfit: float
    rpy_deg: tuple[float, ...]
    joint: str | None
    possible: bool
    suspicious: bool


def gravity_check(
    mechanism: Mechanism, motion: Motion, measured: Mapping[str, np.ndarray], frame: np.ndarray | None = None
) -> GravityCheck | None:
    """Comparison of directions of gravity.

    Args:
        mechanism: The mechanism, with a prior.
        motion: Its motion (N samples).
        measured: Components of the total wrench, `Fx` to `Mz`, and joint torques by the freedoms' names (N,) each.
        frame: Pose of the frame of these components in the base frame (4, 4).

    Returns:
        The comparison; None without gravity, for a base that floats without poses, or if nothing is measured.
    """
    some = np.linspace(0, len(motion) - 1, min(SAMPLES, len(motion))).astype(int)
    few = {name: x[some] for name, x in measured.items()}
    fit = ModelFit.of(mechanism, motion[some], few, np.eye(4) if frame is None else frame)
    if fit is None:
        return None
    best = _best(fit)
    stated, misfit, along = fit.misfit(fit.down), fit.misfit(best), float(fit.down @ best)
    # Other signs or offsets of channels, or axes of the wrench: what is alike counts as it is likelier.
    other = fit.otherwise() * (1 / TIE if not fit.felt or _power(mechanism, motion, measured) < BRAKING else TIE)
    # Where joints move in one plane, bodies whose weight has shorter levers look like a base that is tilted out of it.
    lighter = fit.misfit(along * fit.down) if along > TURNS[-1] else np.inf
    possible = along < AWAY and misfit < min(FAR_BETTER * stated, EXPLAINED, TIE**2 * other, FAR_BETTER * lighter)
    joint = None if fit.wrench or motion.base is not None else _joint_of(mechanism, best - fit.down)
    return GravityCheck(stated, misfit, rpy_deg(mechanism, best), joint, possible, possible and misfit < other)


def _best(fit: ModelFit) -> np.ndarray:
    """Direction with the least misfit, searched from the best axis or corner; an axis if it is near one."""
    corners = [np.array([x, y, z]) / np.sqrt(3) for x in (1, -1) for y in (1, -1) for z in (1, -1)]
    first = min((*np.eye(3), *-np.eye(3), *corners), key=fit.misfit)
    across, best, least = linalg.null_space(first[None]).T, first, fit.misfit(first)
    for turn in TURNS:
        while True:
            nearest = min((_unit(best + sign * turn * e) for e in across for sign in (1, -1)), key=fit.misfit)
            if (misfit := fit.misfit(nearest)) >= least:
                break
            best, least = nearest, misfit
    return np.round(best) if np.abs(best).max() > AXIS else best


def _unit(x: np.ndarray) -> np.ndarray:
    return x / np.linalg.norm(x)


def recorded_gravity(prepared: Prepared) -> GravityCheck | None:
    """Comparison of directions of gravity in a recording; None where nothing can be compared."""
    samples = prepared.samples[prepared.taken(slice(prepared.edge, len(prepared.samples) - prepared.edge))]
    measured = dict(zip(prepared.equations.channels, samples.measured.T, strict=True))
    return gravity_check(prepared.mechanism, samples.motion, measured, prepared.frame) if len(samples) else None


def rpy_deg(mechanism: Mechanism, direction: np.ndarray) -> tuple[float, ...]:
    """Roll, pitch and yaw of the base frame in the world that give gravity a direction in it, in whole degrees."""
    world = mechanism.in_world @ mechanism.gravity
    upright, _ = Rotation.align_vectors([[0.0, 0.0, -1.0]], [world / np.linalg.norm(world)])
    x, y, z = -direction
    turned = Rotation.from_euler("xyz", [np.arctan2(y, z) if y or z else 0.0, -np.arcsin(np.clip(x, -1, 1)), 0.0])
    angles = np.rint(roll_pitch_yaw((upright.inv() * turned).as_matrix())) + 0.0
    return tuple(np.where(angles == -180, 180.0, angles).tolist())


def _power(mechanism: Mechanism, motion: Motion, measured: Mapping[str, np.ndarray]) -> float:
    """Mean power of the measured torques, over their sizes times those of the velocities."""
    felt = [k for k, name in enumerate(mechanism.tree.freedoms) if name in measured]
    torques = np.stack([measured[mechanism.tree.freedoms[k]] for k in felt], axis=1)
    dq = motion.dq[:, felt] - motion.dq[:, felt].mean(axis=0)
    size = float((torques.std(axis=0) * dq.std(axis=0)).sum())
    return float((torques * dq).mean(axis=0).sum()) / max(size, 1e-300)


def _joint_of(mechanism: Mechanism, change: np.ndarray) -> str | None:
    """The hinge that alone carries all others, if gravity changes by as much as by another zero of it."""
    tree = mechanism.tree
    first = [i for i in tree.moving if not any(i in tree.carried(k) for k in tree.moving if k != i)]
    body = tree.bodies[first[0]]
    if len(first) > 1 or body.is_ball or not body.turns:
        return None
    return body.joint if abs(tree.screws[first[0]][3:, 0] @ change) < 0.02 else None
