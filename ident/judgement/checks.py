"""Checks of a fitted recording against the model: weight, signs, axes and frames of wrenches, contacts left out."""

from collections.abc import Callable, Collection, Mapping, Sequence
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from scipy import linalg

from ident.errors import InputError
from ident.estimation.accumulator import triangle_of
from ident.estimation.equations import COMPONENTS, predicted_channels
from ident.estimation.preparation import Prepared
from ident.geometry.se3 import applied, coAd, hat, inverse
from ident.judgement import model_fit
from ident.judgement.residuals import FAR_ABOVE
from ident.judgement.torque_checks import TorqueChecks, torque_checks
from ident.mechanism.tree import Tree
from ident.recordings.smoothing import white_noise
from ident.recordings.wrench import GROUND, pose_in_base
from ident.regression.ordinary import Fit
from ident.tolerances import CLEARLY, FAR_BETTER, NOTABLY, ROUNDING


class FrameCheck(NamedTuple):
    """Sign and rotation with which a measured wrench agrees best with the predicted one.

    Attributes:
        sign: 1, or -1 if action and reaction were mistaken for each other.
        rotation: The rotation, by multiples of 90° or of a transposed frame (3, 3).
        error: Relative error of the wrench as it is, over that of the prediction.
        error_turned: The same with sign and rotation.
        mirrored: Components with the opposite sign, which no sign or rotation of the whole explains.
    """

    sign: int
    rotation: np.ndarray
    error: float
    error_turned: float
    mirrored: tuple[str, ...] = ()

    @property
    def suspicious(self) -> bool:
        """True if another sign or other axes fit far better."""
        turned = self.sign < 0 or not np.array_equal(self.rotation, np.eye(3))
        return bool(turned and self.error_turned < FAR_BETTER * self.error and not self.mirrored)


class BaseCheck(NamedTuple):
    """Another resting body in whose frame the ground's wrench fits the prediction far better.

    Attributes:
        body: Name of the body in whose frame it fits best.
        error: Relative error of the wrench as it was stated, over that of the prediction.
        error_there: The same in the frame of that body.
    """

    body: str
    error: float
    error_there: float


NEAR = 0.12
"""Distance within which forces pass a body that is likely, m: half a foot, along which they wander."""


class ContactCheck(NamedTuple):
    """The unmeasured contact that explains a residual wrench best.

    Attributes:
        body: Name of the body that it would be on.
        point: Where, in the body's frame, m (3,).
        explained: Fraction of the residual moment that forces through that point explain, about the base's origin, or
            about the ground's sensor where the forces are near its noise.
        distance: Distance of the forces from that point, plus a weighted one of the point from the body's joints, m.
    """

    body: str
    point: np.ndarray
    explained: float
    distance: float


def check_frame(measured: np.ndarray, predicted: np.ndarray, rotation: np.ndarray) -> FrameCheck:
    """Check of a wrench's sign and axes: both signs, all 24 right-angled rotations, and the transposed frame.

    If no other sign or axes fit better, forces alone are compared: moments also depend on the sensor's origin.

    Args:
        measured: Wrench in the sensor's frame, NaN in channels that are not measured (N, 6).
        predicted: What the prior model predicts there (N, 6).
        rotation: Rotation of the sensor's frame in the frame that it is mounted on (3, 3).
    """
    known = np.isfinite(measured).all(axis=0)
    whole = np.where(known, measured, 0)
    check = _best_turn(whole, predicted, known, rotation)
    if not check.suspicious and known[:3].all():
        forces = _best_turn(whole, predicted, known & (np.arange(6) < 3), rotation)
        check = forces if forces.suspicious else check
    mirrored = _mirrored(whole, predicted, known)
    turned = whole @ (check.sign * linalg.block_diag(check.rotation, check.rotation)).T
    if check.suspicious and len(_mirrored(turned, predicted, known)) < len(mirrored):
        return check
    return check._replace(mirrored=tuple(np.array(COMPONENTS)[mirrored].tolist()))


def _mirrored(measured: np.ndarray, predicted: np.ndarray, known: np.ndarray) -> list[int]:
    """Components that are far nearer to their predictions with the opposite sign, by a factor of 0.4.

    Their predictions have at least a tenth of the size of the whole force or moment.
    """
    signs = []
    # Offsets may be large, and motions small beside the weight.
    for x, y in ((measured, predicted), (measured - measured.mean(axis=0), predicted - predicted.mean(axis=0))):
        as_is, opposite = (np.linalg.norm(x - sign * y, axis=0) for sign in (1, -1))
        sizes = np.linalg.norm(y, axis=0)
        notable = sizes > 0.1 * np.repeat(np.linalg.norm(sizes.reshape(2, 3), axis=1), 3)
        signs.append(notable * (1 * (opposite < 0.4 * as_is) - (as_is < opposite)))
    return np.flatnonzero(known & (np.max(signs, axis=0) > 0) & (signs[1] >= 0)).tolist()


