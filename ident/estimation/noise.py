"""Noise that is correlated over time, and its effect on the covariance of a fit; units and scales of channels.

The scale of a channel in weights and ratios is the spread of its signal, or that of its kind where it is flat: its
weight would be infinite. Where a whole kind is flat, the largest spread of all channels replaces it, and 1 where all
are flat. With less noise than the bound a channel, however well it is fitted, would outweigh all others:

    floor_c = max(LEAST · scale_c, step_c / √12)
"""

from collections.abc import Callable, Iterable, Sequence

import numpy as np
from scipy.linalg import lapack

from ident.estimation.equations import COMPONENTS
from ident.geometry.inertia import body_index
from ident.mechanism.tree import Tree
from ident.recordings.smoothing import UNIFORM, quanta
from ident.tolerances import DRIVE_UNITS, NORMAL_MAD

STRETCH = 1.2
"""Assumed ratio of the noise's correlation time to that of the residuals."""

CHANCE = 2.0
"""Autocorrelation, in standard deviations of that of white noise, up to which noise is taken as white."""

LEAST_LEFT = 0.3
"""Least share of the noise's variance that is assumed to remain in the residuals."""

FLAT, FLAT_TORQUE = 1e-3, 1e-6
"""Spread relative to the largest of its kind up to which a channel is flat: a force or a moment, which share a sensor,
and a joint torque, of which a finger's is a thousandth of a hip's."""

LEAST = 1e-3
"""Smallest noise of a channel over its scale; few sensors are as good as that."""

LEAST_OF_POSES = 1e-5
"""The same of tracked poses: laser trackers resolve some micrometres in a room."""


def innovations(residual: np.ndarray, parameters: float) -> tuple[np.ndarray, np.ndarray]:
    """Autoregressive model `x_n = ρ x_n-1 + u_n` of each channel's noise, fitted to its residuals.

    Its autocovariance decays exponentially. The fit absorbs part of the noise, and more of slow noise: variance and
    correlation time are increased accordingly.

    Args:
        residual: Residuals of each channel (C, N).
        parameters: Mean number of parameters determined by a channel's samples.

    Returns:
        ρ of each channel (C,), and the residuals scaled to the size of u (C, N).
    """
    decay = np.array([_decay(x) for x in residual])
    taken = parameters * (1 + decay) / (1 - decay) / residual.shape[1]
    return decay, np.sqrt((1 - decay**2) / np.maximum(1 - taken, LEAST_LEFT))[:, None] * residual


def _decay(x: np.ndarray) -> float:
    """ρ with the same sum of autocorrelations as a residual, its correlation time stretched by `STRETCH`."""
    covariance = autocovariance(x)
    if not covariance[0]:
        return 0.0
    # Later lags are mostly chance: they are replaced by an exponential.
    correlation = covariance / covariance[0]
    lag = int(np.argmax(correlation < 1 / np.e))
    here = correlation[lag] if correlation[lag] > CHANCE / np.sqrt(len(x)) else 0.0
    total = correlation[1:lag].sum() + here / (1 - here ** (1 / lag))
    return float((total / (1 + total)) ** (1 / STRETCH))


def autocovariance(x: np.ndarray) -> np.ndarray:
    """Sums of the products of a signal (N,) with itself 0 to N samples later, the last zero (N + 1,)."""
    # Padded to twice its length a spectrum does not wrap around.
    return np.fft.irfft(np.abs(np.fft.rfft(x, 2 * len(x))) ** 2)[: len(x) + 1]


def remembered(rows: np.ndarray, decay: float, before: np.ndarray) -> np.ndarray:
    """Filtered columns `z_n = y_n + ρ z_n-1`, so that `Σ z_n u_n` has the covariance of `Σ y_n x_n`.

    x has the same autocovariance in reversed time, so z needs no later samples.

    Args:
        rows: Columns y of one channel (k, N).
        decay: ρ of its noise.
        before: z at the sample before the first, zero if there is none (k,).

    Returns:
        z (k, N).
    """
    return autoregressive(rows.T, decay, before).T


def autoregressive(x: np.ndarray, rho: float, before: np.ndarray | float = 0.0) -> np.ndarray:
    """Solution of `y_k = ρ y_k-1 + x_k` along the first axis, as a triangular band: scipy.signal is slow to import.

    Args:
        x: Innovations (N, …), N of at least 1.
        rho: Autocorrelation from one sample to the next.
        before: The sample before the first one (…).
    """
    right = np.array(x.reshape(len(x), -1), order="F")
    right[0] += rho * np.ravel(before)
    band = np.empty((2, len(x)), order="F")
    band.T[:] = 1, -rho
    y, _ = lapack.dtbtrs(band, right, uplo="L", diag="U", overwrite_b=True)
    return np.asarray(y.reshape(x.shape))


