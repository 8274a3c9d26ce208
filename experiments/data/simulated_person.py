"""A simulated person, identified from a wrong prior in a laboratory with known faults."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from scipy import linalg

from ident.estimate import Estimate
from ident.estimation.equations import COMPONENTS
from ident.estimation.noise import channel_scales
from ident.mechanism.mechanism import Mechanism
from ident.parameters.prior import conditioned, known_covariance
from ident.recordings.recording import Recording
from ident.tolerances import INTERVAL
from ident.trajectory.fit.piece import Piece, Point
from ident.trajectory.fit.piece_equations import normal_equations
from ident.trajectory.fit.precision import inverse_of_precision
from ident.trajectory.result import TrajectoryEstimate

CAREFUL = {
    "origin": 0.001,
    "rotation": np.radians(0.1),
    "gain": 0.002,
    "gravity": np.radians(0.05),
    "zero": np.radians(0.5),
    "axis": np.radians(0.5),
    "centre": 0.0,
}
"""Set-up uncertainty of a laboratory with calibrated plates and joints, as `ident.setup.PRIORS`."""


@dataclass(frozen=True)
class Laboratory:
    """Noise and set-up errors of a laboratory.

    Attributes:
        angle_deg: Standard deviation of joint angles, degrees.
        decay: Autocorrelation of their noise at a lag of one sample.
        position: Standard deviation of the pelvis's position, m.
        force: Standard deviation of the plates' forces, N; a tenth of it for moments, N m; a third for the rail.
        late: Delay of plates and rail, s.
        rate: Samples per second, Hz.
        rail: True if there is a rail to hold.
        markers: True if angles and the pelvis's pose are fitted to markers, instead of having noise of their own.
        marker: Standard deviation of the markers' positions, m.
        skin: Standard deviation of the skin's motion, m; see `experiments.studies.person_recordings`.
        setup: Uncertainty of its set-up, as `CAREFUL`, which its recordings state.
    """

    angle_deg: float = 0.5
    decay: float = 0.0
    position: float = 0.002
    force: float = 1.5
    late: float = 0.02
    rate: float = 100.0
    rail: bool = True
    markers: bool = False
    marker: float = 0.002
    skin: float = 0.004
    setup: Mapping[str, float] = field(default_factory=lambda: CAREFUL)

    def times(self, seconds: float) -> np.ndarray:
        """Sample times of a recording of this length, s (N,)."""
        return np.arange(round(seconds * self.rate)) / self.rate


MOVED = 0.5
"""Standard deviation over the prior one, below which a combination counts as determined."""

ROUNDING = 1e-10
"""Smallest variance over the prior one that is distinguishable from rounding."""


@dataclass(frozen=True, eq=False)
class PersonStudy:
    """Results of the study.

    Attributes:
        estimate: The estimate of all recordings.
        true: The person.
        activities: Activity of each recording.
        recordings: The recordings.
        seconds: Length of each, s.
        filtered: Base parameters by least squares at filtered states (r,).
        held_out: Base-wrench regressor of motions that were not recorded (N, 6, r); they are exact: only ψ has errors.
        laboratory: The laboratory.
    """

    estimate: Estimate
    true: Mechanism
    activities: tuple[str, ...]
    recordings: tuple[Recording, ...]
    seconds: float
    filtered: np.ndarray
    held_out: np.ndarray
    laboratory: Laboratory

    @cached_property
    def psi(self) -> np.ndarray:
        """True base parameters (r,)."""
        return self.estimate.base.regroup(self.true.known)

    @property
    def mechanism(self) -> Mechanism:
        """The person with the prior."""
        return self.estimate.prepared.mechanism

    @property
    def _trajectory(self) -> TrajectoryEstimate:
        assert self.estimate.trajectory is not None
        return self.estimate.trajectory

    @cached_property
    def distances(self) -> tuple[np.ndarray, np.ndarray]:
        """As `distances_by`, including the uncertainty of the set-up."""
        return self.distances_by(self.estimate.covariance_setup)

    def distances_by(self, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Precision and errors along independently estimated combinations of base parameters, the best known first.

        Args:
            covariance: Covariance of the fitted parameters, base parameters first (p, p).

        Returns:
            Standard deviations over the prior ones, and errors in standard deviations (k,); without combinations known
            to rounding.
        """
        rank = len(self.psi)
        variances, directions = linalg.eigh(
            covariance[:rank, :rank], known_covariance(self.mechanism, self.estimate.base)
        )
        uncertain = variances > ROUNDING
        std = np.sqrt(variances[uncertain])
        return std, directions[:, uncertain].T @ (self.estimate.psi - self.psi) / std

    @property
    def determined(self) -> np.ndarray:
        """True for combinations that the recordings determine (k,)."""
        return self.distances[0] < MOVED

    @cached_property
    def candidates(self) -> dict[str, np.ndarray]:
        """Base parameters of the compared estimators (r,)."""
        prior = self.estimate.base.regroup(self.mechanism.known)
        return {"prior": prior, "filtered least squares": self.filtered, "trajectory estimate": self.estimate.psi}

    @cached_property
    def errors(self) -> dict[str, np.ndarray]:
        """RMS errors of the wrench of motions that were not recorded over its scale, by estimator (6,)."""
        scales = channel_scales([self.held_out @ self.psi], COMPONENTS)
        off = {name: self.held_out @ (psi - self.psi) for name, psi in self.candidates.items()}
        return {name: np.sqrt((x**2).mean(axis=0)) / scales for name, x in off.items()}

    @cached_property
    def segments(self) -> dict[str, np.ndarray]:
        """φ of all segments: `true`, `prior` and `estimate`, and standard deviations `std` (b, 10) each."""
        estimate, std = self.after([self.seconds] * len(self.activities))
        true, prior = (arm.known.reshape(-1, 10) for arm in (self.true, self.mechanism))
        return {"true": true, "prior": prior, "estimate": estimate, "std": std}

    @property
    def coverage(self) -> float:
        """Coverage of the 95 % intervals of determined combinations."""
        return float((np.abs(self.distances[1][self.determined]) < INTERVAL).mean())

    @property
    def noise_of_angles(self) -> float:
        """Median of the estimated standard deviations of the hinges' angles, degrees."""
        joint = self._trajectory
        hinges = np.concatenate(
            [np.zeros(joint.measurement.of_base, bool)]
            + [np.full(body.coordinates, not body.is_ball) for body in self.true.tree.bodies]
        )
        return float(np.degrees(np.median(joint.fit.coordinate_noise[hinges])))

    def predicted_deviation(self, seconds: Sequence[float]) -> float:
        """Standard deviation of the wrench predicted for other motions, after the first seconds of each recording.

        Relative to the prior one, as a geometric mean of the channels, and from noise alone: the set-up is the
        estimated one.
        """
        both = [self._covariance(each, setup=False) for each in (seconds, [0.0] * len(self.activities))]
        now, before = ((self._squares * covariance).sum(axis=(1, 2)) for covariance in both)
        return float(np.exp(np.log(now / before).mean() / 2))

    @cached_property
    def _squares(self) -> np.ndarray:
        """Products of the columns of each channel's regressor, summed over samples (6, r, r)."""
        Y = self.held_out.swapaxes(0, 1)
        return Y.swapaxes(1, 2) @ Y

    def after(self, seconds: Sequence[float]) -> tuple[np.ndarray, np.ndarray]:
        """φ and its standard deviations, from the prior and the first seconds of each recording (b, 10) each.

        The noise is that of all of them.
        """
        estimate = self.estimate
        phi, std = conditioned(self.mechanism, estimate.base, estimate.psi, self._covariance(seconds))
        return phi.reshape(-1, 10), std.reshape(-1, 10)

    def _covariance(self, seconds: Sequence[float], *, setup: bool = True) -> np.ndarray:
        """Covariance of base parameters after the first seconds of each recording (r, r).

        Args:
            seconds: Length of each.
            setup: True to include the uncertainty of the set-up.
        """
        joint, rank = self._trajectory, self.estimate.base.rank
        fit, own = joint.fit, np.repeat(np.arange(len(joint.counts)), joint.counts)
        precision = fit.prior.precision.copy()
        for k, length in enumerate(np.array(seconds)[own].tolist()):
            precision += self._share(k, length) if length > 0 else 0.0
        open_ = (fit.free | (joint.is_setup & setup)) & (np.diag(precision) > 0)
        return inverse_of_precision(precision[np.ix_(open_, open_)])[:rank, :rank]

    def _share(self, k: int, seconds: float) -> np.ndarray:
        """Information on θ in the first seconds of a piece (p, p)."""
        joint, fit = self._trajectory, self._trajectory.fit
        if seconds >= self.seconds:
            return fit.shares[k][0]
        if (k, seconds) not in self._begun:
            begun = beginning(fit.pieces[k], seconds)
            self._begun[k, seconds] = np.zeros_like(fit.shares[k][0])
            if not len(begun.when):
                return self._begun[k, seconds]
            # A trajectory through too few samples to be determined adds no information.
            with suppress(np.linalg.LinAlgError):
                coefficients = fit.coefficients[k][: begun.spline.size]
                at = Point(begun, coefficients, fit.theta, fit.noises[begun.log])
                equations = normal_equations(joint.measurement, at, np.arange(len(fit.theta)))
                self._begun[k, seconds] = equations.eliminated.precision
        return self._begun[k, seconds]

    @cached_property
    def _begun(self) -> dict[tuple[int, float], np.ndarray]:
        """Cached shares by piece and seconds."""
        return {}


def beginning(piece: Piece, seconds: float) -> Piece:
    """The first seconds of a piece's samples and trajectory.

    A trajectory beyond the samples is hardly determined, and its equations may have no solution.
    """
    there, felt = (x < piece.origin + seconds for x in (piece.time, piece.when))
    last = max((float(x[-1]) for x in (piece.time[there], piece.when[felt]) if len(x)), default=piece.spline.start)
    # One interval more, as channels may be late.
    intervals = int((last - piece.spline.start) / piece.spline.step) + 2
    return replace(
        piece,
        spline=replace(piece.spline, intervals=min(intervals, piece.spline.intervals)),
        time=piece.time[there],
        states=piece.states[there],
        when=piece.when[felt],
        measured=piece.measured[felt],
        wrenches=piece.wrenches[felt],
        slack=None if piece.slack is None else piece.slack[felt],
    )
