"""Comparison of estimators on the recording of a person who bows on a force plate, and with the scaled model.

The recording is of the Italian Institute of Technology (Latella et al., Sensors 16(5):727, 2016,
doi:10.3390/s16050727) and not ours to ship.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from scipy.signal import butter, sosfiltfilt

from experiments.studies.competitors import USUAL
from ident.errors import InputError
from ident.estimate import Estimate
from ident.estimation.channel_scales import channel_scales
from ident.estimation.preparation import prepared
from ident.identification import identified
from ident.mechanism.mechanism import Mechanism
from ident.recordings.log import read_log
from ident.recordings.recording import Recording
from ident.trajectory.fit.iteration import Report
from sim.models.mechanism import mechanism

FILES = {"model": "three_link_human.xml", "recording": "bowing.csv"}
"""Files in the folder of the recording."""

BASE = "foot"
"""Body whose frame is {0}, in which the force plate's wrench is stated."""

COLUMNS = Path(__file__).with_name("bowing.toml")
"""Mapping of the recording's columns."""

JUDGED_AT = 3.0
"""Cut-off below which predictions are judged, Hz; a person who bows moves below it."""


@dataclass(frozen=True, eq=False)
class Study:
    """Estimates from one recording.

    Attributes:
        joint: The trajectory estimate.
        others: Other estimates by name.
    """

    trajectory: Estimate
    others: Mapping[str, Estimate]

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the base parameters."""
        return self.trajectory.base.names

    @cached_property
    def candidates(self) -> dict[str, tuple[np.ndarray, np.ndarray | None]]:
        """Base parameters and their standard deviations by estimator (r,); the model has no standard deviations."""
        model = self.trajectory.base.regroup(self.trajectory.prepared.mechanism.known)
        least_squares = {name: (each.psi, each.std_setup) for name, each in self.others.items()}
        return {
            "scaled model": (model, None),
            **least_squares,
            "trajectory estimate": (self.trajectory.psi, self.trajectory.std_setup),
        }

    @cached_property
    def held_out(self) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
        """Times of the held-out part (M,), its channels, and each estimator's predictions of them (M, C).

        All are low-passed at `JUDGED_AT` and predicted at the same states, smoothed from the angles alone. A constant
        of each channel, by which plates drift, does not count.
        """
        held, rate = self.trajectory.held_out, self.trajectory.prepared.recording.rate
        low_pass = butter(2, JUDGED_AT, fs=rate, output="sos")

        def below(x: np.ndarray) -> np.ndarray:
            return np.asarray(sosfiltfilt(low_pass, x, axis=0))

        measured = below(held.samples.measured)
        left = {name: below(held.residual_with(psi)) for name, (psi, _) in self.candidates.items()}
        return held.time, measured, {name: measured - x + x.mean(axis=0) for name, x in left.items()}

    @property
    def ratios(self) -> dict[str, np.ndarray]:
        """Standard deviation of the prediction errors on the held-out part over the scale of the signal (C,)."""
        _, measured, predicted = self.held_out
        scales = channel_scales([measured], self.trajectory.channels)
        return {name: (measured - x).std(axis=0) / scales for name, x in predicted.items()}


def study(folder: Path, report: Report | None = None) -> Study:
    """Identifies the person by several estimators.

    Args:
        folder: Folder of the model and the recording.
        report: Called in each round of the trajectory estimate.

    Raises:
        InputError: One of the files is missing.
    """
    who, recording = _read(folder)
    trajectory = identified(prepared(who, recording), report=report)
    others = {
        f"least squares, {USUAL:g} Hz": identified(prepared(who, recording, cutoff=USUAL), estimator="ordinary"),
        "weighted, cut-off chosen": identified(prepared(who, recording, cutoff="auto"), estimator="weighted"),
    }
    return Study(trajectory, others)


def _read(folder: Path) -> tuple[Mechanism, Recording]:
    """The person's model and the recording."""
    missing = [name for name in FILES.values() if not (folder / name).is_file()]
    if missing:
        raise InputError(
            f"--data needs a folder with {' and '.join(FILES.values())}, made of the recordings that the Italian "
            f"Institute of Technology publishes; '{folder}' has no {' and no '.join(missing)}."
        )
    who = mechanism(folder / FILES["model"], BASE)
    return who, read_log(folder / FILES["recording"], who, COLUMNS)
