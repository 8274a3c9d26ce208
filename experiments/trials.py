"""Many trials of one study, in as many processes as wanted, interrupted and resumed without loss."""

import argparse
import json
import os
import signal
import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from multiprocessing import get_context, resource_tracker
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any, cast
from zipfile import BadZipFile

import numpy as np
from tqdm import tqdm

import scenes
from experiments.fitting import Fit
from sim.atomic import replacing
from sim.excitation import DOUBLE_PENDULUM
from sim.recording import Recording
from sim.simulate import simulate, with_noise

REDRAWN = {
    "all": "the excitation's and the sensors' noise, every trial being a simulation",
    "sensors": "the sensors' noise around one simulation",
    "wrench": "force and torque noise alone, with exact joint states and poses",
}
"""Which noise is drawn anew for each trial."""

FILE = "trials.npz"
"""File in the output folder that keeps every trial's outcome."""

SAVE_EVERY = 5.0
"""Seconds between two saves of the trials done."""

Outcome = np.ndarray
"""Errors and predicted standard deviations of every model's base parameters (models, 2, parameters)."""


def outcome(*fits: Fit) -> Outcome:
    """What a trial keeps of its fits."""
    return np.array([[fit.error, fit.estimate.std] for fit in fits])


@dataclass(frozen=True, eq=False)
class Draw:
    """A source of recordings that differ by their noise.

    Attributes:
        scene: Arguments of `scenes.load`.
        samples: Samples of a recording.
        noise_scale: Factor on all noise.
        redrawn: One of `REDRAWN`.
        seed: Seed of the whole run; trial k has a seed of its own, made of this one and k.
        recording: The one simulation of `sensors` and `wrench`.
    """

    scene: Mapping[str, Any]
    samples: int
    noise_scale: float
    redrawn: str
    seed: int
    recording: Recording

    @classmethod
    def of(cls, args: argparse.Namespace, scene: Mapping[str, Any], recording: Recording) -> "Draw":
        """From a study's command line, its scene and its recording."""
        if args.redraw == "wrench":
            # Only wrench channels keep their noise; their names end as `Recording.wrench` expects.
            noise = {k: v if k.endswith(("_force", "_torque")) else 0.0 for k, v in recording.noise.items()}
            recording = replace(recording, noise=noise)
        return cls(scene, args.samples, args.noise_scale, args.redraw, args.seed, recording)

    @property
    def identity(self) -> dict[str, Any]:
        """What trials must have in common to belong to one run."""
        return {
            "scene": dict(self.scene),
            "scene_sha256": self.recording.provenance["scene_sha256"],
            "excitation": self.recording.provenance["excitation"],
            **{key: getattr(self, key) for key in ("samples", "noise_scale", "redrawn", "seed")},
        }

    def __call__(self, k: int) -> Recording:
        """The recording of trial k, whichever process asks."""
        seed = np.random.SeedSequence((self.seed, k))
        if self.redrawn == "all":
            number = int(seed.generate_state(1)[0])
            spec = scenes.load(**self.scene)
            return simulate(spec, DOUBLE_PENDULUM, samples=self.samples, seed=number, noise_scale=self.noise_scale)
        return with_noise(self.recording, np.random.default_rng(seed))


def run_trials(
    draw: Draw,
    analyse: Callable[[Recording], Outcome],
    trials: int,
    *,
    workers: int,
    file: Path,
    done: Sequence[Outcome] = (),
) -> np.ndarray:
    """Outcomes of all trials (trials, models, 2, parameters), the same at any number of workers.

    Args:
        draw: Source of the recordings.
        analyse: What becomes of a recording; sent to the workers, so a module's function or a partial of one.
        trials: Number of trials.
        workers: Number of processes. Each uses one thread, so that sums are taken in the same order everywhere.
        file: Where the trials done are kept, every few seconds and when interrupted.
        done: Outcomes of the first trials, from an interrupted run.

    Raises:
        ValueError: A worker died.
        KeyboardInterrupt: Interrupted; the trials done are in `file`.
    """
    outcomes = list(done)
    saved = time.monotonic()
    indices = range(len(outcomes), trials)
    try:
        with (
            tqdm(desc="Trials", total=trials, initial=len(outcomes), file=sys.stderr) as bar,
            _crew(draw, analyse, min(workers, max(len(indices), 1))) as crew,
        ):
            for outcome in _in_order(crew, indices):
                outcomes.append(outcome)
                bar.update()
                if time.monotonic() - saved > SAVE_EVERY:
                    _save(file, draw.identity, outcomes)
                    saved = time.monotonic()
    except EOFError:
        raise ValueError(
            f"A worker process died, perhaps for want of memory; {len(outcomes)} trials are done and kept in {file}, "
            "go on with --resume and fewer --workers."
        ) from None
    finally:
        if len(outcomes) > len(done):
            _save(file, draw.identity, outcomes)
    return np.array(outcomes[:trials])


