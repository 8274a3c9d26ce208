"""Trials of a study: the errors of its models when noise is drawn anew."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np

from experiments.data.errors import TRAJECTORY, Distribution
from experiments.data.simulated import Study
from experiments.runs.workers import Workers
from experiments.studies.simulated import trajectory_trial, trial
from experiments.studies.trials import FILE, TRAJECTORY_FILE, Draw, Outcome, done_in, kept_in, run_trials
from ident.errors import InputError


@dataclass(frozen=True)
class Trials:
    """Number of trials, noise that they redraw, and workers.

    Attributes:
        trials: Number of trials; 0 for none.
        trajectory_trials: Largest number of them that the trajectory estimate is made of too.
        redraw: One of `defaults.REDRAWN`.
        workers: Workers that share them.
    """

    trials: int
    trajectory_trials: int
    redraw: str
    workers: Workers


@dataclass(frozen=True, eq=False)
class Run:
    """Trials of a study, of which some may be done.

    Attributes:
        study: The study.
        draw: Source of the recordings.
        asked: How many trials to run, and how.
        folder: Folder of the files of the outcomes.
        done: Outcomes of an interrupted run.
        trajectory_done: The same of the trajectory estimate.
    """

    study: Study
    draw: Draw
    asked: Trials
    folder: Path
    done: Sequence[Outcome]
    trajectory_done: Sequence[Outcome]

    @classmethod
    def of(cls, study: Study, asked: Trials, folder: Path) -> "Run":
        """The trials of a study.

        Raises:
            InputError: The study's file has no trials, or there is nothing to resume.
        """
        if asked.trials and not study.file.trials:
            raise InputError(
                "--trials needs [trials] in the study file, with models by what the tables are to call them."
            )
        draw = Draw.of(study.file, asked.redraw, study.recording)
        done, trajectory_done = done_in(folder, draw, asked.trials) if asked.workers.resume else ([], [])
        return cls(study, draw, asked, folder, done, trajectory_done)

    def distributions(self) -> dict[str, Distribution]:
        """Runs the trials, and repeats the first of them for the trajectory estimate."""
        study, asked, file = self.study, self.asked, self.study.file
        trajectory_model = file.trajectory_trials
        trajectory_trials = min(asked.trials, asked.trajectory_trials) if trajectory_model else 0
        if not asked.workers.resume:
            kept_in(self.folder, self.draw).set_aside()
        left = max(asked.trials - len(self.done), trajectory_trials - len(self.trajectory_done))
        analyse = partial(trial, study.problem, tuple(file.trials.values()))
        with asked.workers.pool(left) as pool:
            run = partial(run_trials, self.draw, executor=pool.executor, ahead=pool.ahead, threads=pool.threads)
            outcomes = run(analyse, asked.trials, file=self.folder / FILE, done=self.done)
            distributions = {
                name: _distribution(study, model, outcomes[:, k]) for k, (name, model) in enumerate(file.trials.items())
            }
            if trajectory_model and trajectory_trials:
                kept, model = self.folder / TRAJECTORY_FILE, file.trials[trajectory_model]
                analyse, done = partial(trajectory_trial, study.problem, model), self.trajectory_done
                outcomes = run(analyse, trajectory_trials, file=kept, done=done, what="trajectory trials")
                distributions[trajectory_model + TRAJECTORY] = _distribution(study, model, outcomes[:, 0])
        return distributions


def _distribution(study: Study, model: str, outcomes: np.ndarray) -> Distribution:
    """A model's errors and predicted standard deviations (trials, 2, parameters), beside the published errors."""
    names, published = study.fit(model).base.names, study.file.published.get("error", {}).get(model, {})
    beside = np.array([published.get(name, np.nan) for name in names])
    return Distribution(names, outcomes[:, 0], outcomes[:, 1], beside)
