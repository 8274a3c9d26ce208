"""Sampled signals: resolution, noise, limits, outliers and gaps, and smoothing by one zero-phase low-pass filter."""

from bisect import bisect_left
from collections.abc import Iterable
from typing import NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from scipy.linalg import lapack

from ident.errors import InputError
from ident.recordings.times import Sampled
from ident.tolerances import AT_ONCE, NORMAL_MAD, ROUNDING

UNIFORM = 1 / np.sqrt(12)
"""Standard deviation of the error of rounding to a step of one, which is uniformly distributed."""

REPEATED = 0.8
"""Share of the samples with repeated values above which single values (repaired, interpolated) are ignored: at a
resolution that is coarse relative to the range nearly all values are repeated."""

OFF = 0.15
"""Distance from an integer up to which a difference counts as a multiple of the step: values are rounded once more when
they are written in decimals or converted to other units."""

ON_LATTICE = 0.9
"""Least share of the differences that are multiples; of a signal without steps it is twice `OFF`."""

FAR = 10
"""Differences of at least this many steps are ignored: the error of the step is multiplied by their number."""

ENOUGH = 8
"""Least number of differences, so that they are not multiples by chance; one suffices if every value is repeated."""

MOST = 5000
"""Samples that are used at most: longer signals are thinned, because sorting them would be slow."""

CANDIDATES = 32
"""Number of candidates for the step: this many of the smallest differences, and as many quantiles of the lower half."""

RESTS, NOISE_ALONE = 1e-4, 1.2
"""A coordinate rests if its range is at most this share of the largest range of all, or its standard deviation is below
this multiple of that of its noise."""