@contextmanager
def _crew(draw: Draw, analyse: Callable[[Recording], Outcome], size: int) -> Iterator[list[Connection]]:
    """Worker processes for the duration of a block, each at the other end of a connection."""
    context = get_context("spawn")
    crew = []
    try:
        with _one_thread_each(), _not_interrupted():
            for _ in range(size):
                here, there = context.Pipe()
                process = context.Process(target=_serve, args=(there, draw, analyse), daemon=True)
                process.start()
                there.close()
                crew.append((process, here))
        yield [here for _, here in crew]
    finally:
        for process, here in crew:
            process.kill()
            here.close()


def _serve(there: Connection, draw: Draw, analyse: Callable[[Recording], Outcome]) -> None:
    """Works on the trials that come in, until the connection ends with the parent."""
    with suppress(EOFError, OSError):
        while True:
            k = there.recv()
            try:
                found = analyse(draw(k))
            except ValueError as error:
                there.send((k, error))
            else:
                there.send((k, found))


def _in_order(crew: Sequence[Connection], indices: range) -> Iterator[Outcome]:
    """Outcomes of trials in the order of their indices, whoever finishes first.

    Raises:
        EOFError: A worker died.
        ValueError: A trial failed.
    """
    waiting, found, due = iter(indices), dict[int, Outcome](), indices.start
    busy = set()
    for worker, k in zip(crew, waiting, strict=False):
        worker.send(k)
        busy.add(worker)
    while busy:
        for worker in cast(list[Connection], wait(list(busy))):
            k, outcome = worker.recv()
            if isinstance(outcome, Exception):
                raise outcome
            found[k] = outcome
            following = next(waiting, None)
            if following is None:
                busy.remove(worker)
            else:
                worker.send(following)
        while due in found:
            yield found.pop(due)
            due += 1


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Lets the processes that start in a block use one thread for linear algebra."""
    names = ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS")
    before = {name: os.environ.get(name) for name in names}
    os.environ.update(dict.fromkeys(names, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                del os.environ[name]
            else:
                os.environ[name] = value


@contextmanager
def _not_interrupted() -> Iterator[None]:
    """Holds Ctrl-C back while processes start, and lets them be deaf to it: it is the parent's business."""
    if not hasattr(signal, "pthread_sigmask"):
        yield
        return
    # Started later, the tracker of shared resources would let signals through again.
    resource_tracker.ensure_running()
    before = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGINT})
    try:
        yield
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, before)


def _save(file: Path, identity: dict[str, Any], done: list[Outcome]) -> None:
    with replacing(file) as temporary:
        np.savez(temporary, identity=json.dumps(identity), outcomes=np.array(done))


def trials_done(draw: Draw, args: argparse.Namespace) -> list[Outcome]:
    """Outcomes that an interrupted run left, if the command line asks to resume it.

    Raises:
        ValueError: There are none, or they belong to another run.
    """
    if not args.resume:
        return []
    if not args.trials:
        raise ValueError("--resume needs --trials, the number of trials to reach.")
    file = args.out / FILE
    try:
        with file.open("rb") as stream, np.load(stream, allow_pickle=False) as data:
            kept, outcomes = json.loads(str(data["identity"])), list(data["outcomes"])
        different = [key for key in draw.identity if kept.get(key) != json.loads(json.dumps(draw.identity[key]))]
    except (OSError, ValueError, KeyError, TypeError, EOFError, AttributeError, BadZipFile) as error:
        raise ValueError(f"--resume needs the trials of an earlier run in {file} ({error}).") from None
    if different:
        raise ValueError(f"The trials in {file} are of another run: {', '.join(different)} differ; leave out --resume.")
    return outcomes
