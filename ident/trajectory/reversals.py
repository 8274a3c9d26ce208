"""Friction near reversals: a smooth change of sign, and additional variance at low velocity.

    τ = Y_τ ψ + Ia q̈ + Fv q̇ + Fc tanh(q̇ / slip) + noise + slack,        var slack = s² exp(-(q̇ / v0)²)

At rest friction takes any value up to the breakaway friction, of either sign, so that such a sample carries little
information on the links. Slip and velocity v0 of each joint are chosen from lists, and size s fitted, by maximum
likelihood of its residuals. Friction at low velocity beyond Coulomb's law: Armstrong-Hélouvry, Dupont and Canudas de
Wit, Automatica 30 (1994), doi:10.1016/0005-1098(94)90209-7.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ident.estimation.loads import SLIP
from ident.estimation.measurement import Measurement
from ident.tolerances import DRIVE, STRIBECK
from ident.trajectory.fit.piece import Piece, clocks

AT_FIRST = 0.2
"""First guess of v0 over the root mean square of the joint's velocity; v0 is at most `STRIBECK`."""

VELOCITIES, SLIPS = 0.5 ** np.arange(4, 10), 0.5 ** np.arange(6, 0.5, -0.5)
"""Velocities v0, and slips besides `SLIP`, to try, over the same root mean square. A wider slack would absorb errors of
the links' model."""

SCORINGS = 8
"""Number of alternations of coefficients and variances; likelihood differences converge within five."""

ENOUGH = 2000
"""Approximate largest number of samples used."""

LEAST = 1e-4
"""Least share of the noise in the mean square."""

MARGIN = 0.005
"""Gain in log likelihood per sample with which a smoother law of friction is chosen: residuals are correlated, so that
a smaller gain is chance."""

WIDER = 2.0
"""Factor on the likeliest width of the slack: accelerations jump when a joint breaks away, which knots do not quite
follow, and drives would be wrong by one and a half of their standard deviations."""


@dataclass(frozen=True, eq=False)
class Reversals:
    """Friction of the channels' joints at low velocity.

    Attributes:
        size: Standard deviation s of the slack at rest, N m or N; zero for channels without Coulomb friction (C,).
        velocity: Velocity v0 over which it decays, rad/s or m/s (C,).
        slip: Velocity over which Coulomb friction changes sign, rad/s or m/s (C,).
    """

    size: np.ndarray
    velocity: np.ndarray
    slip: np.ndarray

    def slack(self, speed: np.ndarray) -> np.ndarray:
        """Standard deviation of the slack at the channels' joint velocities (M, C)."""
        return np.asarray(self.size * np.exp(-((speed / self.velocity) ** 2) / 2))

    def opened(self, pieces: Sequence[Piece], speed: Sequence[np.ndarray]) -> list[Piece]:
        """Pieces with the slack at their joints' velocities (M, C) each."""
        return [replace(piece, slack=self.slack(own)) for piece, own in zip(pieces, speed, strict=True)]

    def slips(self, measurement: Measurement) -> np.ndarray:
        """Slips of all freedoms (n,)."""
        out = np.full(len(measurement.equations.mechanism.tree.freedoms), SLIP)
        for channel, freedom in rubbing(measurement).items():
            out[freedom] = self.slip[channel]
        return out


def rubbing(measurement: Measurement) -> dict[int, int]:
    """Freedoms of the channels that have a Coulomb column, by channel."""
    equations = measurement.equations
    first = len(equations.channels) - len(equations.torques)
    names = {f"{DRIVE['coulomb']}({freedom})": k for k, freedom in enumerate(equations.mechanism.tree.freedoms)}
    have = {names[drive] for drive in equations.drives if drive in names}
    return {first + k: freedom for k, freedom in enumerate(equations.torques) if freedom in have}


