"""Friction near reversals: a smooth change of sign, and additional variance at low velocity.

    τ = Y_τ ψ + Ia q̈ + Fv q̇ + Fc tanh(q̇ / slip) + noise + slack,        var slack = s² exp(-(q̇ / v0)²)

At rest friction takes any value up to the breakaway friction, of either sign, so that such a sample carries little
information on the links. Slip and velocity v0 of each joint are chosen from lists, and size s fitted, by maximum
likelihood of its residuals. Of motors that move several joints together, which rub
in place of the joints, residuals are the joints' as seen by the motors, and variances of motors add up in a joint's
torque. Friction at low velocity beyond Coulomb's law: Armstrong-Hélouvry, Dupont and Canudas de Wit, Automatica 30
(1994), doi:10.1016/0005-1098(94)90209-7.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from ident.estimation.equations import SLIP, Equations
from ident.estimation.measurement import Measurement
from ident.tolerances import DRIVE, SINGULAR, STRIBECK
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

LARGER = 3.0
"""Factor on its likeliest size, up to that of the friction: friction at rest differs from the law for many samples
alike, which white slack underrates. Coulomb friction of a light joint on trapezoids was wrong by two to three of its
standard deviations (root mean square) with a factor of one, by less than one with three."""

LARGER_OF_COMMANDS = 10.0
"""Factor on its size, friction's at most, where commands stand for torques. A servo's lag was wrong by four standard
deviations with a factor of one, by one with three, and by none with ten."""


@dataclass(frozen=True, eq=False)
class Reversals:
    """Friction of the m axes at low velocity.

    Attributes:
        size: Standard deviation s of the slack at rest, N m or N; zero for axes without Coulomb friction (m,).
        velocity: Velocity v0 over which it decays, rad/s or m/s (m,).
        slip: Velocity over which Coulomb friction changes sign, rad/s or m/s (m,).
        shares: Torque in each channel over that on each axis, zero for wrenches (m, C).
    """

    size: np.ndarray
    velocity: np.ndarray
    slip: np.ndarray
    shares: np.ndarray

    def slack(self, speed: np.ndarray) -> np.ndarray:
        """Standard deviation of the channels' slack (M, C) at the axes' velocities (M, m)."""
        return np.sqrt((self.size * np.exp(-((speed / self.velocity) ** 2) / 2)) ** 2 @ self.shares**2)

    def resting(self, speed: np.ndarray) -> np.ndarray:
        """Mask of the channels with slack whose axis is slower than its v0 (M, C), at velocities (M, m)."""
        return ((np.abs(speed) < self.velocity) & (self.size > 0)) @ (self.shares != 0)

    def opened(self, pieces: Sequence[Piece], speed: Sequence[np.ndarray]) -> list[Piece]:
        """Pieces with the slack at their axes' velocities (M, m) each."""
        slacks = map(self.slack, speed)
        poses = (((0, 0), (0, piece.measured.shape[1] - self.shares.shape[1])) for piece in pieces)
        return [replace(x, slack=np.pad(own, more)) for x, own, more in zip(pieces, slacks, poses, strict=True)]


def rubbing(equations: Equations) -> tuple[int, ...]:
    """Indices of the axes with Coulomb friction that act on a torque channel, without dependent joints of loops."""
    axes = equations.axes
    felt = np.flatnonzero((axes.matrix[:, list(equations.torques)] != 0).sum(axis=1)).tolist()
    felt = [a for a in felt if axes.names[a] not in axes.dependent]
    return tuple(a for a in felt if f"{DRIVE['coulomb']}({equations.axes.names[a]})" in equations.drives)


def low_velocity_columns(equations: Equations, reversals: Reversals | None) -> tuple[str, ...]:
    """Columns of Stribeck friction, additional at low velocity, of the axes that may have it.

    These have Coulomb friction that changes its sign over less than `STRIBECK`: where it changes over more, friction
    that is higher at low velocity would only correct the shape of that change.
    """
    if reversals is None:
        return ()
    steep = reversals.slip < STRIBECK * equations.axes.gears
    return tuple(f"{DRIVE['stribeck']}({equations.axes.names[a]})" for a in rubbing(equations) if steep[a])


def shares(equations: Equations) -> np.ndarray:
    """Torque in each channel over that on each axis, zero for wrenches (m, C)."""
    of_torques = equations.axes.matrix[:, list(equations.torques)]
    wrenches = len(equations.channels) - len(equations.torques)
    return np.hstack([np.zeros((len(of_torques), wrenches)), of_torques])


