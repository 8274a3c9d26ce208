"""Residuals of a fit on the samples that it is judged by."""

from dataclasses import dataclass

import numpy as np

from ident.estimation.channel_scales import channel_scales
from ident.estimation.samples import Samples
from ident.regression.ordinary import Fit


@dataclass(frozen=True, eq=False)
class HeldOut:
    """Held-out samples and a fit's residuals on them.

    Attributes:
        time: Sample times, s; those of each further recording continue those of the one before (M,).
        samples: The samples.
        fit: The fit.
        residual: Measured minus predicted (M, C).
        starts: Indices of the samples with which a recording begins, or continues after a gap.
    """

    time: np.ndarray
    samples: Samples
    fit: Fit
    residual: np.ndarray
    starts: tuple[int, ...] = (0,)

    @property
    def ratio(self) -> np.ndarray:
        """RMS residual over the scale of the signal, of each channel (C,)."""
        return self._ratio(self.residual)

    @property
    def scales(self) -> np.ndarray:
        """The signal's standard deviation, in a flat channel that of its kind (C,)."""
        return channel_scales([self.samples.measured], self.fit.equations.channels)

    def interrupted(self, x: np.ndarray, by: float = np.nan) -> np.ndarray:
        """An array of the samples with another row before each recording or gap, where curves are interrupted.

        Args:
            x: One row for each sample (M, …).
            by: Value of the rows.
        """
        return np.insert(x, self.starts[1:], by, axis=0)

    @property
    def relative_rms(self) -> np.ndarray:
        """RMS residual over the RMS of the signal, mean included, as often published (C,)."""
        rms, signal = (np.sqrt((x**2).mean(axis=0)) for x in (self.residual, self.samples.measured))
        return rms / np.maximum(signal, 1e-300)

    def ratio_with(self, psi: np.ndarray) -> np.ndarray:
        """`ratio` with other base parameters (r,)."""
        return self._ratio(self.residual_with(psi))

    def residual_with(self, psi: np.ndarray) -> np.ndarray:
        """Residuals with other base parameters (r,), and the likeliest drives and offsets given these (M, C)."""
        return self.fit.with_psi(psi).residual(self.samples)

    def _ratio(self, residual: np.ndarray) -> np.ndarray:
        return np.sqrt((residual**2).mean(axis=0)) / self.scales
