"""What a model and a log give: base parameters, how well they predict, and whether to believe them."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from experiments.studies.preparation import COMPONENTS, Prepared
from ident.errors import ExcitationError, InputError
from ident.estimation.robust import RobustFit, independent, robust_fit
from ident.geometry.se3 import coAd, inverse
from ident.judgement import diagnosis
from ident.judgement.diagnosis import ContactCheck, FrameCheck
from ident.judgement.misalignment import Misalignment, estimate_misalignment
from ident.mechanism.motion import BaseMotion
from ident.model.regressor import base_wrench_regressor
from ident.recordings.wrench import GROUND

HOLDOUT = 0.4
"""Fraction of a recording, its end, that is kept to judge by."""

LEAST_HELD_OUT = 2
"""Samples that a held-out part needs: a signal's standard deviation takes two."""

UNEXPLAINED = 0.9
"""Held-out residual over standard deviation from which a channel counts as not explained."""

CONDITION_LIMIT = 1e4
"""Condition number of the unit-norm columns from which parameters are not separated."""


Found = TypeVar("Found")


class _NotCheckedError(Exception):
    """Something cannot be checked; the message says why."""


@dataclass(frozen=True, eq=False)
class Weight:
    """The recording at a glance, kg.

    Attributes:
        measured: Mean vertical force over gravity.
        model: Mass of the model.
        drift: How much the measured one drifts over the fitted part, beyond what the motion explains.
    """

    measured: float
    model: float
    drift: float


@dataclass(frozen=True, eq=False)
class HeldOut:
    """What the fit has never seen.

    Attributes:
        time: Sample times, s (M,).
        measured: Measured channels (M, C).
        residual: Measured minus predicted (M, C).
        columns: Columns of the base parameters (M, C, r).
    """

    time: np.ndarray
    measured: np.ndarray
    residual: np.ndarray
    columns: np.ndarray

    @property
    def ratio(self) -> np.ndarray:
        """RMS residual over the signal's standard deviation, of each channel (C,)."""
        return self.ratio_with(np.zeros(self.columns.shape[2]))

    def ratio_with(self, change: np.ndarray) -> np.ndarray:
        """The same if the base parameters were changed (r,)."""
        residual = self.residual - self.columns @ change
        return np.sqrt((residual**2).mean(axis=0)) / np.maximum(self.measured.std(axis=0), 1e-300)