class Sandwich:
    """Middle factor of a sandwich covariance, `M = Σ_nm Y_nᵀ Γ(n - m) Y_m`, accumulated part by part.

    The noise's covariance Γ is from `innovations`.
    """

    def __init__(self, columns: int, channels: int) -> None:
        self._middle = np.zeros((columns, columns))
        self._tail = np.zeros(channels)
        self._left = np.zeros((channels, columns))

    def add(self, chunks: Iterable[np.ndarray], pull: np.ndarray, taken: float) -> None:
        """Adds the next part, whose noise may be correlated between channels and of any size in each sample.

        Args:
            chunks: Columns of its samples, some at a time, columns first (m, C, n).
            pull: Contribution of each residual to the normal equations, for least squares the residual itself (C, N).
            taken: Mean number of parameters determined by a channel's samples.
        """
        decay, size = innovations(pull, taken)
        first = 0
        for rows in chunks:
            z = [remembered(rows[:, c], rho, y) for c, (rho, y) in enumerate(zip(decay, self._left, strict=True))]
            self._left = np.array([each[:, -1] for each in z])
            last = first + rows.shape[2]
            # Contribution of each sample to the gradient.
            pulls = sum(each * u[first:last] for each, u in zip(z, size, strict=True))
            self._middle += pulls @ pulls.T
            first = last

    def add_steady(self, grams: Callable[[np.ndarray, np.ndarray], np.ndarray], pull: np.ndarray, taken: float) -> None:
        """Adds the next part, whose noise has constant size and is independent between channels.

        Args:
            grams: Function of each channel's ρ and its last z (C, m), which it overwrites, that returns the Gram
                matrices of the part's `remembered` columns (C, m, m).
            pull: As for `add`, also `taken`.
        """
        decay, size = innovations(pull, taken)
        variance = (size**2).mean(axis=1)
        self._middle += np.tensordot(variance, grams(decay, self._left), axes=1)
        self._tail = variance * decay**2 / (1 - decay**2)

    @property
    def middle(self) -> np.ndarray:
        """M (m, m)."""
        # The process continues after the last sample: later terms complete the variance of a stationary one.
        return self._middle + np.einsum("c,ck,cl->kl", self._tail, self._left, self._left)


def channel_scales(parts: Sequence[np.ndarray], channels: Sequence[str]) -> np.ndarray:
    """Scale of each channel of a signal, positive (C,).

    Args:
        parts: Measured channels, in one piece or several, NaN where a sample is missing (N, C).
        channels: Names of the channels; further ones are of tracked poses.
    """
    every = np.concatenate(parts)
    spread = np.zeros(every.shape[1])
    there = np.isfinite(every).any(axis=0)
    spread[there] = np.nanstd(every[:, there], axis=0)
    own, poses = np.split(spread, [len(channels)])
    return np.append(beside_others(own, channels), np.maximum(poses, LEAST * poses.max(initial=0.0) or 1.0))


def beside_others(spread: np.ndarray, channels: Sequence[str]) -> np.ndarray:
    """Spreads (C,), those of flat channels replaced by the largest of their kind: forces, moments, joint torques."""
    kinds = np.array([name[0] if name in COMPONENTS else "" for name in channels])
    of_all = float(spread.max(initial=0.0)) or 1.0
    largest = np.array([spread[kinds == kind].max() or of_all for kind in kinds])
    return np.where(spread <= np.where(kinds == "", FLAT_TORQUE, FLAT) * largest, largest, spread)


def least_noise(parts: Sequence[np.ndarray], channels: Sequence[str]) -> np.ndarray:
    """Lower bound of the standard deviation of each channel's noise (C,).

    Args:
        parts: Measured channels, in one piece or several, NaN where a sample is missing (N, C).
        channels: Names of the channels.
    """
    scales = channel_scales(parts, channels)
    least = np.where(np.arange(len(scales)) < len(channels), LEAST, LEAST_OF_POSES)
    return np.maximum(least * scales, rounding(parts))


def rounding(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Standard deviation of each stream's rounding error, from its smallest step (s,).

    Args:
        parts: The streams, in one piece or several, NaN where a sample is missing (N, s).
    """
    steps = np.array([quanta(part.T) for part in parts])
    smallest = np.where(steps > 0, steps, np.inf).min(axis=0)
    return np.where(np.isfinite(smallest), UNIFORM * smallest, 0.0)


def spread(residual: np.ndarray) -> np.ndarray:
    """Standard deviation of each channel from the median absolute deviation, the usual one if most entries agree."""
    spread = NORMAL_MAD * np.median(np.abs(residual), axis=0)
    usual = residual.std(axis=0)
    floor = max(1e-9 * usual.max(initial=0), 1e-12)
    return np.maximum(np.where(spread > 1e-3 * usual, spread, usual), floor)


def unit_of(parameter: str) -> str | None:
    """Unit of a parameter of φ, such as `m2rz2`; None for other names."""
    if body_index(parameter) is None:
        return None
    return "kg m²" if parameter.startswith("I") else "kg m" if "r" in parameter else "kg"


def offset_unit(name: str) -> str:
    """Unit of a component of a wrench, or of its offset: N for `Fx` and `offset(Fx)`, N m for moments."""
    return "N" if name.removeprefix("offset(").startswith("F") else "N m"


def channel_unit(channel: str, tree: Tree) -> str:
    """Unit of a channel: a component of a wrench, or a joint's torque or force."""
    if channel in COMPONENTS:
        return offset_unit(channel)
    motion = np.hstack([body.motions for body in tree.bodies if body.freedoms])[:, tree.freedoms.index(channel)]
    return "N m" if motion[3:].any() else "N"


def coefficient_unit(name: str, tree: Tree) -> str:
    """Unit of a coefficient by its name, such as `m2rz2`, `Fv(knee)` or `offset(Fx)`."""
    if (own := unit_of(name)) is not None:
        return own
    kind, _, of = name.removesuffix(")").partition("(")
    if kind in DRIVE_UNITS:
        # Motors, which are no freedoms, turn.
        return DRIVE_UNITS[kind][of in tree.freedoms and channel_unit(of, tree) == "N"]
    return channel_unit(of, tree)
