"""Models fitted to a recording, and errors of estimates over many of them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.errors import ExcitationError
from ident.estimate import Estimate
from ident.estimation.equations import Equations
from ident.estimation.preparation import prepared
from ident.estimation.samples import Samples
from ident.identification import identified
from ident.mechanism.body import BASE
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.mechanism.recovered_axes import Direction, RecoveredAxes, check_revolute, with_axes
from ident.mechanism.tree import Tree
from ident.parameters.base_parameters import BaseParameters, structural_base_parameters
from ident.recordings.recording import STATES, Recording
from ident.regression.ordinary import Fit, huber_white, least_squares
from ident.setup import PRIORS
from ident.tolerances import INTERVAL


@dataclass(frozen=True, eq=False)
class Errors:
    """Errors of base parameters over many recordings.

    Attributes:
        names: Names of the parameters.
        errors: Error in each recording (recordings, parameters).
        predicted: Standard deviations that each estimate predicted from its recording (recordings, parameters).
    """

    names: tuple[str, ...]
    errors: np.ndarray
    predicted: np.ndarray

    @property
    def mean(self) -> np.ndarray:
        """Mean error: the bias of the estimates."""
        return self.errors.mean(axis=0)

    @property
    def std(self) -> np.ndarray:
        """Spread of the errors."""
        return self.errors.std(axis=0, ddof=1)

    @property
    def interval(self) -> np.ndarray:
        """Limits of the central 95 % of the errors (2, parameters)."""
        return np.percentile(self.errors, [2.5, 97.5], axis=0)

    @property
    def predicted_std(self) -> np.ndarray:
        """Root mean square of the predicted standard deviations."""
        return np.sqrt(np.mean(self.predicted**2, axis=0))

    @property
    def covered(self) -> np.ndarray:
        """True where a recording's own 95 % interval holds the truth (recordings, parameters)."""
        return np.abs(self.errors) <= INTERVAL * self.predicted

    @property
    def coverage(self) -> np.ndarray:
        """Fraction of recordings whose own 95 % interval holds the truth."""
        return np.mean(self.covered, axis=0)


TRAJECTORY = "_trajectory"
"""Suffix of a model's name for its trajectory estimate."""


@dataclass(frozen=True, eq=False)
class Distribution(Errors):
    """Errors of one model's base parameters over the trials, and the paper's errors.

    Attributes:
        published: The paper's errors (parameters,).
    """

    published: np.ndarray

    @property
    def percentile(self) -> np.ndarray:
        """Percentiles of the paper's errors among the trials, at both limits of their rounding in print (2, p)."""
        low, high = self.published - 0.005, self.published + 0.005
        return 100 * np.array([np.mean(self.errors < limit, axis=0) for limit in (low, high)])


ESTIMATORS = {
    "ordinary": "the paper's least squares, at measured joint angles, velocities and accelerations",
    "weighted": "the same, weighted by the covariance of the wrenches' noise",
    "trajectory": "parameters and motion at once, from joint angles and wrenches alone; set-up as stated, no offsets",
}
"""Estimators of the studies."""


@dataclass(frozen=True, eq=False)
class Trial:
    """A model's base parameters by one estimator, and the true ones by the same regrouping.

    Attributes:
        base: The regrouping.
        psi: Base parameters, NaN where the recording does not determine them (r,).
        std: Their standard deviations (r,).
        psi_true: True base parameters (r,).
    """

    base: BaseParameters
    psi: np.ndarray
    std: np.ndarray
    psi_true: np.ndarray

    @property
    def error(self) -> np.ndarray:
        """Estimated minus true base parameters."""
        return self.psi - self.psi_true

    @property
    def largest_error(self) -> float | None:
        """The largest error; None without an estimate."""
        return float(np.abs(self.error).max()) if np.isfinite(self.psi).all() else None

    @property
    def rms_z(self) -> float | None:
        """RMS of the errors over their standard deviations; None without an estimate."""
        return float(np.sqrt(np.mean((self.error / self.std) ** 2))) if np.isfinite(self.psi).all() else None


@dataclass(frozen=True, eq=False)
class Fitted(Trial):
    """A trial by least squares; standard deviations are due to noise on the wrenches.

    Attributes:
        estimate: The fit.
        predicted: Total wrench that it predicts at the measured joint states (N, 6).
    """

    estimate: Fit
    predicted: np.ndarray


