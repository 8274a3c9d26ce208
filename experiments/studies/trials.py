"""Monte Carlo trials of one study by a worker pool, interrupted and resumed without loss."""

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.data.fitting import TrajectoryTrial, Trial
from experiments.data.study_file import StudyFile
from experiments.runs.checkpoint import Checkpoint
from experiments.runs.workers import Workers
from ident.recordings.recording import Recording
from sim.simulation.simulate import simulate_many, with_noise

FILE, TRAJECTORY_FILE = "trials.npz", "trials_trajectory.npz"
"""Files in the output folder with the outcomes of all trials, by least squares and by the trajectory estimate."""

BATCH = 8
"""Largest number of trials in a worker's task: half a second's work if all noise is drawn anew."""

Outcome = np.ndarray
"""Errors and predicted standard deviations of each model's base parameters (models, 2, parameters)."""


def outcome(*fits: Trial | TrajectoryTrial) -> Outcome:
    """Outcome of a trial with these fits."""
    return np.array([[fit.error, fit.std] for fit in fits])


@dataclass(frozen=True, eq=False)
class Draw:
    """A source of recordings that differ by their noise.

    Attributes:
        file: The study; the seed of trial k is made of its seed and k.
        redrawn: One of `defaults.REDRAWN`.
        recording: The one simulation of `sensors` and `wrench`.
    """

    file: StudyFile
    redrawn: str
    recording: Recording

    @classmethod
    def of(cls, file: StudyFile, redrawn: str, recording: Recording) -> "Draw":
        """Draw of a study, from the noise to redraw and the study's recording."""
        if redrawn == "wrench":
            # Only wrench channels keep their noise; their names end as `Recording.wrench` expects.
            noise = {k: v if k.endswith(("_force", "_torque")) else 0.0 for k, v in recording.noise.items()}
            recording = replace(recording, noise=noise)
        return cls(file, redrawn, recording)

    @property
    def identity(self) -> dict[str, Any]:
        """Settings that all trials of one run share."""
        return {
            "scene": self.file.scene.identity,
            "scene_sha256": self.recording.provenance["scene_sha256"],
            "excitation": self.recording.provenance["excitation"],
            **{key: getattr(self.file, key) for key in ("samples", "noise_scale")},
            "redrawn": self.redrawn,
            "seed": self.file.seed,
        }

    def recordings(self, trials: Iterable[int], threads: int = 1) -> list[Recording]:
        """The recordings of some trials, independent of workers and threads."""
        seeds = [np.random.SeedSequence((self.file.seed, k)) for k in trials]
        if self.redrawn != "all":
            return [with_noise(self.recording, np.random.default_rng(seed)) for seed in seeds]
        return simulate_many(
            self.file.spec(),
            self.file.excitation,
            seeds=[int(seed.generate_state(1)[0]) for seed in seeds],
            samples=self.file.samples,
            noise_scale=self.file.noise_scale,
            threads=threads,
        )


def run_trials(
    draw: Draw, analyse: Callable[[Recording], Outcome], trials: int, kept: Checkpoint, workers: Workers
) -> np.ndarray:
    """Outcomes of all trials (trials, models, 2, parameters), the same with any workers.

    Args:
        draw: Source of the recordings.
        analyse: Function of a recording; sent to the workers, so a module's function or a partial of one.
        trials: Number of trials.
        kept: File of the finished trials.
        workers: Workers that share them.
    """
    work = partial(_outcomes, draw, analyse, workers.threads)
    return np.array(workers.collected(work, range(trials), kept, batch=BATCH))


def kept_in(folder: Path, draw: Draw) -> tuple[Checkpoint, Checkpoint]:
    """Checkpoints of the trials, and of those of the trajectory estimate."""
    names = {FILE: "trials", TRAJECTORY_FILE: "trajectory trials"}
    first, second = (Checkpoint(what, folder / file, draw.identity) for file, what in names.items())
    return first, second


def _outcomes(
    draw: Draw, analyse: Callable[[Recording], Outcome], threads: int, trials: Sequence[int]
) -> list[list[Any]]:
    """Outcomes of a batch of trials; run by workers."""
    return [analyse(recording).tolist() for recording in draw.recordings(trials, threads)]
