"""Checks of a fitted recording: weight, signs and axes of wrenches, and contacts left out."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np

from ident.errors import InputError
from ident.estimation.equations import COMPONENTS
from ident.estimation.loads import predicted_channels
from ident.estimation.preparation import Prepared
from ident.geometry.se3 import applied, coAd, inverse
from ident.judgement import diagnosis
from ident.judgement.diagnosis import BaseCheck, ContactCheck, FrameCheck
from ident.judgement.gravity import GravityCheck, recorded_gravity
from ident.judgement.model_fit import DelayCheck, delay_check
from ident.judgement.torque_checks import TorqueChecks, torque_checks
from ident.recordings.wrench import GROUND, pose_in_base
from ident.regression.ordinary import Fit

NOISE_WANDERS = 1 / 15
"""Distance from a measured contact at which its noise may seem to act, of the mechanism's size: half a foot."""


class NotCheckedError(Exception):
    """A check that cannot be made.

    Attributes:
        reason: `no gravity`, `no force`, channels `not measured` or `not fitted`, or an `error`.
        channels: Channels in which it would show.
    """

    def __init__(self, reason: str, channels: Iterable[str] = ()) -> None:
        self.reason, self.channels = reason, tuple(channels)
        super().__init__(reason)


class Weight(NamedTuple):
    """Measured mass and the model's, kg.

    Attributes:
        measured: Mean vertical force over gravity.
        model: Mass of the model.
        drift: Drift of the measured one over the fitted part that the motion does not explain.
    """

    measured: float
    model: float
    drift: float


class Checks(NamedTuple):
    """Results of all checks.

    Attributes:
        gravity: Comparison of directions of gravity, None where none can be compared.
        unchecked: Values of the finding on each check that could not be made.
        delay: Delay of the channels that explains most, None where none can be tried.
        frames: Check of each wrench's sign and axes by its name.
        base: Frame in which the ground's wrench fits far better than as stated; None if it was measured there.
        weight: Static check; None where it cannot be made.
        contact: Contact that would explain the residual; None where not all six components are measured.
        torques: Checks of the joint torques, None where there are none.
    """

    gravity: GravityCheck | None
    unchecked: Sequence[Mapping[str, Any]] = ()
    delay: DelayCheck | None = None
    frames: Mapping[str, FrameCheck] = MappingProxyType({})
    base: BaseCheck | None = None
    weight: Weight | None = None
    contact: ContactCheck | None = None
    torques: TorqueChecks | None = None


def checked(prepared: Prepared, fit: Fit, part: slice) -> Checks:
    """Makes all checks that can be made; those against the model's weight only if gravity is as stated.

    Args:
        prepared: The recording.
        fit: What was fitted to a part of it.
        part: That part.
    """
    gravity = recorded_gravity(prepared)
    if gravity is not None and gravity.suspicious:
        return Checks(gravity)
    residual = fit.residual(prepared.samples[prepared.taken(part)])
    results, unchecked = dict[str, Any](), list[dict[str, Any]]()
    attempts: dict[str, Callable[[], Any]] = {
        "weight": lambda: _weight(prepared, residual, part),
        "contact": lambda: _contact(prepared, residual, part),
        "torques": lambda: torque_checks(prepared),
    }
    for name, check in attempts.items():
        try:
            results[name] = check()
        except NotCheckedError as error:
            unchecked.append({"check": name, "reason": error.reason, "channels": error.channels, "error": ""})
        except (InputError, np.linalg.LinAlgError) as error:
            unchecked.append({"check": name, "reason": "error", "channels": (), "error": str(error)})
    return Checks(gravity, unchecked, delay_check(prepared), *wrench_checks(prepared), **results)


def _weight(prepared: Prepared, residual: np.ndarray, part: slice) -> Weight:
    """Mass whose weight the measured forces carry, and its drift."""
    g = float(np.linalg.norm(prepared.mechanism.gravity))
    up, known = upward(prepared)
    whole, taken = prepared.taken(slice(None)), prepared.taken(part)
    along = (prepared.wrench[whole, :3] * up[whole])[:, known].sum(axis=1) / g
    beyond = (residual[:, : known.sum()] * up[taken][:, known]).sum(axis=1) / g
    time = np.arange(len(beyond)) - (len(beyond) - 1) / 2
    drift = float(time @ beyond / (time @ time) * len(beyond))
    # Samples that are clipped are those in which the motion needs most.
    measured = float(along.mean()) if prepared.whole.all() else standing_mass(prepared)
    return Weight(measured, prepared.mechanism.mass, drift)


def standing_mass(prepared: Prepared) -> float:
    """Mass whose weight the measured forces carry, without the forces that the model predicts for the motion, kg.

    Raises:
        NotCheckedError: There is no gravity, or no force along it is measured.
    """
    up, known = upward(prepared)
    taken = prepared.taken(slice(None))
    beyond = prepared.wrench[taken, :3] - predicted_wrench(prepared)[taken, :3]
    more = (beyond * up[taken])[:, known].sum(axis=1).mean() / np.linalg.norm(prepared.mechanism.gravity)
    return prepared.mechanism.mass + float(more)