def _best_turn(measured: np.ndarray, predicted: np.ndarray, known: np.ndarray, rotation: np.ndarray) -> FrameCheck:
    scale = _scale(predicted)
    # Combinations of few columns have the norms that those of their triangular factor have.
    measured, predicted = np.hsplit(triangle_of(np.hstack([measured, predicted])), 2)

    def error(sign: int, R: np.ndarray) -> float:
        turn = sign * linalg.block_diag(R, R)
        return _size((measured @ turn.T - predicted) / scale, np.abs(turn) @ known > 0)

    straight, *right_angled = model_fit.right_angled_rotations()
    simple = [(1, straight), (-1, straight), (1, rotation.T @ rotation.T)]
    turns = simple + [(sign, R) for sign in (1, -1) for R in right_angled]
    errors = [error(*turn) for turn in turns]
    # In a planar motion several fit; the simplest mistake is the likeliest.
    best = next(k for k, each in enumerate(errors) if each <= max(CLEARLY * min(errors), ROUNDING))
    sign, R = turns[best]
    return FrameCheck(sign, R, errors[0], errors[best])


def _size(off: np.ndarray, known: np.ndarray) -> float:
    """Size of errors of the components that are known, over those of a force or moment (N, 6)."""
    return float(np.linalg.norm(off[:, known]) / np.sqrt(known.sum() / 3))


def _scale(predicted: np.ndarray) -> np.ndarray:
    """Size of forces and of moments, for each component (6,)."""
    size = np.linalg.norm(predicted.reshape(-1, 2, 3), axis=(0, 2))
    return np.repeat(np.maximum(size, 1e-3 * size.max(initial=1e-12)), 3)


def check_base(
    tree: Tree, q: np.ndarray, frame: np.ndarray, measured: np.ndarray, predicted: np.ndarray
) -> BaseCheck | None:
    """Check of the frame in which a sensor measures: the base's, and those of all bodies that rest in it.

    Args:
        tree: The mechanism.
        q: Joint coordinates of one sample (n_q,).
        frame: Pose of the sensor's frame as it was stated, in the base frame (4, 4).
        measured: Wrench in the sensor's frame, NaN in channels that are not measured (N, 6).
        predicted: What the prior model predicts there (N, 6).

    Returns:
        The best of them; None if it is not far better than the base's.
    """
    poses = tree.poses(q[None])[0]
    in_base, known = predicted @ coAd(frame).T, np.isfinite(measured).all(axis=0)

    def error(T: np.ndarray) -> float:
        return _size((measured - in_base @ coAd(inverse(T @ frame)).T) / _scale(predicted), known)

    stated, rest = error(np.eye(4)), (i for i in range(len(poses)) if i not in tree.moved)
    others = (i for i in rest if not np.allclose(poses[i], np.eye(4), atol=1e-6))
    checks = [BaseCheck(tree.names[i], stated, error(poses[i])) for i in others]
    best = min(checks, key=lambda check: check.error_there, default=None)
    return best if best is not None and best.error_there < FAR_BETTER * stated else None


def check_contact(
    tree: Tree, q: np.ndarray, residual: np.ndarray, usual: Collection[str] = (), near: float = NEAR
) -> ContactCheck:
    """Contact at which an unmeasured force explains a residual wrench best.

    The residual moment is least-squares fitted by `(p_i + R_i c) × F`. Over a short time forces nearly always pass
    through some point that moves with a body, if it may be far from it: points count as worse the farther they are.

    Args:
        tree: The mechanism.
        q: Joint coordinates (N, n_q).
        residual: Measured less predicted wrench in the base frame, all six channels (N, 6).
        usual: Bodies that are likely: one of them it is if the forces pass near it, or as near as any other.
        near: What counts as near, m.

    Returns:
        The best body and point.
    """
    poses = tree.poses(q)
    checks = [_contact_on(tree, i, poses[:, i], residual) for i in tree.inertial]
    # Of a person who walks on two plates, forces pass the shank by 2 % less than the foot on the plate.
    near = max(near, NOTABLY * min(check.distance for check in checks))
    likely = [check for check in checks if check.body in usual and check.distance < near]
    return min(likely or checks, key=lambda check: check.distance)


