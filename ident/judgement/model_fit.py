"""Misfit of a recording and a model whose bodies may be wrong: directions of gravity, and delays, that explain more.

    r(d) = t - (Y_0 + g Σ d_k Y_k) φ_0        misfit(d)² = min over x of (|r - A(d) x|² + σ² |x|²) / samples

Y_0 is the regressor of the motion without gravity, Y_k that of gravity along axis k, of the frame of a base at rest or
of recorded poses; A(d) holds the usual deviations of the model's bodies. Channels t are in units of their size.
Offsets, friction and rotors of joint torques are regressed out.

A delay of wrenches or torques behind the joint angles is one for which shifted channels fit far better.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import permutations, product
from typing import Any, NamedTuple

import numpy as np
from scipy import linalg
from scipy.spatial.transform import Rotation

from ident.estimation.equations import COMPONENTS, stated_drive_torques
from ident.estimation.preparation import Prepared
from ident.geometry.se3 import coAd, inverse, roll_pitch_yaw
from ident.judgement.residuals import BEYOND_CHANCE
from ident.judgement.torque_checks import drive_rows, without_drives
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import BaseMotion, Motion, joined
from ident.model.axes import Axes
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor
from ident.parameters.prior import known_roots
from ident.tolerances import CLEARLY, FAR_BETTER

SAMPLES = 40
"""Number of samples used, evenly spread: what the model lacks is alike for samples next to each other."""

UNMODELLED = 0.6
"""Unexplained part, over the size of a channel. Arms of six and seven joints, slow and fast, with
masses wrong by 20 to 40 % are left with 0.1 to 0.4 in gravity's right direction, and with 0.55 to 1.1 in others."""

AXIS, AWAY = np.cos(np.radians(8)), np.cos(np.radians(15))
"""Cosine of the angle from an axis up to which a fitted direction is taken as that axis; and of the one from the stated
direction up to which the set-up's tilt of gravity explains it."""

TURNS = 0.4, 0.2, 0.1, 0.05, 0.025, 0.0125
"""Turns by which a direction is searched about the best axis or corner, rad: first less than half their distance."""

STEP = 0.02
"""Spacing of delays, s."""


def right_angled_rotations() -> list[np.ndarray]:
    """The 24 rotations that map coordinate axes to coordinate axes, the identity first."""
    orders, signs = permutations(np.eye(3)), product((1, -1), repeat=3)
    turns = (np.diag(sign) @ np.array(order) + 0.0 for order, sign in product(orders, signs))
    return sorted((R for R in turns if np.linalg.det(R) > 0), key=lambda R: -np.trace(R))


