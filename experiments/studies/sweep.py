"""Runs of a study with several values of one of its options, and several seeds."""

import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.data.key_numbers import summary
from experiments.data.outcomes import Sweep
from experiments.runs.checkpoint import Checkpoint
from experiments.runs.workers import Workers
from experiments.studies.simulated import simulated
from experiments.studies.study_entries import packaged
from ident.errors import InputError

FILE = "runs.npz"
"""File in the output folder with the summaries of all runs."""


def run_of(study: str, option: str, run: tuple[str | float, int]) -> dict[str, Any]:
    """Summary of a study with a value and a seed; run by workers."""
    value, seed = run
    try:
        return summary(simulated(packaged(study, **{option: value}, seed=seed)))
    except InputError as error:
        return {"refused": f"{option} {value}, seed {seed}: {error}"}


def values_of(study: str, option: str, texts: Sequence[str]) -> list[str | float]:
    """Values of a study's option, of its default's type.

    Raises:
        InputError: The study has no such option, or the values are missing, equal or not of that type.
    """
    defaults = {name: value for name, value in packaged(study).options.items() if name != "seed"}
    if option not in defaults:
        raise InputError(f"--over needs an option of {study}, one of {', '.join(defaults)}, got '{option}'.")
    kind = type(defaults[option])
    try:
        values = [kind(text) for text in texts]
    except ValueError as error:
        raise InputError(f"--over {option} needs values of type {kind.__name__} ({error}).") from None
    if not values or len(set(values)) < len(values) or not all(isinstance(x, str) or abs(x) < np.inf for x in values):
        raise InputError(f"--over {option} needs one or more finite values, all different, got '{' '.join(texts)}'.")
    return values


def swept(
    study: str, option: str, values: Sequence[str | float], seeds: int, *, folder: Path, workers: Workers
) -> Sweep:
    """Runs a study with each value and seed, or the remainder of an interrupted run.

    Args:
        study: Name of the study.
        option: Name of its option.
        values: Values of the option.
        seeds: Number of runs of each value.
        folder: Folder of the file of all runs.
        workers: Workers that share the runs.

    Raises:
        InputError: All runs raise errors, or a worker died.
    """
    runs = [(value, seed) for seed in range(seeds) for value in values]
    kept = Checkpoint("runs", folder / FILE, {"study": study, "option": option, "values": values})
    outcomes = workers.collected(partial(run_of, study, option), runs, kept)
    results = [{option: value, "seed": seed, **x} for (value, seed), x in zip(runs, outcomes, strict=True)]
    refused = [run["refused"] for run in results if "refused" in run]
    if len(refused) == len(results):
        raise InputError(f"{study} refuses every run: {refused[0]}")
    for sentence in refused:
        print(f"Refused: {sentence}", file=sys.stderr)
    return Sweep(option, values, results)