def _contact_on(tree: Tree, i: int, T: np.ndarray, residual: np.ndarray) -> ContactCheck:
    """Contact on one body that explains a residual wrench best, near its own joint or one that it carries.

    Args:
        tree: The mechanism.
        i: Index of the body.
        T: Its poses in the base frame (N, 4, 4).
        residual: As for `check_contact`.
    """
    force, moment = residual[:, :3], residual[:, 3:]
    R, p = T[:, :3, :3], T[:, :3, 3]
    every = triangle_of(np.column_stack([(-hat(force) @ R).reshape(-1, 3), (moment - np.cross(p, force)).ravel()]))
    rows, target = every[:, :3], every[:, 3]
    point = _least_squares(rows, target)
    total, left = (moment**2).sum(), ((target - rows @ point) ** 2).sum()
    pushed, distances = max(float(np.linalg.norm(force)), ROUNDING), []
    # The point's distance from the body's joints counts less than that of the forces from the point.
    weight = 0.2
    near = np.vstack([rows / pushed, weight * np.eye(3)])
    for joint in [np.zeros(3), *(body.home[:3, 3] for body in tree.bodies if body.parent == i)]:
        aim = np.append(target / pushed, weight * joint)
        distances.append(float(np.linalg.norm(aim - near @ _least_squares(near, aim))))
    return ContactCheck(tree.bodies[i].name, point, float(1 - left / total) if total else 0.0, min(distances))


def _least_squares(rows: np.ndarray, target: np.ndarray) -> np.ndarray:
    # Another driver's SVD can fail to converge on finite data.
    return np.asarray(linalg.lstsq(rows, target, cond=1e-12, lapack_driver="gelsy")[0])


class NotCheckedError(Exception):
    """A check that cannot be made: `no gravity`, `no force`, or `not measured` or `not fitted` and these channels."""


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

    gravity: model_fit.GravityCheck | None
    unchecked: Sequence[Mapping[str, Any]] = ()
    delay: model_fit.DelayCheck | None = None
    frames: Mapping[str, FrameCheck] = MappingProxyType({})
    base: BaseCheck | None = None
    weight: Weight | None = None
    contact: ContactCheck | None = None
    torques: TorqueChecks | None = None

    @property
    def grossly_wrong(self) -> bool:
        """True if gravity, a wrench or a torque has another direction, frame, sign or unit than stated."""
        turned = self.gravity is not None and self.gravity.suspicious
        wrench = self.base is not None or any(each.suspicious or each.mirrored for each in self.frames.values())
        return turned or wrench or (self.torques is not None and self.torques.grossly_wrong)


def checked(prepared: Prepared, fit: Fit, part: slice) -> Checks:
    """Makes all checks that can be made; those against the model's weight only if gravity is as stated.

    Args:
        prepared: The recording.
        fit: What was fitted to a part of it.
        part: That part.
    """
    gravity = model_fit.recorded_gravity(prepared)
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
            reason, *channels = error.args
            unchecked.append({"check": name, "reason": reason, "channels": tuple(channels), "error": ""})
        except (InputError, np.linalg.LinAlgError) as error:
            unchecked.append({"check": name, "reason": "error", "channels": (), "error": str(error)})
    return Checks(gravity, unchecked, model_fit.delay_check(prepared), *wrench_checks(prepared), **results)


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
        raise NotCheckedError("not measured", *missing)
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
        base = check_base(mechanism.tree, motion.q[0], prepared.frame, prepared.wrench, predicted)
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
            checks[name] = check_frame(own, missing, wrench.pose[:3, :3])
    return checks


def _contact(prepared: Prepared, residual: np.ndarray, part: slice) -> ContactCheck | None:
    known = np.isfinite(prepared.wrench).all(axis=0)
    if not known.any():
        return None
    if not known.all():
        raise NotCheckedError("not fitted", *np.array(COMPONENTS)[~known].tolist())
    tree, q = prepared.mechanism.tree, prepared.samples.motion.q[prepared.taken(part)]
    in_base = (coAd(prepared.frame) @ residual[:, :6, None])[..., 0]
    # Noise is no contact that was left out: it may seem to be a force on any body, one with a sensor among them, and
    # wanders by a fifteenth of the mechanism's size, half a foot of a person.
    measured = {sensor.body for name, sensor in prepared.recording.sensors.items() if sensor.body and name != GROUND}
    size = float(np.linalg.norm(np.ptp(tree.poses(q)[:, :, :3, 3], axis=1), axis=1).max())
    check = check_contact(tree, q, in_base, measured, near=min(NEAR, size / 15))
    if GROUND in prepared.recording.wrenches:
        # Noise of the ground's forces is forces through its sensor, about which it has no moment.
        force, moment = residual[:, :3], residual[:, 3:6]
        read = prepared.recording.wrench(GROUND).on_mechanism[:, :3]
        noise = np.linalg.norm([white_noise(x, robust=True) for x in read.T])
        if np.linalg.norm(force) < FAR_ABOVE * noise * np.sqrt(len(force)):
            left = (1 - check.explained) * (in_base[:, 3:] ** 2).sum()
            check = check._replace(explained=float(1 - left / max((moment**2).sum(), ROUNDING)))
    return check