def upward(prepared: Prepared) -> tuple[np.ndarray, np.ndarray]:
    """Upward direction in the ground sensor's axes, and the mask of the measured axes.

    Returns:
        Unit vectors (N, 3), and the mask (3,); axes that are not measured are horizontal.

    Raises:
        NotCheckedError: There is no gravity, or no force along it is measured.
    """
    mechanism, base, force = prepared.mechanism, prepared.samples.motion.base, prepared.wrench[:, :3]
    g = float(np.linalg.norm(mechanism.gravity))
    known = np.isfinite(force).all(axis=0)
    if g == 0:
        raise NotCheckedError("no gravity")
    if not known.any():
        raise NotCheckedError("no force")
    in_base = mechanism.gravity if base is None else mechanism.gravity @ base.T[:, :3, :3]
    up = np.broadcast_to(-in_base @ prepared.frame[:3, :3] / g, force.shape)
    most = np.abs(up).max(axis=0)
    missing = [c for c, k, d in zip(COMPONENTS[:3], known, most, strict=True) if d > 0.1 and not k]
    if missing:
        raise NotCheckedError("not measured", missing)
    return up, known


def predicted_wrench(prepared: Prepared) -> np.ndarray:
    """Total wrench in the ground sensor's frame that the model's own φ predicts (N, 6)."""
    by_name = predicted_channels(prepared.mechanism, prepared.samples.motion, prepared.frame)
    return np.stack([by_name[c] for c in COMPONENTS], axis=1)


def wrench_checks(prepared: Prepared) -> tuple[dict[str, FrameCheck], BaseCheck | None]:
    """Checks of the wrenches for gross errors, against the prediction of the model's own φ.

    Returns:
        Check of the sign and axes of each wrench by its name, the other wrenches given; and of the frame in which the
        ground's is measured, None where no other body rests.
    """
    if not np.isfinite(prepared.wrench).any():
        return {}, None
    mechanism, motion = prepared.mechanism, prepared.samples.motion
    predicted, base = predicted_wrench(prepared), None
    if GROUND in prepared.recording.wrenches:
        base = diagnosis.check_base(mechanism.tree, motion.q[0], prepared.frame, prepared.wrench, predicted)
    return _frames(prepared, predicted), base


def _frames(prepared: Prepared, predicted: np.ndarray) -> dict[str, FrameCheck]:
    motion, names = prepared.samples.motion, prepared.mechanism.tree.names
    wrenches, base = prepared.recording.wrenches, motion.base_poses
    # Only contacts are on bodies.
    poses = prepared.mechanism.tree.poses(motion.q if set(wrenches) - {GROUND} else motion.q[:0])
    # Without a ground contacts are whole, and components of the total are missing because they were left out.
    kept = np.isfinite(prepared.wrench).all(axis=0) | (GROUND in wrenches)
    checks = {}
    for name in wrenches:
        wrench = prepared.recording.wrench(name)
        own = wrench.on_mechanism
        if name == GROUND:
            missing = predicted - np.nan_to_num(prepared.wrench - own)
        else:
            pose = pose_in_base(wrench, poses[:, names.index(str(wrench.body))], base)
            in_frame = coAd(inverse(prepared.frame)) @ coAd(pose)
            back, felt = np.linalg.inv(in_frame), applied(in_frame, own)
            missing = applied(back, np.where(kept, predicted - (prepared.wrench - felt), 0))
            own = own if kept.all() else applied(back, np.where(kept, felt, 0))
        if np.isfinite(missing).all():
            checks[name] = diagnosis.check_frame(own, missing, wrench.pose[:3, :3])
    return checks


def _contact(prepared: Prepared, residual: np.ndarray, part: slice) -> ContactCheck | None:
    known = np.isfinite(prepared.wrench).all(axis=0)
    if not known.any():
        return None
    if not known.all():
        raise NotCheckedError("not fitted", np.array(COMPONENTS)[~known].tolist())
    tree, q = prepared.mechanism.tree, prepared.samples.motion.q[prepared.taken(part)]
    in_base = (coAd(prepared.frame) @ residual[:, :6, None])[..., 0]
    # Noise is no contact that was left out: it may seem to be a force on any body, one with a sensor among them.
    measured = {sensor.body for name, sensor in prepared.recording.sensors.items() if sensor.body and name != GROUND}
    size = float(np.linalg.norm(np.ptp(tree.poses(q)[:, :, :3, 3], axis=1), axis=1).max())
    return diagnosis.check_contact(tree, q, in_base, measured, near=min(diagnosis.NEAR, NOISE_WANDERS * size))
