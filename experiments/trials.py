"""Many trials of one study, in as many processes as wanted, interrupted and resumed without loss."""

import argparse
import json
import os
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from dataclasses import dataclass, replace
from multiprocessing import get_context, parent_process
from multiprocessing.connection import wait
from pathlib import Path
from typing import Any
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

BATCH = 16
"""Trials that each worker is handed at a time."""

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
    try:
        with (
            _one_thread_each(),
            tqdm(desc="Trials", total=trials, initial=len(outcomes), file=sys.stderr) as bar,
            ProcessPoolExecutor(workers, get_context("spawn"), _start_worker, (draw, analyse)) as pool,
        ):
            while len(outcomes) < trials:
                batch = range(len(outcomes), min(trials, len(outcomes) + BATCH * workers))
                with _not_interrupted():
                    results = pool.map(_trial, batch)
                for outcome in results:
                    outcomes.append(outcome)
                    bar.update()
                if time.monotonic() - saved > SAVE_EVERY:
                    _save(file, draw.identity, outcomes)
                    saved = time.monotonic()
    except BrokenProcessPool:
        raise ValueError(
            f"A worker process died, perhaps for want of memory; {len(outcomes)} trials are in {file}, "
            "go on with --resume and fewer --workers."
        ) from None
    finally:
        if len(outcomes) > len(done):
            _save(file, draw.identity, outcomes)
    return np.array(outcomes[:trials])


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
    """Starts processes deaf to Ctrl-C, which is the parent's business."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)


_WORK: tuple[Draw, Callable[[Recording], Outcome]]


def _start_worker(draw: Draw, analyse: Callable[[Recording], Outcome]) -> None:
    """Hands a worker its task, and lets it end with its parent, however that ends."""
    global _WORK
    _WORK = draw, analyse
    parent = parent_process()
    if parent is not None:
        threading.Thread(target=lambda: (wait([parent.sentinel]), os._exit(1)), daemon=True).start()


def _trial(k: int) -> Outcome:
    draw, analyse = _WORK
    return analyse(draw(k))


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
