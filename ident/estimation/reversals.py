"""Friction near reversals: a smooth change of its sign, and a variance of its own where a joint hardly moves.

    τ = Y_τ ψ + Ia q̈ + Fv q̇ + Fc tanh(q̇ / slip) + noise + slack,        var slack = s² exp(-(q̇ / v0)²)

A joint that rests takes any torque up to the breakaway torque, of either sign, so that such a sample says little of
the links. Slip, size s and velocity v0 of each joint follow from its residuals by maximum likelihood, each from a list.
What Coulomb's law misses at low velocity is described by Armstrong-Hélouvry, Dupont and Canudas de Wit, Automatica 30
(1994), doi:10.1016/0005-1098(94)90209-7.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ident.estimation.loads import SLIP
from ident.estimation.measurement import Measurement
from ident.estimation.piece import Piece, clocks
from ident.tolerances import DRIVE, STRIBECK

AT_FIRST = 0.2
"""First guess of v0 over the root mean square of the joint's velocity, where that is less than `STRIBECK`."""

VELOCITIES, SLIPS = 0.5 ** np.arange(4, 10), 0.5 ** np.arange(6, 0.5, -0.5)
"""Velocities v0, and slips besides `SLIP`, that are tried, over the same. A wider slack would take up what the model of
the links gets wrong."""

SCORINGS = 8
"""Alternations of coefficients and variances; differences of their likelihoods settle within five."""

ENOUGH = 2000
"""Samples that are looked at."""

LEAST = 1e-4
"""Least share of the mean square that counts as noise."""

MARGIN = 0.005
"""Logarithm of the likelihood, of each sample, that a smoother law of friction has to gain to be taken: residuals are
correlated, so that a gain of less is chance."""

WIDER = 2.0
"""How many times as wide as is likeliest the slack is: near a release accelerations jump, which knots do not quite
follow, and drives would be off by one and a half of their standard deviations."""


@dataclass(frozen=True, eq=False)
class Reversals:
    """Friction of the channels' joints at low velocity.

    Attributes:
        size: Standard deviation s of the slack at rest, N m or N; zero for channels without Coulomb friction (C,).
        velocity: Velocity v0 over which it fades, rad/s or m/s (C,).
        slip: Velocity over which Coulomb friction changes its sign, rad/s or m/s (C,).
    """

    size: np.ndarray
    velocity: np.ndarray
    slip: np.ndarray

    def slack(self, speed: np.ndarray) -> np.ndarray:
        """Standard deviation of the slack at the channels' joint velocities (M, C)."""
        return np.asarray(self.size * np.exp(-((speed / self.velocity) ** 2) / 2))

    def opened(self, pieces: Sequence[Piece], speed: Sequence[np.ndarray]) -> list[Piece]:
        """Pieces with the slack of their joints' velocities (M, C) each."""
        return [replace(piece, slack=self.slack(own)) for piece, own in zip(pieces, speed, strict=True)]

    def slips(self, measurement: Measurement) -> np.ndarray:
        """Slips of all freedoms (n,)."""
        out = np.full(len(measurement.equations.mechanism.tree.freedoms), SLIP)
        for channel, freedom in rubbing(measurement).items():
            out[freedom] = self.slip[channel]
        return out


def rubbing(measurement: Measurement) -> dict[int, int]:
    """Freedoms of the channels that have a Coulomb column, by the channels."""
    equations = measurement.equations
    first = len(equations.channels) - len(equations.torques)
    names = {f"{DRIVE['coulomb']}({freedom})": k for k, freedom in enumerate(equations.mechanism.tree.freedoms)}
    have = {names[drive] for drive in equations.drives if drive in names}
    return {first + k: freedom for k, freedom in enumerate(equations.torques) if freedom in have}


