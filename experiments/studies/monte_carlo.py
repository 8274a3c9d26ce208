"""Trials of a study: the errors of its models when noise is drawn anew."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from experiments.data.errors import TRAJECTORY, Distribution
from experiments.data.simulated import Study
from experiments.runs.workers import Workers
from experiments.studies.simulated import trajectory_trial, trial
from experiments.studies.trials import Draw, kept_in, run_trials
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
    """Trials of a study.

    Attributes:
        study: The study.
        draw: Source of the recordings.
        asked: How many trials to run, and how.
        folder: Folder of the files of the outcomes.
    """

    study: Study
    draw: Draw
    asked: Trials
    folder: Path

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
        if asked.workers.resume:
            if not asked.trials:
                raise InputError("--resume needs --trials, the number of trials to reach.")
            kept_in(folder, draw)[0].done()
        return cls(study, draw, asked, folder)

    def distributions(self) -> dict[str, Distribution]:
        """Runs the trials, and repeats the first of them for the trajectory estimate."""
        study, asked, file = self.study, self.asked, self.study.file
        kept, kept_trajectory = kept_in(self.folder, self.draw)
        if not asked.workers.resume:
            kept_trajectory.set_aside()
        analyse = partial(trial, study.problem, tuple(file.trials.values()))
        outcomes = run_trials(self.draw, analyse, asked.trials, kept, asked.workers)
        distributions = {
            name: _distribution(study, model, outcomes[:, k]) for k, (name, model) in enumerate(file.trials.items())
        }
        number, name = min(asked.trials, asked.trajectory_trials), file.trajectory_trials
        if name and number:
            # The run may have been interrupted before any of these.
            workers = replace(asked.workers, resume=asked.workers.resume and kept_trajectory.file.exists())
            analyse = partial(trajectory_trial, study.problem, file.trials[name])
            outcomes = run_trials(self.draw, analyse, number, kept_trajectory, workers)
            distributions[name + TRAJECTORY] = _distribution(study, file.trials[name], outcomes[:, 0])
        return distributions


def _distribution(study: Study, model: str, outcomes: np.ndarray) -> Distribution:
    """A model's errors and predicted standard deviations (trials, 2, parameters), beside the published errors."""
    names, published = study.fit(model).base.names, study.file.published.get("error", {}).get(model, {})
    beside = np.array([published.get(name, np.nan) for name in names])
    return Distribution(names, outcomes[:, 0], outcomes[:, 1], beside)
