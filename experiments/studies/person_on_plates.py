"""Identification of a simulated person on two force plates who holds a rail, from a wrong prior, with known truth."""

from collections.abc import Mapping, Sequence
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.data.simulated_person import Laboratory, PersonStudy
from experiments.runs.workers import Checkpoint, Workers, worker_pool
from experiments.studies.person_recordings import SENSORS, drawn, humanoid, mistaken, moved, recorded
from ident.errors import InputError
from ident.estimate import Estimate
from ident.estimation.accumulator import accumulate
from ident.estimation.preparation import prepared
from ident.estimation.samples import joined
from ident.identification import identified
from ident.model.regressor import base_wrench_regressor
from ident.parameters.base_parameters import BaseParameters
from ident.trajectory.fit.iteration import Report
from sim.motion.person import ACTIVITIES

USUAL = 6.0
"""Cut-off, Hz, that gait laboratories use for markers."""

HELD_OUT = 1000
"""Offset of the seeds of recordings that are not fitted."""

FILE = "persons.npz"
"""File in the output folder with the persons of whom intervals are counted."""

CORRELATED = 0.9
"""Autocorrelation of correlated noise of angles at a lag of one sample."""

LEAST_SINGULAR = 1e-3
"""Singular values over the largest, below which least squares keeps the prior."""


def least_squares_from_prior(estimate: Estimate) -> np.ndarray:
    """Base parameters next to the prior with the best fit at filtered states, treated as exact (r,)."""
    logs = [prepared(part.log.mechanism, part.log.recording, cutoff=USUAL) for part in estimate.logs]
    equations = logs[0].equations
    samples = joined([log.samples[slice(log.edge, len(log.samples) - log.edge)] for log in logs])
    R = accumulate(equations, samples).root
    prior = equations.parameters.regroup(equations.mechanism.known)
    step, *_ = np.linalg.lstsq(R[:, :-1], R[:, -1] - R[:, :-1] @ prior, rcond=LEAST_SINGULAR)
    return np.asarray(prior + step)


def held_out_regressor(base: BaseParameters, activities: Sequence[str], seconds: float, seed: int) -> np.ndarray:
    """Base-wrench regressor of motions that are not recorded (N, 6, r)."""
    true, columns = humanoid(), []
    for number, activity in enumerate(activities):
        motion = moved(activity, Laboratory().times(seconds), HELD_OUT + seed + number)
        Y = base_wrench_regressor(true.tree, *motion.states, gravity=true.gravity, base=motion.base)
        columns.append(Y[..., list(base.kept)])
    return np.concatenate(columns)


def study(
    seconds: float,
    *,
    seed: int = 0,
    laboratory: Laboratory = Laboratory(),  # noqa: B008
    activities: Sequence[str] | None = None,
    executor: Executor | None = None,
    report: Report | None = None,
) -> PersonStudy:
    """Simulates recordings of all activities, and others that are held out, and identifies the person.

    Args:
        seconds: Length of each recording.
        seed: Seed of the motions, the noise and the wrong prior.
        laboratory: The laboratory, with its noise and set-up errors.
        activities: Recorded activities, by default all of `ACTIVITIES`.
        executor: Executor for the pieces of the trajectory estimate.
        report: Called in each round of it.

    Raises:
        InputError: Recordings are too short.
    """
    if seconds < 2:
        raise InputError(f"A recording of a person needs two seconds or more, got {seconds:g}.")
    activities = ACTIVITIES if activities is None else activities
    who, first = mistaken(humanoid(), np.random.default_rng((seed, 2))), seed * len(ACTIVITIES)
    faults = drawn(humanoid(), SENSORS, laboratory.setup, np.random.default_rng((seed, 3)))
    recordings, unseen = (
        tuple(recorded(activity, seconds, start + k, laboratory, faults) for k, activity in enumerate(activities))
        for start in (first, HELD_OUT + first)
    )
    fitted, judges = (
        [prepared(who, each, name=activity) for each, activity in zip(several, activities, strict=True)]
        for several in (recordings, unseen)
    )
    estimate = identified(fitted, judges=judges, known=True, executor=executor, report=report)
    held_out = held_out_regressor(estimate.base, activities, seconds, first)
    filtered = least_squares_from_prior(estimate)
    return PersonStudy(estimate, humanoid(), tuple(activities), recordings, seconds, filtered, held_out, laboratory)


def laboratory(source: str, rate: float, noise: float | None = None) -> Laboratory:
    """A laboratory whose angles have noise that is white or `correlated`, or come from `markers`.

    Raises:
        InputError: The noise of angles, in degrees, is out of range, or stated for angles from markers.
    """
    if source == "markers":
        if noise is not None:
            raise InputError(
                f"Noise of angles (--noise) belongs to --from angles or correlated, those from markers have that of "
                f"the markers; got {noise:g}."
            )
        return Laboratory(rate=rate, markers=True)
    noise = Laboratory.angle_deg if noise is None else noise
    if not 0 < noise < 30:
        raise InputError(f"Noise of angles (--noise) is from above 0 to below 30 degrees, got {noise:g}.")
    return Laboratory(noise, CORRELATED if source == "correlated" else 0.0, rate=rate)


def with_and_without_rail(
    seconds: float, *, laboratory: Laboratory, workers: int = 1, **more: Any
) -> tuple[PersonStudy, PersonStudy]:
    """Studies of a person who holds a rail and of one who does not.

    Args:
        seconds: Length of each recording.
        laboratory: The laboratory.
        workers: Local processes for the pieces of the trajectory estimate.
        more: Further arguments of `study`.
    """
    with ExitStack() as stack:
        more["executor"] = stack.enter_context(worker_pool(workers)) if workers > 1 else None
        held, free = (study(seconds, laboratory=replace(laboratory, rail=rail), **more) for rail in (True, False))
        return held, free


def counts(
    number: int, seconds: float, folder: Path, workers: Workers, *, seed: int, laboratory: Laboratory, **more: Any
) -> list[dict[str, Any]]:
    """Precision and errors of several persons, with successive seeds from the given one, each as `counted` has them.

    Args:
        number: Number of persons.
        seconds: Length of each recording.
        folder: Folder of the file of the persons that are done.
        workers: Workers that share the persons.
        seed: Seed of the first person.
        laboratory: The laboratory.
        more: Further arguments of `study`, in JSON types.
    """
    identity = {"seconds": seconds, "seed": seed, "laboratory": asdict(laboratory), **more}
    work = partial(counted, seconds, {"laboratory": laboratory, **more})
    return workers.collected(work, range(seed, seed + number), Checkpoint("persons", folder / FILE, identity))


def counted(seconds: float, given: Mapping[str, Any], seed: int) -> dict[str, Any]:
    """Precision and errors of a person; run by workers."""
    person = study(seconds, seed=seed, **given)
    better = float((person.errors["prior"] / person.errors["trajectory estimate"]).min())
    out: dict[str, Any] = {"noise_of_angles": person.noise_of_angles, "times_better": better}
    out |= {"verdict": str(person.estimate.verdict())}
    for name, pair in (("with_setup", person.distances), ("of_noise", person.distances_by(person.estimate.covariance))):
        out[name] = {"std": pair[0].tolist(), "z": pair[1].tolist()}
    return out