@dataclass(frozen=True, eq=False)
class ModelFit:
    """Channels of a recording in units of their size, and the model's for each part of the acceleration.

    Attributes:
        measured: Measured channels (N, C).
        predicted: Of the motion, and of gravity along each axis (4, N, C).
        uncertain: Their deviations for usual deviations of the bodies (4, N, C, p).
        wrench: Names of the components of the wrench, the first channels.
        felt: Names of the freedoms whose torques are the other ones.
        drives: Columns of offset, friction and rotor of each of these torques, as of `drive_rows`.
        stated: Torques of the drives as the model states them (N, n).
        size: Sizes of the channels (C,).
        down: Stated direction of gravity (3,).
    """

    measured: np.ndarray
    predicted: np.ndarray
    uncertain: np.ndarray
    wrench: tuple[str, ...]
    felt: tuple[str, ...]
    drives: list[np.ndarray]
    stated: np.ndarray
    size: np.ndarray
    down: np.ndarray

    @classmethod
    def of(
        cls, mechanism: Mechanism, motion: Motion, measured: Mapping[str, np.ndarray], frame: np.ndarray
    ) -> "ModelFit | None":
        """Fit of a few samples; None without gravity, for a base that floats, or if nothing is measured.

        Args:
            mechanism: The mechanism, with a prior.
            motion: Its motion (N samples).
            measured: Components of the total wrench, `Fx` to `Mz`, and torques by the freedoms' names (N,) each.
            frame: Pose of the frame of these components in the base frame (4, 4).
        """
        tree, g = mechanism.tree, float(np.linalg.norm(mechanism.gravity))
        wrench = tuple(name for name in COMPONENTS if name in measured)
        felt = [k for k, name in enumerate(tree.freedoms) if name in measured]
        if mechanism.carrier or (tree.floats and motion.base is None) or not g or not (wrench or felt):
            return None
        torques, on_base = tuple(tree.freedoms[k] for k in felt), _accelerated(motion, g)
        given: dict[str, Any] = {"gravity": np.zeros(3), "base": on_base.base}
        raw, number = np.stack([measured[name] for name in (*wrench, *torques)], axis=1), len(wrench)
        Y, size = np.zeros((len(on_base), raw.shape[1], 10 * len(tree.inertial))), np.ones(raw.shape[1])
        drives, stated = drive_rows(Axes.of(tree), motion, felt), stated_drive_torques(mechanism, motion)[:, felt]
        if wrench:
            rows = coAd(inverse(frame))[[COMPONENTS.index(name) for name in wrench]]
            Y[:, :number] = rows @ base_wrench_regressor(tree, *on_base.states, **given)
            kinds = np.array([name[0] for name in wrench])
            size[:number] = [np.sqrt((raw[:, :number][:, kinds == kind] ** 2).mean()) for kind in kinds]
        if felt:
            own = joint_torque_regressor(tree, *on_base.states, **given)[:, felt]
            Y[:, number:] = np.concatenate([without_drives(drives, part) for part in np.split(own, 4)])
            whole, left = raw[:, number:].std(axis=0), without_drives(drives, raw[:, number:] - stated)
            # What is left of a torque that is mostly friction is no signal.
            size[number:] = whole * np.sqrt(((left / np.maximum(whole, 1e-300)) ** 2).mean())
        size = np.maximum(size, 1e-100)
        Y = (Y / size[:, None]).reshape(4, *raw.shape, -1)
        each = Y.reshape(*Y.shape[:3], -1, 10)
        uncertain = np.einsum("kncbp,brp->kncbr", each, known_roots(mechanism)).reshape(Y.shape)
        down = mechanism.gravity / g
        out = cls(raw, Y @ mechanism.known, uncertain, wrench, torques, drives, stated, size, down)
        return replace(out, measured=out.scaled(raw))

    def scaled(self, raw: np.ndarray) -> np.ndarray:
        """Channels in units of their size (N, C), torques without drives."""
        out, number = raw.astype(float), len(self.wrench)
        if self.felt:
            out[:, number:] = without_drives(self.drives, out[:, number:] - self.stated)
        return out / self.size

    def prediction(self, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Prediction for a direction of gravity (N C,), and its uncertainty (N C, p)."""
        each = np.append(1.0, direction)
        predicted = np.tensordot(each, self.predicted, 1).ravel()
        return predicted, np.tensordot(each, self.uncertain, 1).reshape(predicted.size, -1)

    def misfit(self, direction: np.ndarray) -> float:
        """Misfit of a direction of gravity (3,)."""
        return float(self.misfits(direction, self.measured[None])[0])

    def misfits(self, direction: np.ndarray, variants: np.ndarray) -> np.ndarray:
        """Misfit of a direction of gravity with each variant of the measured channels (v, N, C)."""
        predicted, A = self.prediction(direction)
        left = variants.reshape(len(variants), -1) - predicted
        # Orthogonal, since a model in wrong units makes columns of any size.
        Q = np.linalg.qr(np.vstack([A, UNMODELLED * np.eye(A.shape[1])]))[0][: len(A)]
        squares = (left**2).sum(axis=1) - ((left @ Q) ** 2).sum(axis=1)
        return np.sqrt(np.maximum(squares, 0) / predicted.size)

    def otherwise(self) -> float:
        """Least misfit with other signs of channels, or other offsets or axes of the wrench."""
        t, number = self.measured, len(self.wrench)
        predicted = self.prediction(self.down)[0].reshape(t.shape)
        torques = t[:, number:] * np.where((t[:, number:] * predicted[:, number:]).sum(axis=0) < 0, -1, 1)
        turns = [np.diag(signs) for signs in (*(1 - 2 * np.eye(number)), np.ones(number), -np.ones(number))]
        if number == len(COMPONENTS):
            turns += [sign * linalg.block_diag(R, R) for R in right_angled_rotations() for sign in (1, -1)]
        wrenches = [t[:, :number] @ turn.T for turn in turns]
        wrenches.append(t[:, :number] - (t - predicted)[:, :number].mean(axis=0))
        return float(self.misfits(self.down, np.stack([np.hstack([each, torques]) for each in wrenches])).min())


def _accelerated(motion: Motion, g: float) -> Motion:
    """The motion without gravity, and its postures at rest on a base accelerated against gravity along each axis."""
    rest, still = np.zeros((len(motion), 6)), np.zeros_like(motion.dq)
    base = motion.base or BaseMotion(np.broadcast_to(np.eye(4), (len(motion), 4, 4)), rest, rest)
    parts = [Motion(motion.q, motion.dq, motion.ddq, base)]
    for k in range(3):
        upwards = np.hstack([-g * base.T[:, k, :3], rest[:, :3]])
        parts.append(Motion(motion.q, still, still, BaseMotion(base.T, rest, upwards)))
    return joined(parts)


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
    # Torques with negative power would drive against friction, as masses and springs return their energy.
    other = fit.otherwise() * (1 / CLEARLY if not fit.felt or _power(mechanism, motion, measured) < -0.02 else CLEARLY)
    # Where joints move in one plane, bodies whose weight has shorter levers look like a base that is tilted out of it.
    lighter = fit.misfit(along * fit.down) if along > TURNS[-1] else np.inf
    possible = along < AWAY and misfit < min(FAR_BETTER * stated, CLEARLY**2 * other, FAR_BETTER * lighter)
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
            if not (misfit := fit.misfit(nearest)) < least:
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


class DelayCheck(NamedTuple):
    """Delay with which a model explains channels best.

    Attributes:
        of: `wrench` or `torques`.
        delay: The delay, s; negative if the angles are late.
        std: Its standard deviation, s.
        stated: Misfit without it, as of `ModelFit.misfit`.
        misfit: Misfit with it.
        suspicious: True if it explains far more than none, and more than other signs of channels do.
    """

    of: str
    delay: float
    std: float
    stated: float
    misfit: float
    suspicious: bool


def delay_check(prepared: Prepared) -> DelayCheck | None:
    """The delay of a wrench or torques that explains most; None where the base moves or commands are fitted.

    Delays of up to a second and a tenth of the recording are tried. One is beyond chance.
    """
    kept = prepared.taken(slice(prepared.edge, len(prepared.samples) - prepared.edge))
    if not prepared.recording.is_held(prepared.mechanism.tree) or prepared.recording.servos or len(kept) < 2:
        return None
    samples, time = prepared.samples[kept], prepared.recording.time[kept]
    reach = min(1.0, 0.1 * (time[-1] - time[0]))
    inside = np.flatnonzero((time >= time[0] + reach) & (time <= time[-1] - reach))
    some = inside[np.linspace(0, len(inside) - 1, min(SAMPLES, len(inside))).astype(int)]
    delays = np.arange(-reach, reach + STEP / 2, STEP)
    few = dict(zip(prepared.equations.channels, samples.measured[some].T, strict=True))
    fit = ModelFit.of(prepared.mechanism, samples.motion[some], few, prepared.frame)
    if fit is None or len(delays) < 3:
        return None
    shifted = np.array([[np.interp(time[some] + d, time, x) for x in samples.measured.T] for d in delays])
    stated, least, checks = fit.misfit(fit.down), fit.otherwise(), list[DelayCheck]()
    for of, names in (("wrench", fit.wrench), ("torques", fit.felt)):
        part = np.isin(prepared.equations.channels, names)
        variants = np.where(part, shifted.swapaxes(1, 2), samples.measured[some])
        if names:
            misfits = fit.misfits(fit.down, np.array([fit.scaled(each) for each in variants]))
            delay, std = _least(delays, misfits)
            far = misfits.min() < min(FAR_BETTER * stated, least) and abs(delay) > BEYOND_CHANCE * std
            checks.append(DelayCheck(of, delay, std, stated, float(misfits.min()), bool(far)))
    return min(checks, key=lambda check: check.misfit)


def _least(delays: np.ndarray, misfits: np.ndarray) -> tuple[float, float]:
    """Delay at the least misfit, and its standard deviation, infinite at the end of those tried."""
    k, squares = int(misfits.argmin()), misfits**2
    if k in (0, len(delays) - 1):
        return float(delays[k]), np.inf
    before, here, after = squares[k - 1 : k + 2].tolist()
    curvature = max((before - 2 * here + after) / STEP**2, 1e-300)
    shift = (before - after) / (2 * STEP * curvature)
    return float(delays[k] + shift), float(np.sqrt(2 * here / (SAMPLES * curvature)))
