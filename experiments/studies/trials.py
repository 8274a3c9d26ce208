"""Monte Carlo trials of one study by a worker pool, interrupted and resumed without loss."""

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.data.fitting import TrajectoryTrial, Trial
from experiments.data.study_file import StudyFile
from experiments.runs.checkpoint import Checkpoint
from ident.errors import InputError
from ident.estimation.pieces import in_order
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
    draw: Draw,
    analyse: Callable[[Recording], Outcome],
    trials: int,
    *,
    executor: Executor,
    ahead: int | None = None,
    threads: int = 1,
    file: Path,
    done: Sequence[Outcome] = (),
    what: str = "trials",
) -> np.ndarray:
    """Outcomes of all trials (trials, models, 2, parameters), the same with any executor.

    Args:
        draw: Source of the recordings.
        analyse: Function of a recording; sent to the workers, so a module's function or a partial of one.
        trials: Number of trials.
        executor: Executor of the trials. Each worker uses one thread for linear algebra, so that sums have the same
            order everywhere.
        ahead: Number of batches of trials to submit ahead, as for `in_order`.
        threads: Number of threads in which each worker simulates.
        file: File of the finished trials.
        done: Outcomes of the first trials, from an interrupted run.
        what: Name of the trials in the progress bar.

    Raises:
        InputError: A trial failed.
        OSError: The trials could not be saved.
        Exception: Errors of the executor when its workers die. The finished trials are in `file`.
    """
    left = range(len(done), trials)
    size = min(BATCH, 1 + len(left) // 16)
    batches = (left[k : k + size] for k in range(0, len(left), size))
    work = partial(_outcomes, draw, analyse, threads)
    with closing(in_order(executor, work, batches, ahead=ahead)) as results:
        outcomes = Checkpoint(what, file, draw.identity).collect(results, trials, done)
    return np.array(outcomes[:trials])


def done_in(folder: Path, draw: Draw, trials: int) -> tuple[list[Outcome], list[Outcome]]:
    """Outcomes of an interrupted run, and those of the trajectory estimate; empty if it was interrupted before these.

    Raises:
        InputError: There are none, or they belong to another run.
    """
    if not trials:
        raise InputError("--resume needs --trials, the number of trials to reach.")
    kept = kept_in(folder, draw)
    done = Checkpoint("trials", folder / FILE, draw.identity).done()
    return done, kept.done() if kept.file.exists() else []


def kept_in(folder: Path, draw: Draw) -> Checkpoint:
    """Checkpoint of the trajectory estimate's trials."""
    return Checkpoint("trajectory trials", folder / TRAJECTORY_FILE, draw.identity)


def _outcomes(
    draw: Draw, analyse: Callable[[Recording], Outcome], threads: int, trials: Sequence[int]
) -> list[Outcome]:
    """Outcomes of a batch of trials; run by workers."""
    return [analyse(recording) for recording in draw.recordings(trials, threads)]
