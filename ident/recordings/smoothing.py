"""Velocities and accelerations from sampled positions: one zero-phase low-pass filter, and central differences."""

from bisect import bisect_left

import numpy as np
from scipy.linalg import lapack

from ident.errors import InputError

PADDING = 9
"""Least padding at either end in samples: three for each coefficient of the filter's denominator."""

SETTLING = 1.5
"""Settling time of filter and differences at either end, in periods of the cut-off frequency."""

LEAST = 1e-5
"""Least cut-off for which the filter's coefficients differ from those for zero, as a share of the rate."""

LOWEST = 0.005
HIGHEST = 0.4
"""Range of cut-offs that `chosen_cutoff` considers, as shares of the rate."""

TAIL = 0.1
"""Share of the rate above which `chosen_cutoff` takes residuals for noise."""


def low_pass(x: np.ndarray, rate: float, cutoff_hz: float) -> np.ndarray:
    """Low-pass filtered samples, without delay.

    Wrenches need the same filter as positions: removing the same from both sides of `Yφ = Γ` leaves φ almost unbiased.

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
    # With a short padding the motion would stop a few samples beyond an end, and the jerk would pass the filter.
    reach = min(max(PADDING, 2 * settling(rate, cutoff_hz)), len(x) - 1)
    return _passed(x, cutoff_hz / rate, reach)


def _passed(x: np.ndarray, share: float, padding: int = PADDING) -> np.ndarray:
    """Output of the filter, applied forward and backward.

    Either end is padded by the samples next to it, point-reflected about the last one.

    Args:
        x: Samples (N,) or (N, k).
        share: Cut-off as a share of the rate.
        padding: Number of padded samples at either end.
    """
    if len(x) <= PADDING:
        raise InputError(f"Low-pass filtering needs more than {PADDING} samples, got {len(x)}.")
    before, after = 2 * x[0] - x[padding:0:-1], 2 * x[-1] - x[-2::-1][:padding]
    forward = _filtered(np.concatenate([before, x, after]), share)
    return _filtered(forward[::-1], share)[::-1][padding:-padding]


def _filtered(x: np.ndarray, share: float) -> np.ndarray:
    """Output of a second-order Butterworth filter by the bilinear transform, in steady state at the first sample.

    `(1 + √2 K + K²) y_i + 2 (K² - 1) y_i-1 + (1 - √2 K + K²) y_i-2 = K² (x_i + 2 x_i-1 + x_i-2)` with K = tan(π share)
    is, divided by the first factor, a banded triangular system in y. It is solved as such, because importing
    `scipy.signal` also imports scipy's statistics, a third of the start-up time.
    """
    # With no columns scipy's wrapper of LAPACK writes out of bounds.
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
    """Low-pass filtered positions, and their velocities and accelerations.

    Do not pass quaternions: their components cannot be filtered and differentiated one by one.

    Args:
        x: Uniformly sampled positions, rad or m (N,) or (N, k). A column with NaN becomes NaN.
        rate: Samples per second, Hz.
        cutoff_hz: Frequency that half of the amplitude passes, Hz.

    Returns:
        x, ẋ and ẍ in the shape of x; `settling` samples at either end are unreliable.

    Raises:
        InputError: As for `low_pass`.
    """
    x = low_pass(x, rate, cutoff_hz)
    return x, *differences(x, rate)


def settling(rate: float, cutoff_hz: float) -> int:
    """Number of samples at either end in which filter and differences settle."""
    return int(np.ceil(SETTLING * rate / cutoff_hz))


def chosen_cutoff(x: np.ndarray, rate: float) -> float:
    """Cut-off frequency for a recording of positions, by residual analysis of its velocities.

    After Winter, Biomechanics and Motor Control of Human Movement, 4th ed., section 3.4.4.3: the RMS of the residual
    that a filter removes is a function of its cut-off. Where only noise is removed the function is linear; the line
    meets the ordinate at the RMS of all noise. The cut-off whose residual has that RMS balances noise and distortion.
    Winter uses positions. Differences of positions, used here, weight noise like a derivative and give a lower cut-off:
    noise in a regressor biases parameters, a low cut-off on both sides does not.

    Args:
        x: Uniformly sampled positions, rad or m (N,) or (N, k). Columns that rest or hold NaN are ignored.
        rate: Samples per second, Hz.

    Returns:
        The highest cut-off of all columns, Hz, at most 0.4 of the rate.

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
    # At high rates most of the noise is far above any cut-off and would dominate, so samples are averaged in blocks.
    block = max(1, min(int(rate / (10 * _residual_cutoff(x, rate))), len(x) // 50))
    x = x[: len(x) // block * block].reshape(-1, block, x.shape[1]).mean(axis=1)
    return _residual_cutoff(np.diff(x, axis=0), rate / block)


def _residual(x: np.ndarray, share: float) -> np.ndarray:
    """RMS of the residual that one filter removes, per column (k,)."""
    return np.asarray(np.sqrt(np.mean((x - _passed(x, share)) ** 2, axis=0)))


def _residual_cutoff(x: np.ndarray, rate: float) -> float:
    """Highest cut-off over the columns at which the RMS of the residual equals that of all noise, Hz."""
    x = np.asfortranarray(x)  # Columns are filtered one by one.
    shares = np.geomspace(LOWEST, HIGHEST, 80)
    tail = shares[shares >= TAIL]
    _, noise = np.polyfit(tail, np.stack([_residual(x, share) for share in tail.tolist()]), 1)

    def is_noise(k: int) -> bool:
        return bool((noise >= _residual(x, float(shares[k]))).all())

    # A higher cut-off leaves less, so that few of them have to be tried.
    first = bisect_left(range(len(shares) - 1), True, key=is_noise)
    return rate * float(shares[first])
