"""From a mechanism and a recording to base parameters, how well they predict, and whether to believe them."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ident.errors import ExcitationError, InputError
from ident.estimation.accumulator import accumulate, triangle_of
from ident.estimation.equations import Equations
from ident.estimation.excitation import blamed
from ident.estimation.least_squares import Fit
from ident.estimation.preparation import Prepared, prepared
from ident.estimation.robust import robust_fit, separable, spread
from ident.estimation.samples import Samples
from ident.geometry.inertia import PARAMETERS
from ident.judgement.checks import Checks, checked
from ident.judgement.comparison import Comparison, compared
from ident.judgement.diagnosis import correlation_time
from ident.judgement.verdict import Finding, findings, verdict
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.parameters.base_parameters import BaseParameters
from ident.parameters.consistency import ConsistentParameters, consistent_parameters
from ident.recordings.recording import Recording
from ident.tolerances import HOLDOUT, UNEXPLAINED

LEAST_HELD_OUT = 2
"""Samples that a held-out part needs: a signal's standard deviation takes two."""

SHOWN = 30
"""Base parameters that `print` shows at most."""

CONDITION_LIMIT = 1e4
"""Condition number of the unit-norm columns from which parameters are not separated."""


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Samples that are judged by, and what a fit leaves of them.

    Attributes:
        time: Sample times, s (M,).
        samples: The samples.
        fit: The fit.
    """

    time: np.ndarray
    samples: Samples
    fit: Fit

    @cached_property
    def residual(self) -> np.ndarray:
        """Measured minus predicted (M, C)."""
        return self.fit.residual(self.samples)

    @property
    def ratio(self) -> np.ndarray:
        """RMS residual over the signal's standard deviation, of each channel (C,)."""
        return self._ratio(self.residual)

    def ratio_with(self, psi: np.ndarray) -> np.ndarray:
        """The same with other base parameters (r,)."""
        values = self.fit.values.copy()
        values[: len(psi)] = psi
        return self._ratio(replace(self.fit, values=values).residual(self.samples))

    def _ratio(self, residual: np.ndarray) -> np.ndarray:
        return np.sqrt((residual**2).mean(axis=0)) / np.maximum(self.samples.measured.std(axis=0), 1e-300)