def speeds(measurement: Measurement, piece: Piece, coefficients: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Joint velocities of torque channels with Coulomb friction, infinite for other channels (M, C)."""
    # Torques are on the clock of the last channels.
    _, when = clocks(measurement, piece, theta)[-1]
    rates = measurement.motion(piece.spline.evaluate(coefficients, when)[:3]).dq
    out = np.full((len(rates), len(measurement.equations.channels)), np.inf)
    for channel, freedom in rubbing(measurement).items():
        out[:, channel] = rates[:, freedom]
    return out


def at_first(measured: Sequence[np.ndarray], speed: Sequence[np.ndarray]) -> Reversals:
    """Initial slack, large enough to leave out torques at low velocity.

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
        measurement: Channels, and the slips with which the residuals were computed.
        residual: Residuals of the channels, NaN where a sample is missing (M, C).
        speed: Velocities (M, C), infinite for channels without Coulomb friction.
        theta: Parameters with which the residuals were computed (p,).
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
    """Friction at low velocity: slip, velocity v0, Coulomb friction and size of the slack."""

    slip: float
    velocity: float
    coulomb: float
    size: float


def _law(torque: np.ndarray, rate: np.ndarray) -> _Law:
    """Law with the smallest slip whose likelihood is about as high as the highest."""
    usual = float(np.sqrt(np.mean(rate**2)))
    slips = np.array([SLIP, *(slip for slip in usual * SLIPS if slip > SLIP)])
    coulomb, size, likelihood = _with_slack(torque, rate, slips, usual * VELOCITIES)
    enough = likelihood.max() - MARGIN * len(rate)
    k = int(np.argmax(likelihood.max(axis=1) >= enough))
    v = int(np.argmax(likelihood[k]))
    return _Law(slips[k], usual * VELOCITIES[v], coulomb[k, v], size[k, v])


def _with_slack(
    torque: np.ndarray, rate: np.ndarray, slips: np.ndarray, velocities: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Coulomb friction, size of the slack and log likelihood of all laws (S, V).

    Args:
        torque: Torque to explain by friction and an offset (M,).
        rate: Velocities (M,).
        slips: Velocities over which friction changes sign (S,).
        velocities: Velocities over which the slack decays (V,).
    """
    one = np.ones_like(rate)
    columns = np.stack([np.stack([np.tanh(rate / slip), rate, one]) for slip in slips])
    share = np.exp(-((rate / velocities[:, None]) ** 2))
    kinds = np.stack([np.ones_like(share), share], axis=1)
    products, kind_products = _products(columns), _products(kinds)
    precision = np.broadcast_to(1 - share + LEAST, (len(slips), *share.shape))
    for _ in range(SCORINGS):
        x = _solved(precision @ products, (precision * torque) @ columns.swapaxes(1, 2))
        squares = (torque - x @ columns) ** 2
        # By velocity first, as the kinds of variance are.
        weights = (precision**2).swapaxes(0, 1)
        weighted = weights * squares.swapaxes(0, 1)
        noise, slack = _solved(weights @ kind_products, weighted @ kinds.swapaxes(1, 2)).T
        alone = (weighted.sum(axis=-1) / weights.sum(axis=-1)).T
        noise, slack = np.where(slack < 0, alone, noise), np.maximum(slack, 0.0)
        noise = np.maximum(noise, LEAST * squares.mean(axis=-1))
        variance = noise[..., None] + slack[..., None] * share
        precision = 1 / variance
    return x[..., 0], np.sqrt(slack), -0.5 * (np.log(variance) + squares / variance).sum(axis=-1)


def _products(columns: np.ndarray) -> np.ndarray:
    """Products of all pairs of columns (b, k, M), whose weighted sums are normal equations (b, M, k²)."""
    b, k, M = columns.shape
    return (columns[:, :, None] * columns[:, None]).reshape(b, k * k, M).swapaxes(1, 2)


def _solved(normal: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Coefficients (…, k) from normal equations (…, k²), which may be singular, and right sides (…, k)."""
    k = right.shape[-1]
    inverse = np.linalg.pinv(normal.reshape(*normal.shape[:-1], k, k), rcond=1e-12, hermitian=True)
    return np.asarray((inverse @ right[..., None])[..., 0])
