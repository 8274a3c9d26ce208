"""Many trials of one study: how its errors are distributed, and where the paper's single run lies among them."""

import argparse
import json
import os
import signal
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

import scenes
from experiments import figures, report
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
    draw: Draw, analyse: Callable[[Recording], Outcome], trials: int, *, workers: int, file: Path, resume: bool
) -> np.ndarray:
    """Outcomes of all trials (trials, models, 2, parameters), the same at any number of workers.

    Args:
        draw: Source of the recordings.
        analyse: What becomes of a recording; sent to the workers, so a module's function or a partial of one.
        trials: Number of trials.
        workers: Number of processes. Each uses one thread, so that sums are taken in the same order everywhere.
        file: Where the trials done are kept, also when interrupted.
        resume: Whether to go on from the trials in `file`.

    Raises:
        ValueError: `file` is missing or belongs to another run.
        KeyboardInterrupt: Interrupted; the trials done are in `file`.
    """
    done = _load(file, draw.identity) if resume else []
    threads = {"OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "MKL_NUM_THREADS": "1"}
    before = {key: os.environ.get(key) for key in threads}
    os.environ.update(threads)
    try:
        with ProcessPoolExecutor(workers, get_context("spawn"), _start_worker, (draw, analyse)) as pool:
            results = pool.map(_trial, range(len(done), trials), chunksize=4)
            try:
                for result in tqdm(results, "Trials", total=trials, initial=len(done), file=sys.stderr):
                    done.append(result)
            except BaseException:
                pool.shutdown(cancel_futures=True)
                raise
    finally:
        for key, value in before.items():
            if value is None:
                del os.environ[key]
            else:
                os.environ[key] = value
        if done:
            _save(file, draw.identity, done)
    return np.array(done[:trials])


_WORK: tuple[Draw, Callable[[Recording], Outcome]]


def _start_worker(draw: Draw, analyse: Callable[[Recording], Outcome]) -> None:
    """Hands a worker its task; Ctrl-C is the parent's business."""
    global _WORK
    _WORK = draw, analyse
    signal.signal(signal.SIGINT, signal.SIG_IGN)


def _trial(k: int) -> Outcome:
    draw, analyse = _WORK
    return analyse(draw(k))


def _save(file: Path, identity: dict[str, Any], done: list[Outcome]) -> None:
    with replacing(file) as temporary:
        np.savez(temporary, identity=json.dumps(identity), outcomes=np.array(done))


def _load(file: Path, identity: dict[str, Any]) -> list[Outcome]:
    try:
        with np.load(file, allow_pickle=False) as data:
            kept, outcomes = json.loads(str(data["identity"])), list(data["outcomes"])
    except (OSError, ValueError, KeyError) as error:
        raise ValueError(f"--resume needs the trials of an earlier run in {file} ({error}).") from None
    different = [key for key in identity if kept.get(key) != json.loads(json.dumps(identity[key]))]
    if different:
        raise ValueError(
            f"The trials in {file} belong to another run: {', '.join(different)} differ; leave out --resume."
        )
    return outcomes


@dataclass(frozen=True, eq=False)
class Distribution:
    """Errors of one model's base parameters over the trials.

    Attributes:
        names: Names of the parameters.
        errors: Error of each trial (trials, parameters).
        predicted: Standard deviations that each trial predicted from itself (trials, parameters).
        published: The paper's errors (parameters,).
    """

    names: tuple[str, ...]
    errors: np.ndarray
    predicted: np.ndarray
    published: np.ndarray

    @property
    def mean(self) -> np.ndarray:
        """Mean error: the bias of the estimates."""
        return self.errors.mean(axis=0)

    @property
    def std(self) -> np.ndarray:
        """Spread of the errors."""
        return self.errors.std(axis=0, ddof=1)

    @property
    def interval(self) -> np.ndarray:
        """Limits of the central 95 % of the errors (2, parameters)."""
        return np.percentile(self.errors, [2.5, 97.5], axis=0)

    @property
    def predicted_std(self) -> np.ndarray:
        """Root mean square of the predicted standard deviations."""
        return np.sqrt(np.mean(self.predicted**2, axis=0))

    @property
    def coverage(self) -> np.ndarray:
        """Fraction of trials whose own 95 % interval holds the truth."""
        return np.mean(np.abs(self.errors) <= 1.959964 * self.predicted, axis=0)

    @property
    def percentile(self) -> np.ndarray:
        """Percentile of the paper's errors among the trials."""
        return 100 * np.mean(self.errors < self.published, axis=0)


def table(model: str, found: Distribution) -> report.Table:
    """Mean, spread and interval of the errors beside the prediction and the paper's single run."""
    low, high = found.interval
    return report.Table(
        f"Errors of the {model} model over {len(found.errors)} trials, kg, kg m and kg m²",
        *report.columns(
            parameter=found.names,
            mean_error=found.mean,
            std=found.std,
            low_95=low,
            high_95=high,
            predicted_std=found.predicted_std,
            coverage_95=found.coverage,
            paper_error=found.published,
            paper_percentile=found.percentile,
        ),
    )


def chart(found: Mapping[str, Distribution]) -> Figure:
    """All parameters at a glance, a panel for each model: interval, mean, prediction and the paper's error."""
    with figures.paper_style():
        figure = Figure(figsize=(3.5, 3.2))
        panels = figure.subplots(1, len(found), sharey=True, squeeze=False)[0]
        for ax, (model, d) in zip(panels, found.items(), strict=True):
            rows = np.arange(len(d.names))
            ax.axvline(0, color="0.6", lw=0.5)
            spread = 1.96 * d.predicted_std
            ax.barh(rows, 2 * spread, left=-spread, height=0.6, color="0.85", label="predicted 95 %")
            ax.hlines(rows, *d.interval, color="tab:blue", lw=1.2, label="95 % of trials")
            ax.plot(d.mean, rows, "o", color="tab:blue", ms=2.5, label="mean")
            ax.plot(d.published, rows, "x", color="tab:red", ms=4, mew=0.9, label="paper")
            ax.set_title(model)
            ax.set_xlabel("Error (kg, kg m, kg m²)")
            ax.set_yticks(rows, [figures.parameter_symbol(name) for name in d.names])
        panels[0].invert_yaxis()
        handles, labels = panels[0].get_legend_handles_labels()
        figure.legend(handles, labels, loc="outside upper center", ncols=2)
    return figure


def study(
    draw: Draw,
    analyse: Callable[[Recording], Outcome],
    names: tuple[str, ...],
    published: Mapping[str, Sequence[float]],
    args: argparse.Namespace,
) -> None:
    """Runs the trials of a study's command line; writes and prints how they are distributed.

    Args:
        draw: Source of the recordings.
        analyse: What becomes of a recording.
        names: Names of the base parameters.
        published: The paper's errors of each model, in the order of the outcomes.
        args: The study's options.
    """
    file = args.out / "trials.npz"
    try:
        outcomes = run_trials(draw, analyse, args.trials, workers=args.workers, file=file, resume=args.resume)
    except KeyboardInterrupt:
        print(f"\nThe trials done so far are in {file}; run again with --resume to go on from there.", file=sys.stderr)
        raise
    found = {
        model: Distribution(names, outcomes[:, k, 0], outcomes[:, k, 1], np.array(errors))
        for k, (model, errors) in enumerate(published.items())
    }
    numbers = {"trials": len(outcomes), "redrawn": draw.redrawn}
    with report.results_folder(args.out) as folder:
        for model, d in found.items():
            table(model, d).write(folder, f"monte_carlo_{model}")
            numbers |= {
                f"std_over_predicted_{model}": dict(zip(names, (d.std / d.predicted_std).tolist(), strict=True)),
                f"coverage_95_{model}": dict(zip(names, d.coverage.tolist(), strict=True)),
                f"bias_{model}": dict(zip(names, d.mean.tolist(), strict=True)),
                f"bias_standard_error_{model}": dict(
                    zip(names, (d.std / np.sqrt(len(outcomes))).tolist(), strict=True)
                ),
            }
        report.write_json(folder / "monte_carlo.json", numbers)
        figures.save(chart(found), folder, "figure_monte_carlo", args.formats)
    for model, d in found.items():
        print(table(model, d).text())
        biased = np.flatnonzero(np.abs(d.mean) > 4 * d.std / np.sqrt(len(outcomes)))
        if len(biased):
            print("Biased beyond chance: " + ", ".join(f"{names[k]} by {d.mean[k]:+.3f}" for k in biased) + "\n")
    print(
        "A bias comes from a wrong model or from noise on the joint states, which is in the regressor (errors in\n"
        "variables); the predicted standard deviations know the wrenches' noise only and do not show it.\n"
    )
