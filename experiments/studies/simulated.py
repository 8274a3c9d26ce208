"""Simulation of a study's recording, and identification of its models by least squares."""

from collections.abc import Sequence

from experiments.data.simulated import Problem, Study
from experiments.data.study_file import StudyFile
from experiments.studies import trials
from experiments.studies.study_entries import packaged
from ident.recordings.recording import Recording
from sim.simulation.simulate import simulate


def simulated(file: StudyFile) -> Study:
    """Simulates the scene of a study and identifies all its models by least squares.

    Raises:
        InputError: An entry of the file is invalid.
        ExcitationError: The motion does not separate the base parameters.
    """
    recording = simulate(
        file.spec(), file.excitation, samples=file.samples, seed=file.seed, noise_scale=file.noise_scale
    )
    study = Study(Problem.of(file), recording)
    for name, model in file.models.items():
        for estimator in model.estimators:
            if estimator != "trajectory":
                study.fit(name, estimator)
    return study


def study(name: str, **options: object) -> Study:
    """One of the package's studies, with other values for some of its options."""
    return simulated(packaged(name, **options))


def trial(problem: Problem, models: Sequence[str], recording: Recording) -> trials.Outcome:
    """Errors of some models from one recording, axes always recovered as one direction."""
    study = Study(problem, recording, significance=0)
    return trials.outcome(*map(study.fit, models))


def trajectory_trial(problem: Problem, model: str, recording: Recording) -> trials.Outcome:
    """Errors of a model's trajectory estimate from one recording, axes always recovered as one direction."""
    return trials.outcome(Study(problem, recording, significance=0).determined_trajectory(model))
