"""Velocities and accelerations from sampled positions: one zero-phase low-pass filter, and central differences."""

import numpy as np
from scipy.linalg import lapack

from ident.errors import InputError

PADDING = 9
"""Least samples by which either end is continued: three for each coefficient of the filter's denominator."""

SETTLING = 1.5
"""Time in which filter and differences settle at either end, in periods of the cut-off frequency."""

LEAST = 1e-5
"""Least cut-off that the filter's coefficients can tell from zero, as a share of the rate."""

LOWEST = 0.005
HIGHEST = 0.4
"""Range of cut-offs that `chosen_cutoff` considers, as shares of the rate."""

TAIL = 0.1
"""Share of the rate above which `chosen_cutoff` takes residuals for noise."""


def low_pass(x: np.ndarray, rate: float, cutoff_hz: float) -> np.ndarray:
    """Samples without what lies above a cut-off frequency, without delay.

    The filter that smooths positions belongs on the wrenches as well: what it takes from both sides of
    `Yφ = Γ` alike leaves φ all but unbiased.

    Args:
        x: Uniformly sampled columns, in any unit (N,) or (N, k). A column with NaN becomes NaN.
        rate: Samples per second, Hz.
        cutoff_hz: Frequency that half of the amplitude passes, Hz.

    Returns:
        The smoothed columns, in the shape of x.

    Raises:
        InputError: The cut-off is not between `LEAST` and half the rate, or there are too few samples.
    """
    x = np.asarray(x, float)
    if not LEAST * rate <= cutoff_hz < rate / 2:
        raise InputError(
            f"A cut-off needs a frequency from {LEAST * rate:g} Hz to below half the rate, {rate / 2:g} Hz, got "
            f"{cutoff_hz:g} Hz."
        )
    # A motion that stopped a few samples beyond an end would jerk there as far as the filter reaches.
    reach = min(max(PADDING, 2 * settling(rate, cutoff_hz)), len(x) - 1)
    return _passed(x, cutoff_hz / rate, reach)


def _passed(x: np.ndarray, share: float, padding: int = PADDING) -> np.ndarray:
    """What a filter passes that has its cut-off at a share of the rate, forward and backward.

    Either end goes on as its mirror image through the last sample, and what was before that as it begins.

    Args:
        x: Samples (N,) or (N, k).
        share: The cut-off as a share of the rate.
        padding: Samples by which either end goes on.
    """
    if len(x) <= PADDING:
        raise InputError(f"Low-pass filtering needs more than {PADDING} samples, got {len(x)}.")
    before, after = 2 * x[0] - x[padding:0:-1], 2 * x[-1] - x[-2::-1][:padding]
    forward = _filtered(np.concatenate([before, x, after]), share)
    return _filtered(forward[::-1], share)[::-1][padding:-padding]


def _filtered(x: np.ndarray, share: float) -> np.ndarray:
    """A Butterworth filter of second order by the bilinear transform, settled at the first sample.

    `(1 + √2 K + K²) y_i + 2 (K² - 1) y_i-1 + (1 - √2 K + K²) y_i-2 = K² (x_i + 2 x_i-1 + x_i-2)` with K = tan(π share)
    is, divided by the first factor, a banded triangular system in y. It is solved as such: scipy's filters bring its
    statistics, a third of what starting takes.
    """
    # Of no columns scipy's wrapper of LAPACK would write beyond its memory.
    if not x.size:
        return x
    K = np.tan(np.pi * share)
    own = 1 + np.sqrt(2) * K + K**2
    first = x[:1]
    risen = (K**2 / own * (x - first)).reshape(len(x), -1)
    forced = np.array(risen, order="F")
    forced[1:] += 2 * risen[:-1]
    forced[2:] += risen[:-2]
    band = np.empty((3, len(x)), order="F")
    band.T[:] = 1, 2 * (K**2 - 1) / own, (1 - np.sqrt(2) * K + K**2) / own
    y, _ = lapack.dtbtrs(band, forced, uplo="L", diag="U", overwrite_b=True)
    return first + y.reshape(x.shape)