def quantum(x: np.ndarray) -> float:
    """Resolution of a signal: the step of which its values are multiples, zero if none is detected.

    A step much finer than the spacing of the sampled values is not detected; it is far below the noise.

    Args:
        x: Samples, NaN where one is missing (N,).
    """
    x = x[:: max(1, len(x) // MOST)]
    values, counts = _distinct(x[np.isfinite(x)])
    again = counts > 1
    if counts[again].sum() > REPEATED * counts.sum():
        values, counts = values[again], counts[again]
    differences = np.sort(np.diff(values))
    if not len(differences):
        return 0.0
    fewest = 1 if (counts > 1).all() else ENOUGH
    tried = np.append(differences[:CANDIDATES], np.quantile(differences, np.linspace(0, 0.5, CANDIDATES)))
    for step in np.unique(tried)[::-1]:
        near = differences[: np.searchsorted(differences, FAR * step)]
        ratios = near / step
        steps = np.rint(ratios)
        on = (steps > 0) & (np.abs(ratios - steps) < OFF)
        if np.count_nonzero(on) >= max(fewest, ON_LATTICE * len(near)):
            return float(near[on].sum() / steps[on].sum())
    return 0.0


def quanta(columns: Iterable[np.ndarray]) -> np.ndarray:
    """The `quantum` of each of several signals."""
    return np.array([quantum(x) for x in columns])


def white_noise(*parts: np.ndarray, robust: bool = False) -> float:
    """Standard deviation of the white part of a signal's noise, by its fourth differences.

    Args:
        parts: Samples of each contiguous part of the signal, NaN where one is missing (N,).
        robust: True to use the median, which ignores a few jumps.
    """
    fourth = np.concatenate([np.diff(x[np.isfinite(x)], 4) for x in parts])
    if not len(fourth):
        return 0.0
    spread = NORMAL_MAD * np.median(np.abs(fourth)) if robust else fourth.std()
    # That of unit white noise has 1 + 16 + 36 + 16 + 1 as its variance; that of motion is negligible.
    return float(spread / np.sqrt(70))


def at_rest(x: np.ndarray, largest: float) -> bool:
    """True if a coordinate rests, to within its resolution or its noise.

    Args:
        x: Its samples, NaN where one is missing (N,).
        largest: Largest range of all coordinates.
    """
    x = x[np.isfinite(x)]
    if not len(x) or np.ptp(x) <= RESTS * largest:
        return True
    one_step = ((x == x.min()) | (x == x.max())).all()
    return bool(one_step or x.std() < NOISE_ALONE * white_noise(x))


def _distinct(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Values that differ by more than rounding, ascending, and the number of samples with each."""
    values, counts = np.unique(x, return_counts=True)
    if not len(values):
        return values, counts
    apart = np.append(True, np.diff(values) > ROUNDING * max(np.abs(values[[0, -1]]).max(), 1e-300))
    return values[apart], np.add.reduceat(counts, np.flatnonzero(apart))


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


INTERPOLATED = 0.05
"""Longest time between samples that is no gap, s: over it a motion of a few hertz is linear to some per cent of its
size. In a stream with a lower rate one missing sample is no gap."""

SHARE, FEWEST = 0.005, 5
"""Least share and least number of samples at an extreme value for it to be a limit."""

LASTS = 3
"""Least length of the longest run of such samples: with rounded values single ones occur by chance."""

CROWDED = 4.0
"""Least ratio of the samples at an extreme value to those at any of the `NEXT` adjacent values. At the peak of a
rounded sinusoid the ratio is up to 2.4, 1 over √2 - 1."""

NEXT = 3
"""Number of values adjacent to the extreme one that are compared."""

LEVELS = 10
"""Least number of distinct other values: a channel that switches between few levels is not clipped."""

STILL, BY_NOISE = 0.003, 6.0
"""A coordinate moves during a run at a limit if it changes by more than this share of its range plus this many standard
deviations of its noise. During a rest sensors repeat a value without being clipped."""

WINDOW = 11
"""Samples of the running median."""

GROSS = 8.0
"""Multiple of the typical deviation from the running median beyond which a sample is an outlier, if it also exceeds
the channel's own spread."""

ISOLATED = 2
"""Longest run of samples that counts as an outlier; an impact lasts longer."""


def runs(samples: np.ndarray) -> np.ndarray:
    """First samples and ends of the runs of true samples in a mask (N,), in order (k, 2)."""
    edges = np.diff(np.concatenate([[False], samples, [False]]).astype(np.int8))
    return np.stack([np.flatnonzero(edges > 0), np.flatnonzero(edges < 0)], axis=1)


def running_median(x: np.ndarray, width: int, at: np.ndarray | None = None) -> np.ndarray:
    """Medians of the windows around samples (N,), or around those `at` indices (n,), beyond the ends of the end values.

    Args:
        x: Samples (N,).
        width: Samples of a window; one of even width begins a sample earlier, and gives the larger middle value.
        at: Indices of the windows' samples; by default all.
    """
    middle = width // 2
    windows = sliding_window_view(np.pad(x, (middle, width - middle - 1), mode="edge"), width)
    wanted = np.arange(len(x)) if at is None else at
    out = np.empty(len(wanted))
    step = max(1, AT_ONCE // width)
    for first in range(0, len(wanted), step):
        part = slice(first, first + step)
        out[part] = np.partition(windows[wanted[part]], middle, axis=1)[:, middle]
    return out


def longest_step(stream: Sampled) -> float:
    """Longest time between samples of a stream that is no gap, s."""
    return max(INTERPOLATED, 2 * float(np.median(np.diff(stream.time)))) if len(stream.time) > 1 else INTERPOLATED


def stretches(time: np.ndarray, inside: np.ndarray) -> list[slice]:
    """Slices of consecutive samples without a gap.

    Args:
        time: Common times, s (N,).
        inside: Mask of the times that lie in no gap (N,).
    """
    at = np.flatnonzero(inside)
    if not len(at):
        return []
    far = np.diff(time[at]) > longest_step(Sampled(time, time))
    breaks = np.flatnonzero(far | (np.diff(at) > 1)) + 1
    return [slice(int(run[0]), int(run[-1]) + 1) for run in np.split(at, breaks)]


class Limit(NamedTuple):
    """A value beyond which a signal does not go.

    Attributes:
        value: The value.
        samples: Mask of the samples at it (N,).
    """

    value: float
    samples: np.ndarray


def limits(x: np.ndarray) -> list[Limit]:
    """Limits at which a signal is clipped: its smallest value, its largest, both or none.

    Zero is no limit: an unloaded force plate reads it. A signal may also rest at an extreme value; `moves` tells the
    two apart by the motion.

    Args:
        x: Samples, NaN where one is missing (N,).
    """
    if not np.nanmax(x, initial=-np.inf) > np.nanmin(x, initial=np.inf):
        return []
    ends = (_limit(x, float(np.nanmin(x))), _limit(x, float(np.nanmax(x))))
    return [each for each in ends if each is not None]


def _limit(x: np.ndarray, extreme: float) -> Limit | None:
    """The extreme value as a limit, None if it is none."""
    same = ROUNDING * np.nanmax(np.abs(x - extreme))
    samples = np.abs(x - extreme) <= same
    count = int(samples.sum())
    if extreme == 0 or count < max(FEWEST, SHARE * len(x)) or _longest(samples) < LASTS:
        return None
    others = np.round(np.abs(x - extreme)[np.isfinite(x) & ~samples] / same)
    _, beside = np.unique(others, return_counts=True)
    alone = len(beside) >= LEVELS and count > CROWDED * beside[:NEXT].max()
    return Limit(extreme, samples) if alone else None


def _longest(samples: np.ndarray) -> int:
    """Length of the longest run of true samples in a mask (N,)."""
    return int(np.diff(runs(samples)).max(initial=0))


def moves(samples: np.ndarray, q: np.ndarray) -> bool:
    """True if the mechanism moves while a signal is at a limit; otherwise the signal rests there.

    Args:
        samples: Mask of the samples at the limit (N,).
        q: Joint coordinates (N, n).
    """
    spans = [slice(first, end) for first, end in runs(samples) if end - first >= LASTS]
    enough = STILL * np.ptp(q, axis=0) + BY_NOISE * np.array([white_noise(x) for x in q.T])
    crossed = [(np.ptp(q[span], axis=0) > enough).any() for span in spans]
    # The mechanism has to move in most of the runs.
    return bool(np.mean(crossed or [0.0]) > 1 / 2)


def despiked(x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Channels with their isolated gross outliers interpolated (Hampel's filter).

    A step of the resolution is no outlier, not even in a channel that is constant for a while.

    Args:
        x: Channels (N, C); those with NaN stay as they are.

    Returns:
        The channels (N, C), and the number of samples replaced in each (C,).
    """
    out, counts = np.array(x, float), np.zeros(x.shape[1], int)
    for c in np.flatnonzero(np.isfinite(out).all(axis=0)):
        bad = _gross(out[:, c])
        for first, end in runs(bad):
            bad[first:end] = end - first <= ISOLATED
        counts[c] = bad.sum()
        if bad.any() and not bad.all():
            out[bad, c] = np.interp(np.flatnonzero(bad), np.flatnonzero(~bad), out[~bad, c])
    return out, counts


def _gross(x: np.ndarray) -> np.ndarray:
    """Mask of the samples of a channel that are far from the running median (N,)."""
    deviation = np.abs(x - running_median(x, WINDOW))
    usual = max(np.median(deviation), UNIFORM * quantum(x))
    least = NORMAL_MAD * max(GROSS * usual, np.median(np.abs(x - np.median(x))))
    # The typical deviation around a sample matters for few of them, and takes most of the time.
    out = deviation > least
    far = np.flatnonzero(out)
    out[far] = deviation[far] > NORMAL_MAD * GROSS * running_median(deviation, 5 * WINDOW, far)
    return out
