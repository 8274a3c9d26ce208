"""Whole jobs beside a part of them, or beside the same by one dense matrix, in turns in one process.

The ratios show what a change of the code gains, where no other library does the same job.
"""

from collections.abc import Iterator
from concurrent.futures import Executor, Future
from contextlib import redirect_stderr
from dataclasses import dataclass
from functools import partial
from io import StringIO
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import scenes
from experiments.benchmark import linearisation
from experiments.benchmark.mechanisms import Subject, chain, double_pendulum
from experiments.benchmark.timing import Effort, alternating, ratio
from experiments.data.defaults import SCENE
from experiments.runs.workers import WorkerPool
from experiments.studies import stream
from experiments.studies.stream_progress import FILE, Progress
from ident.estimation.accumulator import accumulate
from ident.estimation.samples import Samples
from ident.mechanism.mechanism import Mechanism
from ident.parameters.base_parameters import STANDARD_GRAVITY, find_base_parameters
from ident.parameters.structure import structure_matrix
from ident.recordings.recording import STATES, Recording

STREAM, REGROUPING = "stream of a recording in a file", "base parameters of an arm"
LINEARISATION = "one linearisation of a tree of 29 joints with torques"
"""Names of the jobs."""

RATE = 1000.0
"""Rate of the recording, Hz."""


@dataclass(frozen=True)
class Job:
    """Times of a job and of what it is compared with.

    Attributes:
        job: Its name.
        size: Its number of samples, or of bodies.
        beside: What it is compared with.
        ours: Median time of the job, s.
        theirs: Median time of the other, s.
        ratio: Ratio of the medians, the job's to the other's.
        lowest: Smallest ratio of neighbouring repetitions.
        highest: Largest ratio of neighbouring repetitions.
    """

    job: str
    size: int
    beside: str
    ours: float
    theirs: float
    ratio: float
    lowest: float
    highest: float

    @classmethod
    def of(cls, job: str, size: int, beside: str, times: np.ndarray) -> "Job":
        """Job from alternating times of it and of the other, s (repetitions, 2)."""
        ours, theirs = np.median(times, axis=0).tolist()
        return cls(job, size, beside, ours, theirs, *ratio(times[:, ::-1]))


class _Here(Executor):
    """Executor that does everything at once in this process."""

    def submit(self, function: Any, /, *args: Any, **kwargs: Any) -> Future[Any]:
        future: Future[Any] = Future()
        future.set_result(function(*args, **kwargs))
        return future


def jobs(effort: Effort) -> Iterator[Job]:
    """All jobs."""
    yield _streamed(effort)
    yield _regrouped(effort)
    yield _linearised(effort)


def _streamed(effort: Effort) -> Job:
    """Both passes over a recording in a file, beside the sums of its samples in memory."""
    subject = double_pendulum()
    samples = subject.samples(effort.streamed)
    with TemporaryDirectory() as name:
        model, file = Path(name, "model.xml"), Path(name, "recording.npz")
        spec = scenes.load(SCENE)
        spec.compile()
        model.write_text(spec.to_xml(), encoding="utf-8")
        _recording(subject, samples).save(file)
        reading = stream.reading(model, [file], base="base", limit=10 * file.stat().st_size)
        progress, pool = Progress(Path(name, FILE), {}), WorkerPool(_Here(), 1, 1)

        def whole() -> None:
            with redirect_stderr(StringIO()):
                stream.streamed(progress, reading, pool)

        sums = partial(accumulate, reading.equations, samples)
        times = alternating([whole, sums], effort.seconds, effort.least)
    return Job.of(STREAM, effort.streamed, "its sums alone", times)


def _recording(subject: Subject, samples: Samples) -> Recording:
    """Recording of the samples."""
    channels = {
        f"{joint}_{kind}": x[:, k]
        for kind, x in zip(STATES, samples.motion.states, strict=True)
        for k, joint in enumerate(subject.tree.joints)
    }
    wrench = {"ground_force": samples.measured[:, :3], "ground_torque": samples.measured[:, 3:]}
    return Recording(np.arange(len(samples)) / RATE, channels | wrench)


def _regrouped(effort: Effort) -> Job:
    """Base parameters of a long arm, beside those of the matrix of its structure."""
    arm = Mechanism(chain(effort.bodies[-1]), STANDARD_GRAVITY)

    def along() -> None:
        find_base_parameters(arm)

    def dense() -> None:
        find_base_parameters(structure_matrix(arm))

    times = alternating([along, dense], effort.seconds, effort.least)
    return Job.of(REGROUPING, effort.bodies[-1], "those of its whole matrix", times)


def _linearised(effort: Effort) -> Job:
    """One linearisation of the trajectory estimate, beside the same without the structure of the tree."""
    times = alternating(linearisation.ways(effort.linearised), effort.seconds, effort.least)
    return Job.of(LINEARISATION, effort.linearised, "all channels with all coordinates and parameters", times)
