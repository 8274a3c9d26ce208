"""Evidence on an estimate: its fit, predictions and residuals, errors of its set-up, and checks of the recordings."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial

import numpy as np

from ident.estimation.noise import spread
from ident.estimation.preparation import Part, Prepared
from ident.estimation.samples import Samples, joined
from ident.judgement.checks import Checks, checked
from ident.judgement.finding import SetupFinding, setup_findings
from ident.judgement.residuals import explained_by_motion, idle_channels
from ident.judgement.torque_checks import friction_shares
from ident.mechanism.mechanism import Mechanism
from ident.model.axes import stated_values
from ident.parameters.base_parameters import BaseParameters
from ident.parameters.body_bounds import BodyPrior, Rotors, scaled_root
from ident.parameters.consistency import ConsistentParameters, consistent_parameters
from ident.parameters.prior import KNOWN, guessed
from ident.regression.held_out import ESTIMATE, HeldOut
from ident.regression.ordinary import Fit
from ident.tolerances import CONDITION_LIMIT, ROUNDING
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


@dataclass(frozen=True, eq=False, repr=False)
class Evidence:
    """Base parameters from recordings, and what they are judged by.

    Attributes:
        logs: Fitted recordings, and the fitted samples of each.
        fit: The fit.
        offsets: Constant offset of each channel where identifiable, fitted or not, with its standard deviation.
        held_out: Samples on which the fit is judged: ends of the recordings, other recordings, each recording predicted
            from the rest, or the fitted samples themselves.
        singular_values: Singular values of the unit-norm columns of base parameters and drives, each channel weighted.
        trajectory: The trajectory estimate of trajectory, parameters, set-up and noise, None for other estimators.
        filtered_at: Cut-off of the candidate `least squares`, Hz; None without it.
        filtered_values: Base parameters, drives and offsets of that candidate; None without it.
        disagreement: Root mean square z of the differences between two halves, None without two.
        disagreements: Root mean square z of each recording's parameters against the others', for three or more.
        widening: Factor on the standard deviations from the noise because of that.
        widened: Larger factors of base parameters whose own halves differ beyond chance, by name.
        bounded: Drives at their bound of zero: upper limit of the one-sided 95 % interval, and standard deviation with
            the drive free.
        unmodelled: What the model may lack, the likeliest first.
        undetermined: Base parameters that the motion does not determine, where joints rest.
    """

    logs: Sequence[Part[slice]]
    fit: Fit
    offsets: dict[str, tuple[float, float]]
    held_out: HeldOut
    singular_values: np.ndarray
    trajectory: TrajectoryEstimate | None = None
    disagreement: float | None = None
    disagreements: tuple[float, ...] = ()
    widening: float = 1.0
    widened: Mapping[str, float] = field(default_factory=dict)
    filtered_at: float | None = None
    filtered_values: np.ndarray | None = None
    bounded: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    unmodelled: Sequence[Unmodelled] = ()
    undetermined: Sequence[str] = ()

    @property
    def prepared(self) -> Prepared:
        """The first recording."""
        return self.logs[0].log

    @property
    def part(self) -> slice:
        """Fitted samples of the first recording."""
        return self.logs[0].samples

    @property
    def mechanism(self) -> Mechanism:
        """The mechanism, with the set-up of the first recording."""
        return self.prepared.mechanism

    @property
    def known(self) -> dict[str, float]:
        """Standard deviations of the model's φ."""
        return {**KNOWN, **self.prepared.recording.known}

    @property
    def base(self) -> BaseParameters:
        """Regrouping of the standard parameters into base parameters."""
        return self.fit.parameters

    @property
    def psi(self) -> np.ndarray:
        """Base parameters (r,)."""
        return self.fit.psi

    @property
    def psi_of_links(self) -> np.ndarray:
        """Base parameters of the links alone, without the model's rotors and friction that they absorb (r,)."""
        return self.psi - self.fit.equations.from_drives[: self.base.rank]

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the base parameters (r, r)."""
        return self.fit.covariance[: self.base.rank, : self.base.rank]

    @cached_property
    def covariance_setup(self) -> np.ndarray:
        """Covariance of all coefficients with the uncertainty of the set-up (m, m)."""
        if self.trajectory is None:
            return self.fit.covariance
        m = len(self.fit.names)
        return self.fit.covariance + self.trajectory.covariance_of_setup[:m, :m]

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the measured channels."""
        return self.fit.equations.channels

    @property
    def inseparable(self) -> tuple[str, ...]:
        """Channels whose constant offset cannot be separated from parameters."""
        return tuple(channel for channel in self.channels if channel not in self.offsets)

    @property
    def condition_number(self) -> float:
        """Condition number of the unit-norm, weighted columns, infinite if they are dependent."""
        return _condition(self.singular_values)

    @property
    def determined_condition(self) -> float:
        """The condition number of `determined_values`."""
        return _condition(self.determined_values)

    @property
    def determined_values(self) -> np.ndarray:
        """The singular values without those of combinations that the motion does not determine, where joints rest."""
        s = self.singular_values
        return s[s > s[0] / CONDITION_LIMIT] if self.undetermined else s

    @property
    def rivals(self) -> dict[str, np.ndarray]:
        """Ratios of residual to signal of other candidates on the same samples (C,), by name."""
        return {name: self.held_out.ratio_of(x) for name, x in self.held_out.rivals.items()}

    @cached_property
    def ratios(self) -> dict[str, float]:
        """RMS residual over the signal's standard deviation, of each channel judged."""
        return dict(zip(self.channels, self.held_out.ratio.tolist(), strict=True))

    @property
    def at_rest(self) -> dict[str, float]:
        """Ratios of the samples that are not judged, of joints that rub and rest, NaN without any, by channel."""
        return dict(zip(self.channels, self.held_out.ratio_at_rest(self.held_out.residual).tolist(), strict=True))

    @property
    def in_logs(self) -> list[dict[str, np.ndarray]]:
        """Ratios of all candidates in each recording, if each is predicted from the others (C,), by name."""
        held = self.held_out
        every = {ESTIMATE: held.residual, **held.rivals}
        return [{name: held.ratio_of(x, part) for name, x in every.items()} for part in held.left_out]

    @cached_property
    def idle(self) -> dict[str, str]:
        """Reason, as a key of `verdict.IDLE`, by the channels that are not predicted and in which nothing could be."""
        return idle_channels(self.held_out, self.prepared)

    @cached_property
    def _fitted(self) -> Samples:
        return joined([part.used for part in self.logs])

    @cached_property
    def residual(self) -> np.ndarray:
        """Measured minus predicted channels of the fitted parts (N, C)."""
        return np.concatenate([self.fit.residual(part.used) for part in self.logs])

    @property
    def scale(self) -> np.ndarray:
        """Robust standard deviation of each channel's residual (C,)."""
        return spread(self.residual)

    @cached_property
    def model_error(self) -> np.ndarray:
        """Share of each channel's residual that the motion explains beyond chance, held out and fitted (C,).

        A held-out motion is smoothed from joint angles alone, and the error of smoothing depends on the motion. In the
        fitted part the motion was estimated from the channels as well. A wrong model shows in both: the smaller share
        is returned.
        """
        held = explained_by_motion(self.held_out.residual, self.held_out.samples.motion)
        return np.minimum(held, explained_by_motion(self.residual, self._fitted.motion))

    @cached_property
    def friction(self) -> dict[str, float]:
        """Share of each joint torque's residual that friction would explain, empty without torques."""
        return friction_shares(self.fit, self._fitted) if self.fit.equations.torques else {}

    @cached_property
    def checks(self) -> Checks:
        """Checks of recording, set-up and fit."""
        return checked(self.prepared, self.fit, self.part)

    @cached_property
    def setup(self) -> list[SetupFinding]:
        """Set-up errors, which the estimate includes."""
        return [] if self.trajectory is None else setup_findings(self.trajectory)

    @cached_property
    def _consistent(self) -> ConsistentParameters:
        arm, known, equations = self.mechanism, self.known, self.fit.equations
        included = self.trajectory is not None and self.trajectory.known
        rotors = Rotors.of(equations.absorbed, stated_values(arm, list(equations.absorbed)), self.base.rank)
        prior, wider = guessed(arm), _regular(self.covariance_setup[: self.base.rank, : self.base.rank])
        prior_at = partial(BodyPrior.of, arm, self.base, known, rotors, used=included)
        fitted = partial(consistent_parameters, self.psi_of_links, self.covariance, self.base, prior)
        fitted = partial(fitted, bodies=arm.bodies, masses=known["mass"], rotors=rotors)
        # Bodies have what the data say, as the total mass on a plate; their intervals allow for errors of the set-up.
        full = fitted(known=prior_at(at=prior))
        # A prior of masses, centres and central inertias is made linear in φ about the bodies before; the third time no
        # parameter of a person changes by more than .02 (kg, kg m, kg m²).
        for _ in range(3 if included else 0):
            full = fitted(known=prior_at(at=full.phi))
        wide = replace(full.fitting, root=scaled_root(wider), prior=prior_at(at=full.phi if included else prior))
        # Frames stay without mass.
        phi = np.where(np.repeat(prior[::10] == 0, 10), 0, full.phi)
        return replace(full, fitting=wide, phi=phi, model=arm.known)

    def consistent(self) -> ConsistentParameters:
        """Physical bodies as close to the mechanism's prior as the estimate allows."""
        return self._consistent


def _regular(covariance: np.ndarray) -> np.ndarray:
    """A covariance whose correlations have eigenvalues from `ROUNDING` on; with the set-up it is definite to that."""
    std = np.sqrt(np.diag(covariance))
    values, axes = np.linalg.eigh(covariance / np.outer(std, std))
    return np.asarray((axes * np.maximum(values, ROUNDING)) @ axes.T * np.outer(std, std))


def _condition(singular_values: np.ndarray) -> float:
    """Ratio of the largest to the smallest of sorted singular values, infinite if that is zero."""
    largest, smallest = singular_values[[0, -1]].tolist()
    return largest / smallest if smallest else np.inf