def speeds(measurement: Measurement, piece: Piece, coefficients: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Velocities of the joints whose torques the channels are, infinite for other channels (M, C)."""
    # Torques are on the clock of the last channels.
    _, when = clocks(measurement, piece, theta)[-1]
    rates = measurement.motion(piece.spline.evaluate(coefficients, when)[:3]).dq
    out = np.full((len(rates), len(measurement.equations.channels)), np.inf)
    for channel, freedom in rubbing(measurement).items():
        out[:, channel] = rates[:, freedom]
    return out


def at_first(measured: Sequence[np.ndarray], speed: Sequence[np.ndarray]) -> Reversals:
    """Slack that leaves out torques at low velocity.

    Args:
        measured: Channels of every piece (M, C).
        speed: Velocities of every piece (M, C), infinite for channels without Coulomb friction.
    """
    every, rates = np.concatenate(measured), np.concatenate(speed)
    rubs = np.isfinite(rates).any(axis=0)
    usual = np.sqrt(np.mean(np.where(np.isfinite(rates), rates, 0) ** 2, axis=0))
    size = np.where(rubs, np.nan_to_num(np.nanstd(every, axis=0)), 0.0)
    velocity = np.where(rubs, np.clip(AT_FIRST * usual, 1e-12, STRIBECK), 1.0)
    return Reversals(size, velocity, np.full(len(size), SLIP))


def likeliest(measurement: Measurement, residual: np.ndarray, speed: np.ndarray, theta: np.ndarray) -> Reversals:
    """Slips and slack that explain residuals best.

    Args:
        measurement: Channels, and the slips that the residuals are of.
        residual: Residuals of the channels, NaN where a sample is missing (M, C).
        speed: Velocities (M, C), infinite for channels without Coulomb friction.
        theta: Parameters that these are the residuals of (p,).
    """
    C = residual.shape[1]
    out = Reversals(np.zeros(C), np.ones(C), np.full(C, SLIP))
    for c, freedom in rubbing(measurement).items():
        chosen = np.flatnonzero(np.isfinite(residual[:, c]))
        chosen = chosen[:: max(1, len(chosen) // ENOUGH)]
        rate, friction = speed[chosen, c], _friction(measurement, freedom, theta)
        if not rate.any():
            continue
        slips = measurement.equations.slips
        own = SLIP if slips is None else slips[freedom]
        law = _law(residual[chosen, c] + friction * np.tanh(rate / own), rate)
        out.size[c], out.velocity[c], out.slip[c] = min(law.size, max(law.coulomb, 0.0)), WIDER * law.velocity, law.slip
    return out


def _friction(measurement: Measurement, freedom: int, theta: np.ndarray) -> float:
    """Coulomb friction of a freedom."""
    equations = measurement.equations
    name = f"{DRIVE['coulomb']}({equations.mechanism.tree.freedoms[freedom]})"
    return float(theta[equations.parameters.rank + equations.drives.index(name)])


class _Law(NamedTuple):
    """Friction at low velocity, and the logarithm of its likelihood."""

    slip: float
    velocity: float
    coulomb: float
    size: float
    likelihood: float


def _law(torque: np.ndarray, rate: np.ndarray) -> _Law:
    """The law with the smallest slip that is about as likely as any."""
    usual, best = np.sqrt(np.mean(rate**2)), list[_Law]()
    for slip in (SLIP, *(slip for slip in usual * SLIPS if slip > SLIP)):
        columns = np.stack([np.tanh(rate / slip), rate, np.ones_like(rate)])
        laws = (_Law(slip, v0, *_with_slack(torque, columns, np.exp(-((rate / v0) ** 2)))) for v0 in usual * VELOCITIES)
        best.append(max(laws, key=lambda law: law.likelihood))
    enough = max(law.likelihood for law in best) - MARGIN * len(rate)
    return next(law for law in best if law.likelihood >= enough)


def _with_slack(torque: np.ndarray, columns: np.ndarray, share: np.ndarray) -> tuple[float, float, float]:
    """Coefficient of the first column, size of the slack that fades like a share, and the logarithm of the likelihood.

    Args:
        torque: What is explained (M,).
        columns: What it is explained by (k, M).
        share: Share of the slack's variance (M,).
    """
    kinds = np.stack([np.ones_like(share), share])
    variance, size, x = 1 / (1 - share + LEAST), 0.0, np.zeros(len(columns))
    for _ in range(SCORINGS):
        x = _regressed(columns, torque, 1 / variance)
        squares = (torque - x @ columns) ** 2
        noise, slack = _regressed(kinds, squares, variance**-2.0)
        if slack < 0:
            noise, slack = np.average(squares, weights=variance**-2.0), 0.0
        variance = max(noise, LEAST * squares.mean()) + slack * share
        size = float(np.sqrt(slack))
    return float(x[0]), size, float(-0.5 * (np.log(variance) + squares / variance).sum())


def _regressed(columns: np.ndarray, y: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Weighted least squares of y (M,) on columns (k, M)."""
    weighted = columns * weights
    return np.asarray(np.linalg.lstsq(weighted @ columns.T, weighted @ y, rcond=1e-12)[0])