@dataclass(frozen=True, eq=False)
class Identification:
    """Result of fitting one log.

    Attributes:
        prepared: What was fitted.
        fit: The fit on the first part of the recording.
        names: Names of its columns: base parameters, drives, offsets.
        inseparable: Channels whose constant offset cannot be told from parameters.
        offsets: Constant offset of each channel where it can, fitted or not, with its standard deviation.
        part: Samples that were fitted.
        held_out: Those that were not: the end of the recording, or another one.
        singular_values: Of the unit-norm columns of base parameters and drives, each channel weighted.
        weight: Static check; None where it cannot be made.
        frames: Check of each wrench's sign and axes by its name.
        contact: What an unmeasured contact would explain, None where not all six components are there.
        misalignment: Tilts of the axes, None where no joint turns or no wrench is there, or they were not looked for.
        correlation: Correlation time of each channel's residual, s (C,).
        unchecked: Sentences on what could not be checked, and why.
    """

    prepared: Prepared
    fit: RobustFit
    names: tuple[str, ...]
    inseparable: tuple[str, ...]
    offsets: dict[str, tuple[float, float]]
    part: slice
    held_out: HeldOut
    singular_values: np.ndarray
    weight: Weight | None
    frames: dict[str, FrameCheck]
    contact: ContactCheck | None
    misalignment: Misalignment | None
    correlation: np.ndarray
    unchecked: tuple[str, ...]

    @property
    def psi(self) -> np.ndarray:
        """Base parameters (r,)."""
        return self.fit.values[: self.prepared.base.rank]

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the base parameters (r, r)."""
        rank = self.prepared.base.rank
        return self.fit.covariance[:rank, :rank]

    @property
    def condition_number(self) -> float:
        """Condition number of the unit-norm, weighted columns."""
        return float(self.singular_values[0] / self.singular_values[-1])

    @property
    def unexplained(self) -> tuple[str, ...]:
        """Channels that this motion and model do not explain."""
        return tuple(c for c, r in zip(self.prepared.channels, self.held_out.ratio, strict=True) if r > UNEXPLAINED)


def identify_log(
    prepared: Prepared,
    *,
    offsets: bool = True,
    weighted: bool = True,
    holdout: float = HOLDOUT,
    other: Prepared | None = None,
    axes: bool = True,
) -> Identification:
    """Fits one part of a recording, judges the fit on another, and checks everything that can be checked.

    Args:
        prepared: Model and log.
        offsets: Whether to fit a constant offset of every channel that can be told from the parameters.
        weighted: Whether to weight channels by their residuals and outliers down; else ordinary least squares.
        holdout: Fraction of the recording, its end, that is not fitted.
        other: Another log of the same channels to judge by, of any length; then the whole recording is fitted.
        axes: Whether to look for joint axes that are off.

    Raises:
        ExcitationError: The motion does not separate the base parameters.
        InputError: The recording is too short, or the other log has other channels.
    """
    samples, edge = len(prepared.time), prepared.edge
    if other is not None and other.channels != prepared.channels:
        raise InputError(
            f"The log to judge by needs the channels {', '.join(prepared.channels)}; "
            f"it has {', '.join(other.channels)}."
        )
    split = samples - edge if other is not None else round((1 - holdout) * samples)
    part = slice(edge, split)
    columns, constants = prepared.reduced, np.tile(np.eye(len(prepared.channels)), (samples, 1, 1))
    needed = columns.shape[2] + len(prepared.channels)
    if 2 * edge >= samples:
        raise InputError(
            f"A cut-off of {prepared.cutoff:g} Hz settles in {edge} samples at either end, more than half of the "
            f"{samples} recorded; take a higher one."
        )
    if other is not None and len(other.time) - 2 * other.edge < LEAST_HELD_OUT:
        raise InputError(
            f"The log to judge by has {len(other.time)} samples; with {other.edge} left out at either end, where the "
            "filter settles, nothing remains."
        )
    if not np.ptp(prepared.measured[part], axis=0).any():
        raise InputError("Every measured channel is constant; there is nothing to fit.")
    if split - edge < needed or (other is None and samples - edge - split < LEAST_HELD_OUT):
        raise InputError(
            f"{samples} samples, {edge} left out at either end and {holdout:.0%} held out, are too few for "
            f"{columns.shape[2]} parameters."
        )
    singular_values = _singular_values(prepared, columns[part])
    separable = independent(columns[part], constants[part])
    with_offsets = np.concatenate([columns, constants[:, :, separable]], axis=2)
    full = robust_fit(with_offsets[part], prepared.measured[part], weighted=weighted)
    fit = full if offsets else robust_fit(columns[part], prepared.measured[part], weighted=weighted)
    named = [f"offset({prepared.channels[k]})" for k in separable]
    found = slice(columns.shape[2], None)
    unchecked: list[str] = [] if axes else ["Joint axes were not checked (--no-axes)."]
    return Identification(
        prepared=prepared,
        fit=fit,
        names=(*prepared.base.names, *prepared.drives, *(named if offsets else ())),
        inseparable=tuple(c for k, c in enumerate(prepared.channels) if k not in separable),
        offsets={
            prepared.channels[k]: (float(v), float(std))
            for k, v, std in zip(separable, full.values[found], full.std[found], strict=True)
        },
        part=part,
        held_out=_held_out(other or prepared, 0 if other else split, fit.values, separable if offsets else []),
        singular_values=singular_values,
        weight=_checked("The weight", lambda: _weight(prepared, fit, part), unchecked),
        frames=_frames(prepared),
        contact=_checked("A contact left out", lambda: _contact(prepared, fit.residual, part), unchecked),
        misalignment=_checked("Joint axes", lambda: _misalignment(prepared, fit, part), unchecked) if axes else None,
        correlation=diagnosis.correlation_time(fit.residual, prepared.rate),
        unchecked=tuple(unchecked),
    )


def _checked(what: str, check: Callable[[], Found], unchecked: list[str]) -> Found | None:
    """What a check finds; if it cannot be made, None and a sentence more."""
    try:
        return check()
    except (_NotCheckedError, ValueError) as error:
        unchecked.append(f"{what} could not be checked: {error}.")
        return None


def _held_out(prepared: Prepared, start: int, values: np.ndarray, offsets: list[int]) -> HeldOut:
    part = slice(max(start, prepared.edge), len(prepared.time) - prepared.edge)
    columns = prepared.reduced[part]
    constants = np.tile(np.eye(len(prepared.channels))[:, offsets], (len(columns), 1, 1))
    residual = prepared.measured[part] - np.concatenate([columns, constants], axis=2) @ values
    return HeldOut(prepared.time[part], prepared.measured[part], residual, columns[:, :, : prepared.base.rank])


def _singular_values(prepared: Prepared, columns: np.ndarray) -> np.ndarray:
    """Singular values of the weighted unit-norm columns; a motion that leaves one at rounding is refused."""
    weighted = columns / np.maximum(prepared.measured.std(axis=0), 1e-300)[:, None]
    rows = weighted.reshape(-1, columns.shape[2])
    norms = np.linalg.norm(rows, axis=0)
    # Of a triangle the decomposition is quicker, and fails to converge less easily, than of all rows.
    _, s, directions = np.linalg.svd(np.linalg.qr(rows / np.where(norms > 0, norms, 1), mode="r"))
    hidden = directions[s <= s[0] / CONDITION_LIMIT]
    if len(hidden):
        size = np.linalg.norm(hidden, axis=0)
        names = [*prepared.base.names, *prepared.drives]
        blamed = [name for name, part in zip(names, size, strict=True) if part > 0.1 * size.max()]
        raise ExcitationError(
            f"In {', '.join(prepared.channels)} the recorded motion excites {len(s) - len(hidden)} of {len(s)} "
            f"parameters; it does not separate {', '.join(blamed)}. Move the joints further (experiments.excite "
            "designs a motion), or measure more."
        )
    return s


def _weight(prepared: Prepared, fit: RobustFit, part: slice) -> Weight:
    """Mass that the forces along gravity carry; the sensor's other axes may be missing."""
    g = np.linalg.norm(prepared.gravity)
    known = np.isfinite(prepared.wrench[:, :3]).all(axis=0)
    if g == 0:
        raise _NotCheckedError("the model has no gravity")
    if not known.any():
        raise _NotCheckedError("no force is measured")
    motion = prepared.motion
    in_base = prepared.gravity if motion is None else motion.T[:, :3, :3].swapaxes(1, 2) @ prepared.gravity
    down = np.broadcast_to(in_base @ prepared.frame[:3, :3], prepared.wrench[:, :3].shape)
    missing = [
        c for c, k, d in zip(COMPONENTS[:3], known, np.abs(down).max(axis=0), strict=True) if d > 0.1 * g and not k
    ]
    if missing:
        raise _NotCheckedError(f"it shows in {', '.join(missing)} of the sensor, not measured here")
    along = -(prepared.wrench[:, :3] * down)[:, known].sum(axis=1) / g**2
    beyond = -(fit.residual[:, : known.sum()] * down[part][:, known]).sum(axis=1) / g**2
    time = np.arange(len(beyond)) - (len(beyond) - 1) / 2
    slope = (time @ beyond) / (time @ time)
    model = float(prepared.prior.reshape(-1, 10)[:, 0].sum())
    return Weight(float(along.mean()), model, float(slope * len(beyond)))


