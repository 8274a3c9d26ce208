"""One pass over a recording: statistics of its channels, and the verdict on the estimate."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np

from ident.errors import LogError, ModelError
from ident.estimation.accumulator import Accumulator
from ident.estimation.channel_scales import beside_others
from ident.estimation.equations import COMPONENTS, Equations
from ident.estimation.excitation import independent, separable
from ident.estimation.samples import Samples
from ident.files.column import UNITS
from ident.judgement.checks import Checks, Unchecked, Weight
from ident.judgement.diagnosis import FrameCheck
from ident.judgement.evidence import Evidence
from ident.judgement.residuals import not_predicted, still_channels
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.recordings.columns.mapping import joint_kinds
from ident.recordings.recording import STATES, Recording
from ident.regression.ordinary import Fit
from ident.tolerances import HUGE, TURNS

MOVES = 0.01
"""Range, in SI units, above which a joint or its velocity counts as changing."""

STUCK = 0.1
"""Relative difference from the predicted wrench above which a constant channel counts as stuck."""

ROUNDING = 1e-6
"""Fraction of the largest predicted channel below which others are zero."""


@dataclass(eq=False)
class Statistics:
    """Extremes of the joints' channels and of the total wrench, and its sum, over all samples so far.

    Attributes:
        joints: Quantity of each joint's channels, position, velocity and acceleration, as keys of `UNITS`.
        samples: Number of samples.
        total: Sum of the total wrench (6,).
        low: Smallest value of each joint's channel, and of the total wrench (6,) as `wrench`.
        high: Largest value.
    """

    joints: Mapping[str, str]
    samples: int = 0
    total: np.ndarray = field(default_factory=lambda: np.zeros(6))
    low: dict[str, np.ndarray] = field(default_factory=dict)
    high: dict[str, np.ndarray] = field(default_factory=dict)

    @classmethod
    def of(cls, tree: Tree) -> "Statistics":
        """Empty statistics of a mechanism's joints.

        Raises:
            ModelError: The mechanism has no joints.
            LogError: A joint is a ball, which one pass does not support.
        """
        if not tree.moving:
            raise ModelError(f"Nothing moves on this base: {', '.join(tree.names)} without joints; see --base.")
        kinds = joint_kinds(tree)
        if balls := [joint for joint, kind in kinds.items() if kind == "ball"]:
            raise LogError(
                "One pass over recordings takes hinges, slides and the pose of a moving base, but not the ball joint "
                f"'{balls[0]}'; `identify` does."
            )
        return cls({f"{joint}_{rate}": f"{kind} {rate}" for joint, kind in kinds.items() for rate in STATES})

    def check(self, recording: Recording, wrenches: Iterable[str]) -> None:
        """Checks shapes and units of the channels of the joints and of some wrenches.

        Raises:
            LogError: A channel is missing, has another number of components, or is not in SI units.
        """
        parts = {f"{name}_{kind}": kind for name in wrenches for kind in ("force", "torque")}
        for name, kind in {**self.joints, **parts}.items():
            components, unit = (3,) if kind in ("force", "torque") else (), str(recording.units.get(name))
            if recording[name].shape[1:] != components:
                needed = "three numbers" if components else "one number"
                raise LogError(f"channel '{name}' needs {needed} a sample, got shape {recording[name].shape}.")
            if not components and not np.isfinite(recording[name]).all():
                raise LogError(f"channel '{name}' needs numbers, but it is empty or NaN throughout.")
            if unit != "None" and UNITS[kind].get(unit) != 1:
                raise LogError(f"channel '{name}' is in {unit}, but a recording needs {next(iter(UNITS[kind]))}.")

    def add(self, recording: Recording, wrench: np.ndarray, before: int) -> None:
        """Adds samples and their total wrench (N, 6).

        Args:
            recording: The samples.
            wrench: Their total wrench.
            before: Number of samples before them in their file, for messages.

        Raises:
            LogError: A number is too large, or angles look like degrees.
        """
        # Numpy is ten times faster along rows.
        rows = np.ascontiguousarray(wrench.T)
        self.samples += len(wrench)
        self.total += rows.sum(axis=1)
        for name, x in {"wrench": rows, **{name: recording[name] for name in self.joints}}.items():
            low, high = x.min(axis=-1), x.max(axis=-1)
            if not (largest := max(-low.min(), high.max())) <= HUGE:
                what = "the total wrench" if name == "wrench" else f"channel '{name}'"
                at = int(np.abs(x).argmax()) % len(wrench)
                raise LogError(
                    f"{what} needs numbers below {HUGE:g}, got {largest:g} in sample {before + at} (counted from 0), "
                    f"at {recording.time[at]:g} s."
                )
            self.low[name] = np.minimum(self.low.get(name, low), low)
            self.high[name] = np.maximum(self.high.get(name, high), high)
        for name, kind in self.joints.items():
            if kind == "hinge position" and name not in recording.units and self.extent(name) > TURNS:
                raise LogError(
                    f"channel '{name}' ranges over {self.extent(name):.3g} rad, which looks like degrees; convert it, "
                    "or state its unit, rad, in the recording's 'units'."
                )

    def resting(self) -> list[str]:
        """Rates that are zero throughout although their integrals change."""
        zero = {name for name in self.joints if not (self.low[name] or self.high[name])}
        rates = [(x, rate) for x, rate in pairwise(self.joints) if not self.joints[rate].endswith("position")]
        return [rate for x, rate in rates if rate in zero and self.extent(x) > MOVES]

    def extent(self, name: str) -> np.ndarray:
        """Range of a channel, of each of its components."""
        return self.high[name] - self.low[name]


def with_offsets(equations: Equations) -> Equations:
    """The equations with constant offsets of all channels in which some motion separates them from other columns."""
    # With inseparable columns the accumulator would search for better coordinates in vain.
    whole, joints = equations.with_offsets(range(len(equations.channels))), len(equations.mechanism.tree.freedoms)
    states = np.random.default_rng(0).uniform(-2, 2, (3, 4 * len(whole.names), joints))
    measured = np.zeros((len(states[0]), len(whole.channels)))
    return separable(whole, Samples(Motion(*states), measured))


def separated(accumulated: Accumulator, equations: Equations) -> tuple[Accumulator, Equations]:
    """The accumulator and its equations without offsets that the motion does not separate from earlier columns."""
    apart = independent(accumulated.root[:, : len(equations.names)])
    first = len(equations.names) - len(equations.offsets)
    kept = [k for k in range(len(equations.names)) if k < first or apart[k]]
    fewer = equations.with_offsets([equations.offsets[k - first] for k in kept if k >= first])
    # Rows in the coordinates of P are Z P, and some of their columns are Z Q R.
    Q, R = np.linalg.qr(accumulated.factor[:, [*kept, len(equations.names)]])
    grams = Q.T @ accumulated.grams @ Q
    return replace(accumulated, names=fewer.names, factor=R, order=np.arange(len(R)), grams=grams), fewer


@dataclass(frozen=True, eq=False)
class Passed:
    """Results of one pass over recordings.

    Attributes:
        statistics: Statistics of the channels.
        accumulated: Accumulated sums of their equations.
    """

    statistics: Statistics
    accumulated: Accumulator

    def ratio(self, fit: Fit) -> dict[str, float]:
        """RMS residual over the scale of the signal, for each channel that changes.

        Raises:
            LogError: No channel of the wrench changes.
        """
        statistics, changes = self.statistics, self.statistics.extent("wrench") > 0
        if not changes.any():
            raise LogError("Every channel of the total wrench is constant; there is nothing to fit.")
        signal = self.squares(np.zeros(len(fit.values)), 1)
        std = np.sqrt(np.maximum(signal / statistics.samples - (statistics.total / statistics.samples) ** 2, 0))
        ratio = np.sqrt(self.squares(-fit.values, 1) / statistics.samples) / beside_others(std, COMPONENTS)
        return {c: float(r) for c, r, changing in zip(COMPONENTS, ratio, changes, strict=True) if changing}

    def squares(self, values: np.ndarray, sign: float) -> np.ndarray:
        """Sum of squares of `columns @ values + sign * wrench`, of each component (6,)."""
        x = self.accumulated.factor @ np.append(values, sign)
        return np.maximum(x @ self.accumulated.grams @ x, 0)


def evidence_of(fitted: Passed, fit: Fit, held_out: Passed | None = None) -> Evidence:
    """Evidence on an estimate without another pass.

    Args:
        fitted: The pass over the fitted recordings.
        fit: The fit.
        held_out: Other recordings to judge by, accumulated for the same equations.

    Raises:
        LogError: No channel of the wrench changes.
    """
    statistics, mechanism = fitted.statistics, fit.equations.mechanism
    own = fitted.ratio(fit)
    ratios, part = (own, "fitted") if held_out is None else (held_out.ratio(fit), "held-out")
    model = np.zeros(len(fit.names))
    model[: fit.parameters.rank] = fit.parameters.regroup(mechanism.known)
    predicted, straight, opposite = (fitted.squares(*x) for x in ((model, 0), (-model, 1), (-model, -1)))
    constant = ~(statistics.extent("wrench") > 0)
    differs = straight > np.maximum(STUCK**2 * predicted, ROUNDING**2 * predicted.max())
    offsets = fit.offsets
    idle = still_channels(dict(zip(COMPONENTS, np.sqrt(predicted).tolist(), strict=True)))
    return Evidence(
        fit=fit,
        ratios=ratios,
        part=part,
        condition_number=fit.condition_number,
        checks=_checks(statistics, mechanism, _sign(predicted, straight, opposite)),
        offsets=offsets,
        inseparable=tuple(channel for channel in COMPONENTS if offsets and channel not in offsets),
        scale=dict(zip(COMPONENTS, (fit.residual_norms / np.sqrt(fit.samples)).tolist(), strict=True)),
        constant=(*statistics.resting(), *np.array(COMPONENTS)[constant & differs].tolist()),
        idle=not_predicted(idle, ratios),
    )


def _sign(predicted: np.ndarray, straight: np.ndarray, opposite: np.ndarray) -> FrameCheck:
    """Check of the opposite sign of the total wrench; arguments are sums of squares (6,)."""
    size = predicted.reshape(2, 3).sum(axis=1)
    scale = np.repeat(np.maximum(size, 1e-6 * size.max(initial=1e-24)), 3)
    error, turned = (float(np.sqrt((left / scale).sum() / 2)) for left in (straight, opposite))
    return FrameCheck(-1, np.eye(3), error, turned)


def _checks(statistics: Statistics, mechanism: Mechanism, sign: FrameCheck) -> Checks:
    """Checks of the total wrench: its sign, what it weighs and its largest components."""
    g = float(np.linalg.norm(mechanism.gravity))
    weight, unchecked = None, []
    if g:
        mass = float(-statistics.total[:3] @ mechanism.gravity) / (statistics.samples * g**2)
        weight = Weight(mass, mechanism.mass, 0.0)
    else:
        unchecked.append(Unchecked("weight", "no gravity"))
    largest = float(np.linalg.norm(np.maximum(-statistics.low["wrench"], statistics.high["wrench"])[:3]))
    return Checks(weight, {}, None, None, None, tuple(unchecked), total=sign, largest_force=largest)
