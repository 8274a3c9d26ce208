"""Simulation of a study's recording, its models by least squares, and trials with noise drawn anew."""

import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.data.fitting import TRAJECTORY, Distribution
from experiments.data.simulated_study import SimulatedStudy, StudyProblem, summary
from experiments.data.study_file import SEARCHED, StudyFile
from experiments.runs.workers import Checkpoint, Workers
from experiments.studies.study_entries import packaged
from ident.errors import InputError
from ident.recordings.recording import Recording
from sim.simulation.simulate import simulate, simulate_many, with_noise

FILE, TRAJECTORY_FILE, SWEEP_FILE = "trials.npz", "trials_trajectory.npz", "runs.npz"
"""Files in the output folder with all trials, by least squares and by trajectory estimates, and a sweep's runs."""

Outcome = np.ndarray
"""Errors and predicted standard deviations of each model's base parameters (models, 2, parameters)."""


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

    def kept(self, what: str, file: Path, **more: Any) -> Checkpoint:
        """Checkpoint of outcomes that have these settings, and more."""
        return Checkpoint(what, file, {**self.identity, **more})

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
    # Eight trials are half a second's work if all noise is drawn anew.
    return np.array(workers.collected(work, range(trials), kept, batch=8))


def _outcomes(
    draw: Draw, analyse: Callable[[Recording], Outcome], threads: int, trials: Sequence[int]
) -> list[list[Any]]:
    """Outcomes of a batch of trials; run by workers."""
    return [analyse(recording).tolist() for recording in draw.recordings(trials, threads)]


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


def draw_of(study: SimulatedStudy, asked: Trials, folder: Path) -> Draw:
    """Source of the recordings of a study's trials.

    Raises:
        InputError: The study's file has no trials, or there is nothing to resume.
    """
    if asked.trials and not study.file.trials:
        raise InputError("--trials needs [trials] in the study file, with models by what the tables are to call them.")
    draw = Draw.of(study.file, asked.redraw, study.recording)
    if asked.workers.resume:
        if not asked.trials and not study.file.sweep:
            raise InputError("--resume needs --trials, the number of trials to reach.")
        if asked.trials:
            draw.kept("trials", folder / FILE).done()
    return draw


def distributions(study: SimulatedStudy, draw: Draw, asked: Trials, folder: Path) -> dict[str, Distribution]:
    """Runs the trials, and repeats the first of them for the trajectory estimate."""
    file, kept_trajectory = study.file, draw.kept("trajectory trials", folder / TRAJECTORY_FILE)
    if not asked.workers.resume:
        kept_trajectory.set_aside()
    analyse = partial(trial, study.problem, tuple(file.trials.values()))
    outcomes = run_trials(draw, analyse, asked.trials, draw.kept("trials", folder / FILE), asked.workers)
    made = {name: _distribution(study, model, outcomes[:, k]) for k, (name, model) in enumerate(file.trials.items())}
    number, name = min(asked.trials, asked.trajectory_trials), file.trajectory_trials
    if name and number:
        # The run may have been interrupted before any of these.
        workers = replace(asked.workers, resume=asked.workers.resume and kept_trajectory.file.exists())
        analyse = partial(trajectory_trial, study.problem, file.trials[name])
        outcomes = run_trials(draw, analyse, number, kept_trajectory, workers)
        made[name + TRAJECTORY] = _distribution(study, file.trials[name], outcomes[:, 0])
    return made


def _distribution(study: SimulatedStudy, model: str, outcomes: np.ndarray) -> Distribution:
    """A model's errors and predicted standard deviations (trials, 2, parameters), beside the published errors."""
    names, published = study.fit(model).base.names, study.file.published.get("error", {}).get(model, {})
    beside = np.array([published.get(name, np.nan) for name in names])
    return Distribution(names, outcomes[:, 0], outcomes[:, 1], beside)


@dataclass(frozen=True, eq=False)
class Swept:
    """Results of a study for each value and seed of a sweep.

    Attributes:
        option: Name of the option.
        values: Its values.
        runs: Value, seed and summary of each run, or its error under `refused`; all values with the first seed, then
            with the next.
    """

    option: str
    values: Sequence[str | float]
    runs: Sequence[Mapping[str, Any]]

    @property
    def names(self) -> list[str]:
        """Names of the numbers in the summaries, without the paper's."""
        return _names(self.runs, self.option)

    def numbers(self, name: str) -> np.ndarray:
        """A number for each seed and value (seeds, values); NaN if a summary lacks it."""
        return np.array([run.get(name, np.nan) for run in self.runs], dtype=float).reshape(-1, len(self.values))