def differences(x: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """First and second derivatives by central differences, over five points and at the ends over fewer.

    Args:
        x: Uniformly sampled columns (N,) or (N, k), N of at least 5.
        rate: Samples per second, Hz.

    Returns:
        ẋ and ẍ in the shape of x.
    """
    if len(x) < 5:
        raise InputError(f"Central differences need at least 5 samples, got {len(x)}.")
    dx = np.gradient(x, axis=0)
    ddx = np.empty_like(dx)
    ddx[1:-1] = x[2:] - 2 * x[1:-1] + x[:-2]
    ddx[0], ddx[-1] = ddx[1], ddx[-2]
    near, far = x[3:-1] - x[1:-3], x[4:] - x[:-4]
    dx[2:-2] = (8 * near - far) / 12
    near, far = x[3:-1] + x[1:-3], x[4:] + x[:-4]
    ddx[2:-2] = (16 * near - far - 30 * x[2:-2]) / 12
    return dx * rate, ddx * rate**2


def smoothed(x: np.ndarray, rate: float, cutoff_hz: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Positions without noise, and their velocities and accelerations.

    Quaternions are no columns to filter and to differentiate one by one: keep them out.

    Args:
        x: Uniformly sampled positions, rad or m (N,) or (N, k). A column with NaN becomes NaN.
        rate: Samples per second, Hz.
        cutoff_hz: Frequency that half of the amplitude passes, Hz.

    Returns:
        x, ẋ and ẍ in the shape of x; `settling` samples at either end are not to be trusted.

    Raises:
        InputError: As for `low_pass`.
    """
    x = low_pass(x, rate, cutoff_hz)
    return x, *differences(x, rate)


def settling(rate: float, cutoff_hz: float) -> int:
    """How many samples at either end filter and differences need to settle."""
    return int(np.ceil(SETTLING * rate / cutoff_hz))


def chosen_cutoff(x: np.ndarray, rate: float) -> float:
    """The cut-off frequency that a recording of positions asks for, by residual analysis of its velocities.

    After Winter, Biomechanics and Motor Control of Human Movement, 4th ed., section 3.4.4.3: the RMS of what a filter
    takes away is drawn over its cut-off. Where only noise is left to take, the curve is straight; the line meets the
    ordinate at the RMS of all noise, and the cut-off that takes away just as much balances noise against distortion.
    Winter looks at positions; the plain differences looked at here weigh noise as a derivative does, and ask for less:
    noise in a regressor biases parameters, a cut-off too low that acts on both sides does not.

    Args:
        x: Uniformly sampled positions, rad or m (N,) or (N, k). Columns that rest or hold NaN have no say.
        rate: Samples per second, Hz.

    Returns:
        The highest cut-off that any column asks for, Hz, at most 0.4 of the rate.

    Raises:
        InputError: There are too few samples, or no column has a motion well below half the rate.
    """
    x = np.asarray(x, float).reshape(len(x), -1)
    if len(x) < 50:
        raise InputError(f"Choosing a cut-off needs at least 50 samples, got {len(x)}; state a cut-off in Hz.")
    x = x[:, np.isfinite(x).all(axis=0)]
    x = x - x.mean(axis=0)
    moves = np.ptp(x, axis=0) > 1e-9
    fast = _residual(x, TAIL) > 0.5 * x.std(axis=0)
    x = x[:, moves & ~fast]
    if not x.shape[1]:
        raise InputError(
            f"Choosing a cut-off needs a column that moves below {TAIL * rate:g} Hz, a tenth of the rate, and is not "
            "noise alone; state a cut-off in Hz."
        )
    # At high rates most of the noise lies where no filter would leave it, and would outweigh what matters.
    block = max(1, min(int(rate / (10 * _residual_cutoff(x, rate))), len(x) // 50))
    x = x[: len(x) // block * block].reshape(-1, block, x.shape[1]).mean(axis=1)
    return _residual_cutoff(np.diff(x, axis=0), rate / block)


def _residuals(x: np.ndarray, shares: np.ndarray) -> np.ndarray:
    """RMS of what a filter takes away, per cut-off as a share of the rate, and column (c, k)."""
    return np.stack([_residual(x, share) for share in shares.tolist()])


def _residual(x: np.ndarray, share: float) -> np.ndarray:
    """RMS of what one filter takes away, per column (k,)."""
    return np.asarray(np.sqrt(np.mean((x - _passed(x, share)) ** 2, axis=0)))


def _residual_cutoff(x: np.ndarray, rate: float) -> float:
    """The highest cut-off over the columns at which the residual is that of all noise, Hz."""
    x = np.asfortranarray(x)  # Columns are filtered one by one.
    shares = np.geomspace(LOWEST, HIGHEST, 80)
    tail = shares[shares >= TAIL]
    _, noise = np.polyfit(tail, _residuals(x, tail), 1)
    # A column that asks for no higher cut-off needs no more filters.
    for share in shares.tolist():
        higher = ~(noise >= _residual(x, share))
        if not higher.any():
            return rate * share
        x, noise = x[:, higher], noise[higher]
    return rate * HIGHEST