@dataclass(frozen=True, eq=False)
class Estimate:
    """Base parameters of a mechanism from a recording.

    Attributes:
        prepared: What was fitted.
        fit: The fit on the first part of the recording.
        offsets: Constant offset of each channel where it can be told, fitted or not, with its standard deviation.
        part: Samples that were fitted.
        held_out: Those that are judged by: the end of the recording, or another one, or the fitted ones themselves.
        singular_values: Of the unit-norm columns of base parameters and drives, each channel weighted.
        axes: Whether joint axes that are off are looked for.
    """

    prepared: Prepared
    fit: Fit
    offsets: dict[str, tuple[float, float]]
    part: slice
    held_out: HeldOut
    singular_values: np.ndarray
    axes: bool = True

    @property
    def base(self) -> BaseParameters:
        """The regrouping."""
        return self.fit.parameters

    @property
    def names(self) -> tuple[str, ...]:
        """Names of all coefficients: base parameters, drives, offsets."""
        return self.fit.names

    @property
    def psi(self) -> np.ndarray:
        """Base parameters (r,)."""
        return self.fit.psi

    @property
    def covariance(self) -> np.ndarray:
        """Covariance of the base parameters (r, r)."""
        return self.fit.covariance[: self.base.rank, : self.base.rank]

    @property
    def std(self) -> np.ndarray:
        """Standard deviations of the base parameters (r,)."""
        return self.fit.std[: self.base.rank]

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the measured channels."""
        return self.fit.equations.channels

    @property
    def inseparable(self) -> tuple[str, ...]:
        """Channels whose constant offset cannot be told from parameters."""
        return tuple(channel for channel in self.channels if channel not in self.offsets)

    @property
    def condition_number(self) -> float:
        """Condition number of the unit-norm, weighted columns."""
        return float(self.singular_values[0] / self.singular_values[-1])

    @property
    def unexplained(self) -> tuple[str, ...]:
        """Channels that this motion and model do not explain."""
        return tuple(c for c, r in zip(self.channels, self.held_out.ratio, strict=True) if r > UNEXPLAINED)

    @cached_property
    def residual(self) -> np.ndarray:
        """Measured minus predicted channels of the fitted part (N, C)."""
        return self.fit.residual(self.prepared.samples[self.part])

    @property
    def scale(self) -> np.ndarray:
        """Standard deviation of each channel's residual, outliers left aside (C,)."""
        return spread(self.residual)

    @property
    def correlation(self) -> np.ndarray:
        """Correlation time of each channel's residual, s (C,)."""
        return correlation_time(self.residual, self.prepared.recording.rate)

    def predict(self, motion: Motion) -> np.ndarray:
        """Channels that the estimate predicts for a motion, in N and N m (N, C).

        Raises:
            InputError: The motion does not fit the mechanism.
        """
        return self.fit.predicted(motion.checked(self.prepared.mechanism.tree))

    def compare(self, other: "Estimate") -> Comparison:
        """The difference from an estimate of another recording of the same mechanism, and whether it is noise.

        Raises:
            InputError: The other one has other base parameters.
        """
        return compared(self.fit, other.fit)

    @cached_property
    def _consistent(self) -> ConsistentParameters:
        arm = self.prepared.mechanism
        return consistent_parameters(self.psi, self.covariance, self.base, arm.known, bodies=arm.bodies)

    def consistent(self) -> ConsistentParameters:
        """The physical bodies that are as close to the mechanism's prior as the estimate lets them be."""
        return self._consistent

    @cached_property
    def findings(self) -> list[Finding]:
        """What speaks against the estimate, and what else its reader should know, the doubts first."""
        return findings(self)

    def verdict(self) -> str:
        """One sentence on whether to believe it."""
        return verdict(self, self.findings)

    def to_dict(self) -> dict[str, Any]:
        """Everything for scripts, in JSON's types."""
        held, full = self.held_out, self.consistent()
        rms, signal = np.sqrt((held.residual**2).mean(axis=0)), held.samples.measured.std(axis=0)
        numbers = zip(self.channels, rms.tolist(), signal.tolist(), held.ratio.tolist(), strict=True)
        bodies = zip(self.prepared.mechanism.bodies, full.phi.reshape(-1, 10).tolist(), strict=True)
        return {
            "verdict": self.verdict(),
            "findings": [{"text": finding.text, "doubt": finding.doubt} for finding in self.findings],
            "columns": list(self.names),
            "values": self.fit.values.tolist(),
            "std": self.fit.std.tolist(),
            "covariance": self.fit.covariance.tolist(),
            "regrouping": dict(zip(self.base.names, self.base.expressions(12), strict=True)),
            "condition_number": self.condition_number,
            "cutoff_hz": self.prepared.cutoff,
            "held_out": {c: {"residual_rms": r, "signal_std": s, "ratio": q} for c, r, s, q in numbers},
            "offsets": {channel: {"value": v, "std": s} for channel, (v, s) in self.offsets.items()},
            "bodies": {name: dict(zip(PARAMETERS, phi, strict=True)) for name, phi in bodies},
        }

    def __str__(self) -> str:
        prior, rank = self.base.regroup(self.prepared.mechanism.known), self.base.rank
        rows = zip(self.base.names, self.psi, self.std, prior, self.base.expressions(4), strict=True)
        lines = [
            f"{name:<8} {value:12.4f} ± {std:<10.2g} {before:12.4f}  {regrouping:.60}"
            for name, value, std, before, regrouping in rows
        ][:SHOWN]
        more = [f"… and {rank - SHOWN} more" for _ in range(rank > SHOWN)]
        ratios = ", ".join(f"{c} {r:.2f}" for c, r in zip(self.channels, self.held_out.ratio, strict=True))
        return "\n".join(
            [
                f"{rank} base parameters, SI units, from {self.fit.samples} samples",
                f"{'':<8} {'estimate':>12}   {'s.d.':<10} {'model':>12}  regrouping",
                *lines,
                *more,
                f"Residual over signal: {ratios}; condition number {self.condition_number:.3g}.",
                self.verdict(),
            ]
        )

    @cached_property
    def checks(self) -> Checks:
        """All that can be checked."""
        return checked(self.prepared, self.fit, self.part, axes=self.axes)


def identify(
    mechanism: Mechanism,
    recording: Recording,
    *,
    cutoff: str | float | None = None,
    drive: Sequence[str] = (),
    offsets: bool = True,
    weighted: bool = True,
    holdout: float = HOLDOUT,
    held_out: Recording | None = None,
    axes: bool = True,
) -> Estimate:
    """Base parameters of a mechanism from a recording, judged on a part of it that was not fitted.

    Args:
        mechanism: The mechanism, with a prior, as `sim.mechanism` reads it.
        recording: Joint states and wrenches, as `read_log` reads them or `sim.simulate` makes them.
        cutoff: Cut-off of the low-pass in Hz, `auto`, or None for the recording's own velocities and accelerations.
        drive: Columns of friction and rotor inertia for joint torques: `viscous`, `coulomb`, `rotor`.
        offsets: As for `identified`, also `weighted`, `holdout` and `axes`.
        held_out: Another recording to judge by.

    Raises:
        InputError: Something is missing or does not fit; the message names it.
        ExcitationError: The motion does not separate the base parameters.
    """
    other = None if held_out is None else prepared(mechanism, held_out, cutoff=cutoff, drive=drive)
    ready = prepared(mechanism, recording, cutoff=cutoff, drive=drive)
    return identified(ready, offsets=offsets, weighted=weighted, holdout=holdout, other=other, axes=axes)