def axis_speeds(equations: Equations, dq: np.ndarray) -> np.ndarray:
    """Velocities of the axes with Coulomb friction, infinite for other axes (M, m), from those of the joints (M, n)."""
    out, rubs = np.full((len(dq), len(equations.axes.names)), np.inf), list(rubbing(equations))
    out[:, rubs] = equations.axes.moved(dq)[:, rubs]
    return out


def speeds(measurement: Measurement, piece: Piece, coefficients: np.ndarray, theta: np.ndarray) -> np.ndarray:
    """Velocities of the axes with Coulomb friction along a piece, infinite for other axes (M, m)."""
    # Torques are on the clock of the last channels but poses.
    last = len(measurement.equations.channels) - 1
    (when,) = (when for own, when, _ in clocks(measurement, piece, theta) if own.start <= last < own.stop)
    rates = measurement.motion(piece.spline.evaluate(coefficients, when)[:3]).dq
    return axis_speeds(measurement.equations, rates)


def at_first(equations: Equations, measured: Sequence[np.ndarray], speed: Sequence[np.ndarray]) -> Reversals:
    """Initial slack, large enough to leave out torques at low velocity.

    Args:
        equations: Channels and axes.
        measured: Channels of every piece (M, C).
        speed: Velocities of every piece (M, m), infinite for axes without Coulomb friction.
    """
    every, rates = np.concatenate(measured), np.concatenate(speed)
    out = _none(equations)
    usual = np.sqrt(np.mean(np.where(np.isfinite(rates), rates, 0) ** 2, axis=0))
    for a in rubbing(equations):
        out.size[a] = np.nan_to_num(np.nanstd(_on_axis(equations, a, every)))
        out.velocity[a] = np.clip(AT_FIRST * usual[a], 1e-12, STRIBECK * equations.axes.gears[a])
    return out


def _none(equations: Equations) -> Reversals:
    """No slack, with the default slips."""
    gears = equations.axes.gears
    return Reversals(np.zeros(len(gears)), np.ones(len(gears)), SLIP * gears, shares(equations))


def _on_axis(equations: Equations, axis: int, channels: np.ndarray) -> np.ndarray:
    """Torque on an axis (M,) from those of the channels (M, C): of a motor as its coupling has it."""
    own, n = shares(equations), len(equations.axes.freedoms)
    if axis < n:
        return np.asarray(channels[:, np.flatnonzero(own[axis])[0]])
    weights = np.linalg.pinv(own[n:])[:, axis - n]
    used = np.abs(weights) > SINGULAR * np.abs(weights).max()
    return np.asarray(channels[:, used] @ weights[used])


def likeliest(equations: Equations, residual: np.ndarray, speed: np.ndarray, theta: np.ndarray) -> Reversals:
    """Slips and slack that explain residuals best.

    Args:
        equations: Channels, and the slips with which the residuals were computed.
        residual: Residuals of the channels, NaN where a sample is missing (M, C).
        speed: Velocities (M, m), infinite for axes without Coulomb friction.
        theta: Parameters with which the residuals were computed (p,).
    """
    out, gears = _none(equations), equations.axes.gears
    slips = SLIP * gears if equations.slips is None else equations.slips
    for a in rubbing(equations):
        own = _on_axis(equations, a, residual)
        chosen = np.flatnonzero(np.isfinite(own))
        chosen = chosen[:: max(1, len(chosen) // ENOUGH)]
        at = equations.drives.index(f"{DRIVE['coulomb']}({equations.axes.names[a]})")
        rate, friction = speed[chosen, a], float(theta[equations.parameters.rank + at])
        if not rate.any():
            continue
        law = _law(own[chosen] + friction * np.tanh(rate / slips[a]), rate, SLIP * gears[a])
        most = max(law.coulomb, 0.0)
        by_torque, by_command = min(LARGER * law.size, most), LARGER_OF_COMMANDS * min(law.size, most)
        out.size[a] = by_torque if equations.servos is None else by_command
        out.velocity[a], out.slip[a] = WIDER * law.velocity, law.slip
    return out


class _Law(NamedTuple):
    """Friction at low velocity: slip, velocity v0, Coulomb friction and size of the slack."""

    slip: float
    velocity: float
    coulomb: float
    size: float


def _law(torque: np.ndarray, rate: np.ndarray, least: float = SLIP) -> _Law:
    """Law with the smallest slip, from a least one, whose likelihood is about as high as the highest."""
    usual = float(np.sqrt(np.mean(rate**2)))
    slips = np.array([least, *(slip for slip in usual * SLIPS if slip > least)])
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