def fit(
    mechanism: Mechanism,
    recording: Recording,
    *,
    wrench: np.ndarray | None = None,
    covariance: np.ndarray | None = None,
    kept: Sequence[str] | None = None,
) -> Fitted:
    """Base parameters of one model from measured joint states and wrenches.

    Args:
        mechanism: The model's mechanism, with the true φ as its prior.
        recording: Measured joint states and ground wrench.
        wrench: Total wrench `[F; τ]`, N and N m (N, 6); by default the recording's ground wrench alone.
        covariance: Its covariance (N, 6, 6), to weight by; by default ordinary least squares.
        kept: Names of the base parameters; by default the first independent columns.

    Raises:
        ExcitationError: The motion does not separate the base parameters.
        InputError: `kept` is not a basis.
    """
    joints = mechanism.tree.joints
    motion = Motion(*recording.joint_states(joints))
    measured = recording.wrench("ground").values if wrench is None else wrench
    samples = Samples(motion, measured, covariance)
    base = structural_base_parameters(mechanism, kept=None if kept is None else tuple(kept))
    made = huber_white(least_squares(Equations(mechanism, base), samples), samples)
    return Fitted(base, made.psi, made.std, base.regroup(mechanism.known), made, made.predicted(motion))


def trajectory_estimate(
    mechanism: Mechanism, recording: Recording, base: BaseParameters, *, searched: bool = False
) -> Estimate:
    """Trajectory estimate of one model, from joint angles and wrenches alone.

    φ has no prior, and the set-up is as stated.

    Args:
        mechanism: The model's mechanism, with the true φ.
        recording: Measured joint angles, ground wrench, and contact wrenches with their sensors.
        base: The regrouping.
        searched: True to search for tilts of the joint axes.

    Raises:
        ExcitationError: The motion does not separate the base parameters.
        KeyboardInterrupt: The estimate was interrupted, which reports itself that it has not converged.
    """
    angles_alone = recording.without([f"{joint}_{rate}" for joint in mechanism.tree.joints for rate in STATES[1:]])
    log = prepared(mechanism, angles_alone)
    log = replace(log, equations=replace(log.equations, parameters=base))
    setup = dict.fromkeys(PRIORS, 0.0) | ({"axis": PRIORS["axis"]} if searched else {})
    estimate = identified(log, offsets=False, holdout=0, setup=setup, known=False)
    if estimate.trajectory is not None and estimate.trajectory.fit.status == "interrupted":
        raise KeyboardInterrupt
    return estimate


def searched_axes(mechanism: Mechanism, recording: Recording, significance: float) -> RecoveredAxes | None:
    """Joint axes as the trajectory estimate tilts them; those that may be parallel get a common direction.

    Arguments are those of `trajectory_estimate`, and the significance of `with_axes`.

    Returns:
        The axes; None if no tilt is found, also where tilts would be beyond what a set-up error can be.
    """
    check_revolute(mechanism.tree)
    try:
        estimate = trajectory_estimate(mechanism, recording, structural_base_parameters(mechanism), searched=True)
    except (ExcitationError, np.linalg.LinAlgError):
        return None
    if estimate.trajectory is None or not any(each.kind == "axis" for each in estimate.setup):
        return None
    measurement, fit = estimate.trajectory.measurement, estimate.trajectory.fit
    values, vectors = np.linalg.eigh(fit.covariance)
    # Tests count the rows of an influence as samples.
    root = np.zeros((max(len(recording.time), len(values)), len(values)))
    root[: len(values)] = (vectors * np.sqrt(np.maximum(values, 0))).T
    alone = []
    for body in (each for each in measurement.corrected_tree(fit.theta).bodies if each.coordinates):
        axis, tilts = body.twist[3:], measurement.of_kind("axis", body.joint)
        turned = np.cross([np.eye(3)[k] for k in tilts if k is not None], axis)
        alone.append(Direction(axis, root[:, [*tilts.values()]] @ turned))
    return with_axes(mechanism.tree, alone, significance)


def measured_poses(tree: Tree, recording: Recording) -> np.ndarray:
    """Measured pose of each body in the base frame (N, b, 4, 4); a welded body moves with its parent."""
    poses: list[np.ndarray] = []
    for body in tree.bodies:
        parent = np.tile(np.eye(4), (len(recording.time), 1, 1)) if body.parent == BASE else poses[body.parent]
        poses.append(recording.poses(body.name) if body.moves else parent @ body.home)
    return np.stack(poses, axis=1)