def identified(
    prepared: Prepared,
    *,
    offsets: bool = True,
    weighted: bool = True,
    holdout: float = HOLDOUT,
    other: Prepared | None = None,
    axes: bool = True,
) -> Estimate:
    """Fits one part of a recording, and holds the rest to judge the fit by.

    Args:
        prepared: Mechanism and recording.
        offsets: Whether to fit a constant offset of every channel that can be told from the parameters.
        weighted: Whether to weight channels by their residuals and outliers down; else ordinary least squares.
        holdout: Fraction of the recording, its end, that is not fitted; with zero the fit is judged on what was fitted.
        other: Another recording of the same channels to judge by, of any length; then the whole one is fitted.
        axes: Whether to look for joint axes that are off.

    Raises:
        ExcitationError: The motion does not separate the base parameters.
        InputError: The recording is too short, or the other one has other channels.
    """
    part, judged = _parts(prepared, holdout, other)
    fitted, equations = prepared.samples[part], prepared.equations
    signal = np.maximum(prepared.samples.measured.std(axis=0), 1e-300)
    singular_values = _separated(equations, fitted, signal)
    with_offsets = separable(equations.with_offsets(range(len(equations.channels))), fitted)
    full = robust_fit(with_offsets, fitted, weighted=weighted)
    fit = full if offsets else robust_fit(equations, fitted, weighted=weighted)
    source = other or prepared
    return Estimate(
        prepared=prepared,
        fit=fit,
        offsets=full.offsets,
        part=part,
        held_out=HeldOut(source.recording.time[judged], source.samples[judged], fit),
        singular_values=singular_values,
        axes=axes,
    )


def _parts(prepared: Prepared, holdout: float, other: Prepared | None) -> tuple[slice, slice]:
    """Samples to fit, and those of the same or the other recording to judge by."""
    equations, samples, edge = prepared.equations, len(prepared.samples), prepared.edge
    if 2 * edge >= samples:
        raise InputError(
            f"A cut-off of {prepared.cutoff:g} Hz settles in {edge} samples at either end, more than half of the "
            f"{samples} recorded; take a higher one."
        )
    if other is None:
        split = round((1 - holdout) * samples) if holdout else samples - edge
        part, judged = slice(edge, split), slice(split if holdout else edge, samples - edge)
    else:
        part, judged = slice(edge, samples - edge), slice(other.edge, len(other.samples) - other.edge)
        if other.equations.channels != equations.channels:
            raise InputError(
                f"The log to judge by needs the channels {', '.join(equations.channels)}; "
                f"it has {', '.join(other.equations.channels)}."
            )
        if judged.stop - judged.start < LEAST_HELD_OUT:
            raise InputError(
                f"The log to judge by has {len(other.samples)} samples; with {other.edge} left out at either end, "
                "where the filter settles, nothing remains."
            )
    if not np.ptp(prepared.samples.measured[part], axis=0).any():
        raise InputError("Every measured channel is constant; there is nothing to fit.")
    needed = len(equations.names) + len(equations.channels)
    if part.stop - part.start < needed or judged.stop - judged.start < LEAST_HELD_OUT:
        raise InputError(
            f"{samples} samples, {edge} left out at either end and {holdout:.0%} held out, are too few for "
            f"{len(equations.names)} parameters."
        )
    return part, judged


def _separated(equations: Equations, samples: Samples, signal: np.ndarray) -> np.ndarray:
    """Singular values of the unit-norm columns, each channel divided by its signal (C,).

    Raises:
        ExcitationError: The motion leaves one of them at rounding; it names the parameters.
    """
    weights = np.broadcast_to(1 / signal, samples.measured.shape)
    columns = accumulate(equations, samples, factors=weights).root[:, : len(equations.names)]
    norms = np.linalg.norm(columns, axis=0)
    # Of a triangle the decomposition is quicker, and fails to converge less easily, than of all rows.
    _, s, directions = np.linalg.svd(triangle_of(columns / np.where(norms > 0, norms, 1)))
    hidden = directions[s <= s[0] / CONDITION_LIMIT]
    if len(hidden):
        names = blamed(hidden, equations.names)
        raise ExcitationError(
            f"In {', '.join(equations.channels)} the recorded motion excites {len(s) - len(hidden)} of {len(s)} "
            f"parameters; it does not separate {', '.join(names)}. Move the joints further (experiments.excite "
            "designs a motion), or measure more.",
            names,
        )
    return s