def _names(runs: Iterable[Mapping[str, Any]], option: str) -> list[str]:
    """Names of the numbers in some summaries, without the paper's, the option and the seed."""
    names = dict.fromkeys(name for run in runs for name, x in run.items() if isinstance(x, int | float))
    return [name for name in names if not name.startswith("paper_") and name not in (option, "seed")]


def check_numbers(study: SimulatedStudy) -> None:
    """Refuses names of numbers to chart over a sweep that no summary has, before there are any runs.

    Raises:
        InputError: There is one.
    """
    sweep = study.file.sweep
    # Other contacts have other numbers.
    if sweep is not None and sweep.option != "contact":
        check_named(sweep.numbers, _names([summary(study)], sweep.option))


def check_named(numbers: Iterable[str], names: Sequence[str]) -> None:
    """Raises an InputError for a number of a chart that is not among these."""
    for name in numbers:
        if name not in names:
            raise InputError(f"sweep.numbers needs names of {', '.join(names)}, got '{name}'.")


def swept(draw: Draw, asked: Trials, folder: Path) -> Swept:
    """Runs a study with each value and seed of its sweep, or the remainder of an interrupted run.

    Raises:
        InputError: All runs raise errors, or a worker died.
    """
    file, sweep = draw.file, draw.file.sweep
    assert sweep is not None
    runs = [(value, seed) for seed in range(sweep.seeds) for value in sweep.values]
    kept = draw.kept("runs", folder / SWEEP_FILE, option=sweep.option, values=sweep.values)
    # A run with trials may have been interrupted before the sweep.
    resume = asked.workers.resume and (kept.file.exists() or not asked.trials)
    outcomes = replace(asked.workers, resume=resume).collected(partial(_run, file, sweep.option), runs, kept)
    results = [{sweep.option: value, "seed": seed, **x} for (value, seed), x in zip(runs, outcomes, strict=True)]
    refused = [run["refused"] for run in results if "refused" in run]
    made = Swept(sweep.option, sweep.values, results)
    if len(refused) == len(results):
        raise InputError(f"The sweep refuses every run: {refused[0]}")
    for sentence in refused:
        print(f"Refused: {sentence}", file=sys.stderr)
    check_named(sweep.numbers, made.names)
    return made


def _run(file: StudyFile, option: str, run: tuple[str | float, int]) -> dict[str, Any]:
    """Summary of a study with a value and a seed; run by workers."""
    value, seed = run
    try:
        return summary(simulated(file.with_options(**{option: value}, seed=seed)))
    except InputError as error:
        return {"refused": f"{option} {value}, seed {seed}: {error}"}


def simulated(file: StudyFile) -> SimulatedStudy:
    """Simulates the scene of a study and identifies all its models by least squares.

    Raises:
        InputError: An entry of the file is invalid.
        ExcitationError: The motion does not separate the base parameters.
    """
    recording = simulate(
        file.spec(), file.excitation, samples=file.samples, seed=file.seed, noise_scale=file.noise_scale
    )
    study = SimulatedStudy(StudyProblem.of(file), recording)
    for name, model in file.models.items():
        for estimator in model.estimators:
            if estimator != "trajectory" and model.axes != SEARCHED:
                study.fit(name, estimator)
    return study


def study(name: str, **options: object) -> SimulatedStudy:
    """One of the package's studies, with other values for some of its options."""
    return simulated(packaged(name, **options))


def trial(problem: StudyProblem, models: Sequence[str], recording: Recording) -> Outcome:
    """Errors of some models from one recording, axes always recovered as one direction."""
    study = SimulatedStudy(problem, recording, significance=0)
    return np.array([[fit.error, fit.std] for fit in map(study.fit, models)])


def trajectory_trial(problem: StudyProblem, model: str, recording: Recording) -> Outcome:
    """Errors of a model's trajectory estimate from one recording, axes always recovered as one direction."""
    fit = SimulatedStudy(problem, recording, significance=0).determined_trajectory(model)
    return np.array([[fit.error, fit.std]])