def _frames(prepared: Prepared) -> dict[str, FrameCheck]:
    """Sign and axes of each wrench against what the model's own φ predicts, the other wrenches given."""
    P = len(prepared.base.parameters)
    if not np.isfinite(prepared.wrench).any():
        return {}
    Y = base_wrench_regressor(prepared.tree, *prepared.states, gravity=prepared.gravity, base=prepared.motion)
    predicted = (coAd(inverse(prepared.frame)) @ (Y @ prepared.prior[:P])[..., None])[..., 0]
    checks = {}
    poses = prepared.tree.poses(prepared.states[0])
    for name in prepared.log.wrenches:
        wrench = prepared.log.wrench(name)
        if name == GROUND:
            others = prepared.wrench - wrench.on_mechanism
            checks[name] = diagnosis.check_frame(
                wrench.on_mechanism, predicted - np.nan_to_num(others), wrench.pose[:3, :3]
            )
            continue
        pose = poses[:, prepared.tree.names.index(str(wrench.body))] @ wrench.pose
        in_frame = coAd(inverse(prepared.frame)) @ coAd(pose)
        others = prepared.wrench - (in_frame @ wrench.on_mechanism[..., None])[..., 0]
        if np.isfinite(others).all():
            missing = (np.linalg.inv(in_frame) @ (predicted - others)[..., None])[..., 0]
            checks[name] = diagnosis.check_frame(wrench.on_mechanism, missing, wrench.pose[:3, :3])
    return checks


def _contact(prepared: Prepared, residual: np.ndarray, part: slice) -> ContactCheck | None:
    known = np.isfinite(prepared.wrench).all(axis=0)
    if not known.any():
        return None
    if not known.all():
        raise _NotCheckedError(f"it shows in {', '.join(np.array(COMPONENTS)[~known])}, not measured here")
    in_base = (coAd(prepared.frame) @ residual[:, :6, None])[..., 0]
    return diagnosis.check_contact(prepared.tree, prepared.states[0][part], in_base)


def _misalignment(prepared: Prepared, fit: RobustFit, part: slice) -> Misalignment | None:
    known = np.isfinite(prepared.wrench).all(axis=0)
    turning = [prepared.tree.bodies[i] for i in prepared.tree.moving]
    if not known.any() or not any(not body.is_ball and body.twist[3:].any() for body in turning):
        return None
    scale = np.full(6, np.inf)
    scale[known] = fit.scale[: known.sum()]
    motion = prepared.motion
    moving = None if motion is None else BaseMotion(motion.T[part], motion.V[part], motion.dV[part])
    q, dq, ddq = (x[part] for x in prepared.states)
    return estimate_misalignment(
        prepared.tree,
        (q, dq, ddq),
        prepared.wrench[part],
        scale,
        gravity=prepared.gravity,
        base=moving,
        frame=prepared.frame,
    )
