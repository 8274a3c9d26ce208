"""Residuals of a fit on the samples that it is judged by, beside those of other candidates."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ident.estimation.noise import beside_others
from ident.estimation.samples import Samples
from ident.regression.ordinary import Fit

ESTIMATE, MODEL, LEAST_SQUARES = "estimate", "model", "least squares"
"""Names of the candidates: the estimate, the model as it came, and least squares on filtered states."""


def where_moving(resting: np.ndarray) -> np.ndarray:
    """Mask of the measurements that count: where joints that rub move, or all of a channel where they hardly do.

    In a twentieth of the samples there is no sample of its signal.

    Args:
        resting: Mask of the torques of joints that rub and rest (M, C).
    """
    return ~resting | (resting.mean(axis=0) > 0.95)


def picked(versions: np.ndarray, chosen: np.ndarray) -> np.ndarray:
    """Entries of several arrays (V, M, C), each of the version that is chosen for it (M, C)."""
    return np.take_along_axis(versions, chosen[None], axis=0)[0]


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Held-out samples and a fit's residuals on them.

    Attributes:
        time: Sample times, s; those of each further recording continue those of the one before (M,).
        starts: Indices of the samples with which a recording begins, or continues after a gap.
        versions: The samples with each of the motions that channels are predicted from.
        chosen: Index of the version that predicts each channel (M, C).
        fit: The fit.
        residual: Measured minus predicted (M, C).
        resting: Mask of the torques of joints that rub and are slower than their v0: not judged (M, C).
        rivals: Residuals of other candidates on the same samples, by name (M, C).
        left_out: Samples of each recording, if each is predicted from the others.
        fitted: True if these are samples that were fitted, as nothing was held out.
    """

    time: np.ndarray
    starts: tuple[int, ...]
    versions: tuple[Samples, ...]
    chosen: np.ndarray
    fit: Fit
    residual: np.ndarray
    resting: np.ndarray
    rivals: Mapping[str, np.ndarray] = field(default_factory=dict)
    left_out: tuple[slice, ...] = ()
    fitted: bool = False

    @property
    def part(self) -> str:
        """Samples that these are, in a word."""
        return "fitted" if self.fitted else "held-out"

    @cached_property
    def samples(self) -> Samples:
        """Measured channels, and the motion that most of them are predicted from."""
        motion = self.versions[np.bincount(self.chosen.ravel()).argmax()].motion
        return Samples(motion, picked(np.stack([each.measured for each in self.versions]), self.chosen))

    @cached_property
    def moving(self) -> np.ndarray:
        """Mask of the measurements that are judged (M, C)."""
        return where_moving(self.resting)

    @property
    def signal(self) -> np.ndarray:
        """Standard deviation of each channel where it is judged, in a flat one that of its kind (C,)."""
        return self._signal(slice(None))

    @property
    def rms(self) -> np.ndarray:
        """Root mean square of each channel's residual where it is judged (C,)."""
        return _rms(self.residual, self.moving)

    @property
    def ratio(self) -> np.ndarray:
        """RMS residual over the signal's standard deviation, of each channel (C,)."""
        return self.ratio_of(self.residual)

    def ratio_of(self, residual: np.ndarray, part: slice = slice(None)) -> np.ndarray:
        """The same of any residuals (M, C) in a part of the samples."""
        return _rms(residual[part], self.moving[part]) / self._signal(part)

    def ratio_at_rest(self, residual: np.ndarray) -> np.ndarray:
        """RMS of residuals (M, C) of joints that rest, over the signal of those that move; NaN without any (C,)."""
        return _rms(residual, self.resting) / self.signal

    def interrupted(self, x: np.ndarray, by: float = np.nan) -> np.ndarray:
        """An array of the samples with another row before each recording or gap, where curves are interrupted.

        Args:
            x: One row for each sample (M, …).
            by: Value of the rows.
        """
        return np.insert(x, self.starts[1:], by, axis=0)

    @property
    def curves(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Times (M,), and measured and predicted channels (M, C), all `interrupted`."""
        measured = self.samples.measured
        time, measured, predicted = map(self.interrupted, (self.time, measured, measured - self.residual))
        return time, measured, predicted

    @property
    def relative_rms(self) -> np.ndarray:
        """RMS residual over the RMS of the signal, mean included, as often published (C,)."""
        return self.rms / np.maximum(_rms(self.samples.measured, self.moving), 1e-300)

    def ratio_with(self, psi: np.ndarray) -> np.ndarray:
        """`ratio` with other base parameters (r,)."""
        return self.ratio_of(self.residual_with(psi))

    def residual_with(self, psi: np.ndarray) -> np.ndarray:
        """Residuals with other base parameters (r,), and the likeliest drives and offsets given these (M, C)."""
        fit = self.fit.with_psi(psi)
        return picked(np.stack([fit.residual(each) for each in self.versions]), self.chosen)

    def _signal(self, part: slice) -> np.ndarray:
        measured, moving = self.samples.measured[part], self.moving[part]
        mean = np.where(moving, measured, 0).sum(axis=0) / np.maximum(moving.sum(axis=0), 1)
        return beside_others(np.nan_to_num(_rms(measured - mean, moving)), self.fit.equations.channels)


def _rms(x: np.ndarray, counting: np.ndarray) -> np.ndarray:
    """Root mean square of the entries that count (M, C), NaN where none does (C,)."""
    number = np.where(counting.any(axis=0), counting.sum(axis=0), np.nan)
    return np.sqrt(np.where(counting, x**2, 0).sum(axis=0) / number)
