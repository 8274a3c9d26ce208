"""A laboratory's sensors: their noise, and the uncertainty of their set-up."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

CAREFUL = {
    "origin": 0.001,
    "rotation": np.radians(0.1),
    "gain": 0.002,
    "gravity": np.radians(0.05),
    "zero": np.radians(0.5),
    "axis": np.radians(0.5),
}
"""Set-up uncertainty of a laboratory with calibrated plates and joints, as `ident.setup.PRIORS`."""


@dataclass(frozen=True)
class Laboratory:
    """Noise and set-up errors of a laboratory.

    Attributes:
        angle_deg: Standard deviation of joint angles, degrees.
        decay: Autocorrelation of their noise at a lag of one sample.
        position: Standard deviation of the pelvis's position, m.
        force: Standard deviation of the plates' forces, N; a tenth of it for moments, N m; a third for the rail.
        late: Delay of plates and rail, s.
        rate: Samples per second, Hz.
        rail: True if there is a rail to hold.
        markers: True if angles and the pelvis's pose are fitted to markers, instead of having noise of their own.
        marker: Standard deviation of the markers' positions, m.
        skin: Standard deviation of the skin's motion, m; see `experiments.studies.person_markers`.
        setup: Uncertainty of its set-up, as `CAREFUL`, which its recordings state.
    """

    angle_deg: float = 0.5
    decay: float = 0.0
    position: float = 0.002
    force: float = 1.5
    late: float = 0.02
    rate: float = 100.0
    rail: bool = True
    markers: bool = False
    marker: float = 0.002
    skin: float = 0.004
    setup: Mapping[str, float] = field(default_factory=lambda: CAREFUL)

    def times(self, seconds: float) -> np.ndarray:
        """Sample times of a recording of this length, s (N,)."""
        return np.arange(round(seconds * self.rate)) / self.rate
