"""Evidence on an estimate: its numbers, its residuals, other candidates, and checks of the recordings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from ident.estimation.preparation import Prepared
from ident.judgement.checks import Checks
from ident.judgement.setup_errors import SetupFinding
from ident.mechanism.mechanism import Mechanism
from ident.parameters.consistency import ConsistentParameters
from ident.parameters.prior import KNOWN
from ident.regression.ordinary import Fit
from ident.trajectory.result import TrajectoryEstimate


@dataclass(frozen=True)
class Unmodelled:
    """Something that the model may lack.

    Attributes:
        kind: `force`, which depends on where a body is, or `length`, from its parent's frame to its joint.
        body: Name of the body.
        ratio: Residual of what was held out with it, over that without, geometric mean over the channels.
    """

    kind: str
    body: str
    ratio: float


@dataclass(frozen=True, eq=False)
class Evidence:
    """Evidence that judges read; a judge yields no finding where an estimate lacks its entries.

    Attributes:
        fit: The fit.
        ratios: RMS residual over the signal's standard deviation, of each channel judged.
        part: Samples of the ratios, "held-out" or "fitted".
        condition_number: Condition number of the unit-norm, weighted columns.
        checks: Checks of the recording.
        offsets: Constant offset of each channel where it is identifiable, with its standard deviation.
        inseparable: Channels whose offset cannot be separated from parameters.
        scale: Standard deviation of each channel's residual.
        constant: Channels that are constant although the motion would change them.
        logs: Fitted recordings; none where samples were read piece by piece.
        trajectory: The trajectory estimate, None for other estimators.
        setup: Set-up errors.
        rivals: Ratios of other candidates on the same samples (C,), by name.
        filtered_at: Cut-off of the candidate `least squares`, Hz.
        disagreement: Root mean square z of the differences between two halves.
        disagreements: The same of each recording against the others.
        widening: Factor on the standard deviations because of the halves.
        bounded: Drives at their bound of zero: upper limit, and standard deviation with the drive free.
        friction: Share of each joint torque's residual that friction would explain.
        at_rest: Ratios of the samples that are not judged, of joints that rub and rest, NaN without any, by channel.
        in_logs: Ratios of all candidates in each recording, if each is predicted from the others (C,), by name.
        model_error: Share of each channel's residual that the motion explains beyond chance (C,).
        covariance_setup: Covariance of all coefficients with the uncertainty of the set-up (m, m).
        consistent: Physical bodies near the estimate.
        unmodelled: What the model may lack, the likeliest first; empty where residuals are no more than fast noise.
        idle: Reason, as a key of `verdict.IDLE`, by the channels that are not predicted and in which nothing could be.
    """

    fit: Fit
    ratios: Mapping[str, float]
    part: str
    condition_number: float
    checks: Checks
    offsets: Mapping[str, tuple[float, float]]
    inseparable: tuple[str, ...]
    scale: Mapping[str, float]
    constant: tuple[str, ...] = ()
    logs: Sequence[Prepared] = ()
    trajectory: TrajectoryEstimate | None = None
    setup: Sequence[SetupFinding] = ()
    rivals: Mapping[str, np.ndarray] = field(default_factory=dict)
    filtered_at: float | None = None
    disagreement: float | None = None
    disagreements: tuple[float, ...] = ()
    widening: float = 1.0
    bounded: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    friction: Mapping[str, float] = field(default_factory=dict)
    at_rest: Mapping[str, float] = field(default_factory=dict)
    in_logs: Sequence[Mapping[str, np.ndarray]] = ()
    model_error: np.ndarray | None = None
    covariance_setup: np.ndarray | None = None
    consistent: ConsistentParameters | None = None
    unmodelled: Sequence[Unmodelled] = ()
    idle: Mapping[str, str] = field(default_factory=dict)

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the channels judged."""
        return tuple(self.ratios)

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism, with the set-up of the first recording if there is one."""
        return self.logs[0].mechanism if self.logs else self.fit.equations.mechanism

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the base parameters (r, r)."""
        rank = self.fit.parameters.rank
        return self.fit.covariance[:rank, :rank]

    @property
    def known(self) -> dict[str, float]:
        """Standard deviations of the model's φ."""
        return {**KNOWN, **(self.logs[0].recording.known if self.logs else {})}
