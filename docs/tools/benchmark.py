"""Speed of regressor, identification and simulation, as ratios to other ways in one process.

Ours and theirs take turns, and their medians are compared, after a check that their results are the same. All use one
thread for linear algebra. Nothing is asserted: machines differ, and are noisy. `python -m docs.tools.benchmark` writes
`results/benchmark.json`; with Pinocchio (extra `peers`) it takes a few minutes. `--end-to-end` measures whole ways from
a log to parameters instead, each in a process of its own, and leaves the rest of the record as it was.
"""

import argparse
import importlib.metadata
import json
import os
import platform
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure
from tqdm import tqdm

import scenes
from docs.tools import end_to_end
from docs.tools import mechanisms as subjects
from docs.tools.mechanisms import PENDULUM, PINOCCHIO_NAME, Pinocchio, Subject, double_pendulum, subject
from experiments.data import paper
from experiments.data.paper import SCENE
from experiments.document import figures
from experiments.document.result_folder import provenance, write_json
from ident.estimation.accumulator import accumulate
from ident.estimation.samples import Samples
from ident.mechanism.motion import Motion
from ident.model import compiled
from ident.parameters.base_parameters import STANDARD_GRAVITY
from ident.regression.ordinary import least_squares
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.simulate import simulate, simulate_many

REGRESSOR, AGAIN, ACCUMULATION = "regressor", "regressor, memory used again", "accumulation"
ALL_COLUMNS, BASE_COLUMNS = "identification, all columns", "identification, base columns"

TASKS = {
    REGRESSOR: "the matrix Y of all columns (N, 6, 10 b), against the loop that fills such a matrix",
    AGAIN: "the same into the memory of an earlier call (`out`), against the same loop, which fills new memory",
    ACCUMULATION: "all that least squares needs of the base columns (`accumulate`), against the same loop alone",
    ALL_COLUMNS: "from joint states and wrench to base parameters and their covariance (`least_squares`), the "
    "regrouping found before, against the loop and np.linalg.lstsq on all columns, without a covariance",
    BASE_COLUMNS: "the same against the loop and np.linalg.lstsq on the base columns",
}
"""Tasks compared on every mechanism. Before them, models are built, equations recorded, and states laid out."""

RECORD = Path(__file__).parents[1] / "benchmark.json"
"""Record that docs/speed.md shows."""

CHAIN = "arm"
"""Name of the arms of increasing length."""

Way = Callable[[], object]
Row = dict[str, Any]


@dataclass(frozen=True)
class Effort:
    """Durations and sizes of comparisons.

    Attributes:
        seconds: Shortest time of a comparison, s.
        least: Smallest number of repetitions.
        sizes: Numbers of samples.
        trials: Number of Monte Carlo trials.
        samples: Samples of each trial.
        bodies: Numbers of bodies of arms.
    """

    seconds: float = 0.5
    least: int = 3
    sizes: tuple[int, ...] = (1000, 10_000, 100_000)
    trials: int = 100
    samples: int = paper.SAMPLES
    bodies: tuple[int, ...] = (3, 10, 30, 100, 300)


QUICK = Effort(0.01, 3, (100, 300), 2, 50, (3, 10))
"""Enough to check that everything runs."""

QUICK_LOG = 600
"""Samples of the log for the same."""


def alternating(ways: Sequence[Way], effort: Effort) -> np.ndarray:
    """Times of several ways in turns, after one warm-up of each, s (repetitions, ways)."""
    for way in ways:
        way()
    rounds: list[list[float]] = []
    start = time.perf_counter()
    while len(rounds) < effort.least or (time.perf_counter() - start < effort.seconds and len(rounds) < 51):
        rounds.append([_timed(way) for way in ways])
    return np.array(rounds)


def _timed(way: Way) -> float:
    """Seconds of one call, without the deallocation of its result."""
    start = time.perf_counter()
    result = way()
    took = time.perf_counter() - start
    del result
    return took


def compared(
    task: str, name: str, bodies: int, samples: int, peer: str, pair: tuple[Way, Way], effort: Effort, times: int = 1
) -> Row:
    """Times of our way, done so many times at once, and of the peer's, s; of ours without compiled code as well."""

    def plain() -> object:
        with compiled.switched(False):
            return pair[0]()

    measured = alternating([*pair, *[plain] * (compiled.available() and peer == PINOCCHIO_NAME)], effort)
    measured[:, [0, *range(2, measured.shape[1])]] /= times
    ours, theirs, *numpy = np.median(measured, axis=0).tolist()
    each = measured[:, 1] / measured[:, 0]
    row = {"task": task, "mechanism": name, "bodies": bodies, "samples": samples, "peer": peer, "ours": ours}
    row |= {"theirs": theirs, "numpy": numpy[0] if numpy else None, "ratio": theirs / ours}
    return row | {"lowest": float(each.min()), "highest": float(each.max()), "repetitions": len(measured)}


def check_agreement(what: str, ours: np.ndarray, theirs: np.ndarray) -> None:
    """Checks that two results of one task agree.

    Raises:
        ValueError: They differ by more than 1e-7 of the largest element.
    """
    error = abs(ours - theirs).max() / abs(theirs).max()
    if not error < 1e-7:
        raise ValueError(f"Only what gives the same result is timed; {what}: results differ by {error:.1e}.")


def solved(Y: np.ndarray, wrench: np.ndarray, columns: Sequence[int] | None = None) -> np.ndarray:
    """Solution of `np.linalg.lstsq` for a regressor (N, 6, 10 b), or some of its columns, and wrenches (N, 6)."""
    rows = Y.reshape(-1, Y.shape[2])
    # Taking columns is several times faster than indexing them.
    rows = rows if columns is None else np.take(rows, columns, axis=1)
    return np.linalg.lstsq(rows, wrench.ravel(), rcond=None)[0]


def on_mechanisms(effort: Effort) -> Iterator[Row]:
    """All tasks on all mechanisms, and on the number of samples of the paper's recording."""
    for mechanism, number in (
        (double_pendulum(), effort.samples),
        *((m, n) for m in subjects.mechanisms() for n in effort.sizes),
    ):
        samples, peer = mechanism.samples(number), Pinocchio(mechanism.tree, STANDARD_GRAVITY)
        states, kept = peer.states(samples.motion.states, samples.motion.base), peer.columns(mechanism.parameters.kept)
        loop, measured = partial(peer.regressor, *states), samples.measured
        _check(mechanism, samples[: effort.sizes[0]], peer)
        own = partial(least_squares, mechanism.equations, samples)
        pairs: dict[str, tuple[Way, Way]] = {
            REGRESSOR: (partial(mechanism.regressor, samples), loop),
            AGAIN: (partial(mechanism.regressor, samples, out=mechanism.regressor(samples)), loop),
            ACCUMULATION: (partial(accumulate, mechanism.equations, samples), loop),
        }
        # np.linalg.lstsq takes minutes and gigabytes beyond.
        if number * len(mechanism.tree.bodies) <= 1_000_000:
            pairs[ALL_COLUMNS] = own, lambda loop=loop, w=measured: solved(loop(), w)  # type: ignore[misc]
            pairs[BASE_COLUMNS] = own, lambda loop=loop, w=measured, k=kept: solved(loop(), w, k)  # type: ignore[misc]
        for task, pair in pairs.items():
            yield compared(task, mechanism.name, len(mechanism.tree.bodies), number, PINOCCHIO_NAME, pair, effort)


def _check(mechanism: Subject, samples: Samples, peer: Pinocchio) -> None:
    """Checks our results against theirs."""
    theirs = peer.regressor(*peer.states(samples.motion.states, samples.motion.base))
    every, kept = (peer.columns(columns) for columns in (range(theirs.shape[2]), mechanism.parameters.kept))
    psi, phi = least_squares(mechanism.equations, samples).psi, solved(theirs, samples.measured)[every]
    check_agreement(f"{REGRESSOR}, {mechanism.name}", mechanism.regressor(samples), theirs[..., every])
    check_agreement(f"{ALL_COLUMNS}, {mechanism.name}", psi, mechanism.parameters.regroup(phi))
    check_agreement(f"{BASE_COLUMNS}, {mechanism.name}", psi, solved(theirs, samples.measured, kept))


def of_arms(effort: Effort) -> Iterator[Row]:
    """The regressor of arms of increasing length; so few samples do not determine their parameters."""
    for bodies in effort.bodies:
        arm, number = subject(CHAIN, subjects.chain(bodies)), min(effort.sizes[-2], 30_000 // bodies)
        motion = Motion(*np.random.default_rng(0).normal(size=(3, number, bodies - 1)))
        samples, peer = Samples(motion, np.zeros((number, 6))), Pinocchio(arm.tree, STANDARD_GRAVITY)
        pair = (
            partial(arm.regressor, samples, out=arm.regressor(samples)),
            partial(peer.regressor, *peer.states(motion.states, None)),
        )
        yield compared(AGAIN, CHAIN, bodies, number, PINOCCHIO_NAME, pair, effort)


def of_trials(effort: Effort) -> Iterator[Row]:
    """Monte Carlo trials with noise drawn anew, identified with the regrouping and a factor given."""
    recording, pendulum = simulate(scenes.load(SCENE), DOUBLE_PENDULUM, samples=effort.samples), double_pendulum()
    true, joints, peer = recording.noise_free, pendulum.tree.joints, Pinocchio(pendulum.tree, STANDARD_GRAVITY)
    clean = *true.joint_states(joints), true.wrench("ground").values
    wrench = np.repeat([recording.noise[f"ground_{kind}"] for kind in ("force", "torque")], 3)
    noise = *recording.joint_noise(joints), wrench
    factor = accumulate(pendulum.equations, Samples(Motion(*clean[:3]), clean[3])).factor

    def drawn(seed: int) -> Samples:
        rng = np.random.Generator(np.random.SFC64(seed))  # the fastest of numpy's generators
        q, dq, ddq, measured = (x + std * rng.normal(size=x.shape) for x, std in zip(clean, noise, strict=True))
        return Samples(Motion(q, dq, ddq), measured)

    def ours() -> list[np.ndarray]:
        return [least_squares(pendulum.equations, drawn(k), factor=factor).psi for k in range(effort.trials)]

    def theirs(columns: Sequence[int] | None) -> list[np.ndarray]:
        trials = map(drawn, range(effort.trials))
        return [solved(peer.regressor(*peer.states(x.motion.states, None)), x.measured, columns) for x in trials]

    kept = peer.columns(pendulum.parameters.kept)
    check_agreement("Monte Carlo", np.array(ours()), np.array(theirs(kept)))
    for what, columns in (("all", None), ("base", kept)):
        pair = ours, partial(theirs, columns)
        task = f"{effort.trials} Monte Carlo trials, {what} columns"
        yield compared(task, PENDULUM, 3, effort.samples, PINOCCHIO_NAME, pair, effort)


def of_simulations(effort: Effort) -> Iterator[Row]:
    """Recorded simulations beside a bare loop of MuJoCo steps with prepared controls, which reads nothing."""
    spec, together = scenes.load(SCENE), 8
    loop = subjects.bare_loop(spec, effort.samples)
    one = partial(simulate, spec, DOUBLE_PENDULUM, samples=effort.samples)
    yield compared("simulate", PENDULUM, 3, effort.samples, "a bare loop", (one, loop), effort)
    for threads in (1, 2):
        many = partial(simulate_many, spec, DOUBLE_PENDULUM, seeds=range(together), samples=effort.samples)
        pair, task = (partial(many, threads=threads), loop), f"simulate_many, threads: {threads}"
        yield compared(task, PENDULUM, 3, effort.samples, "a bare loop", pair, effort, together)


PARTS: tuple[Callable[[Effort], Iterator[Row]], ...] = (on_mechanisms, of_arms, of_trials, of_simulations)
"""Parts of the benchmark; all but the last need Pinocchio."""


def measured(effort: Effort) -> dict[str, Any]:
    """Comparisons within one process, for `benchmark.json`."""
    with suppress(ImportError):
        import pinocchio  # noqa: F401

        return {"rows": [row for part in PARTS for row in tqdm(part(effort), part.__name__)]}
    print("Pinocchio is not compared with; install the extra 'peers'.")
    return {"rows": [row for part in PARTS[-1:] for row in part(effort)]}


def machine() -> str:
    """Processor, system, versions and library of linear algebra."""
    processor = platform.processor() or platform.machine()
    with suppress(OSError):
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        processor = next((line.partition(":")[2].strip() for line in lines if line.startswith("model name")), processor)
    versions = [f"python {platform.python_version()}"]
    for name in ("numpy", "scipy", "mujoco", "pin"):
        with suppress(importlib.metadata.PackageNotFoundError):
            versions.append(f"{name} {importlib.metadata.version(name)}")
    blas = np.show_config(mode="dicts")["Build Dependencies"]["blas"]
    where = f"{processor}, {os.cpu_count()} cores, {platform.system()}, {platform.machine()}"
    return f"{where}; {', '.join(versions)}; {blas['name']} {blas['version']} with one thread"


def markdown(results: dict[str, Any]) -> str:
    """Generated part of docs/speed.md: machine, a table of ratios, explanation of its columns, and other rows."""
    ratios: dict[tuple[str, int, int], dict[str, str]] = {}
    others = []
    for row in results["rows"]:
        alone = "" if row["numpy"] is None else f" ({row['theirs'] / row['numpy']:.1f})"
        if row["task"] in TASKS and row["mechanism"] != CHAIN:
            cell = f"{row['ratio']:.1f}{alone} of {1e6 * row['theirs'] / row['samples']:.3g} µs"
            ratios.setdefault((row["mechanism"], row["bodies"], row["samples"]), {})[row["task"]] = cell
        elif row["mechanism"] != CHAIN or row["bodies"] == max(Effort.bodies):
            sizes = f"{row['mechanism']} of {row['bodies']} bodies" + f", {row['samples']:,} samples" * (
                row["samples"] > 0
            )
            times = f"{row['ratio']:.3g} times as fast as {row['peer']}{alone}"
            others.append(f"- {row['task']}, {sizes}: {times}, {row['ours']:.2g} s")
    order = list(dict.fromkeys(name for name, *_ in ratios))
    lines = ["| " + " | ".join(("mechanism", "bodies", "samples", *TASKS)) + " |", "| --- " * (3 + len(TASKS)) + "|"]
    for name, bodies, samples in sorted(ratios, key=lambda key: (order.index(key[0]), key[2])):
        cells = (ratios[name, bodies, samples].get(task, "") for task in TASKS)
        lines.append("| " + " | ".join((name, str(bodies), f"{samples:,}", *cells)) + " |")
    empty = "- Empty: not compared; np.linalg.lstsq would take minutes there."
    head = (
        f"Measured on {results['machine']}. Times of the loop over times of ours, in brackets without compiled code, "
    )
    tasks = [f"- *{task}*: {what}." for task, what in TASKS.items()]
    return "\n".join([f"{head}and what the loop takes a sample:", "", *lines, "", *tasks, empty, *others, ""])


def figure(results: dict[str, Any]) -> Figure:
    """Time a sample over the number of samples of the pendulum and over the bodies of an arm, ours and Pinocchio's."""
    lines = (
        (0, PENDULUM, REGRESSOR, "samples", "o-", ("$Y$, ours", "$Y$, Pinocchio's loop")),
        (0, PENDULUM, ALL_COLUMNS, "samples", "s--", (r"$\psi$, ours", r"$\psi$, loop and lstsq")),
        (1, CHAIN, AGAIN, "bodies", "o-", ("", "")),
    )
    with figures.paper_style():
        figure = Figure()
        panels = figure.subplots(2, 1)
        for panel, mechanism, task, key, style, labels in lines:
            rows = [row for row in results["rows"] if (row["mechanism"], row["task"]) == (mechanism, task)]
            rows.sort(key=lambda row: row[key])
            for side, color, label in zip(("ours", "theirs"), ("C0", "C1"), labels, strict=True):
                times = [1e6 * row[side] / row["samples"] for row in rows]
                panels[panel].loglog([row[key] for row in rows], times, style, color=color, ms=2.5, label=label or None)
        for ax, label in zip(panels, ("Samples, double pendulum of 3 bodies", "Bodies of an arm"), strict=True):
            ax.set(xlabel=label, ylabel="Time a sample (µs)")
        figure.legend(*panels[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure


def main(argv: Sequence[str] | None = None) -> None:
    """Measures, writes `benchmark.json`, and prints the table of docs/speed.md."""
    parser = argparse.ArgumentParser("python -m docs.tools.benchmark", description=str(__doc__).partition("\n")[0])
    parser.add_argument("--quick", action="store_true", help="few samples and repetitions, to see that everything runs")
    parser.add_argument("--end-to-end", action="store_true", help="ways from a log to parameters, each in its process")
    parser.add_argument("--out", type=Path, default=Path("results/benchmark.json"), help="file for the results")
    args = parser.parse_args(argv)
    record = json.loads((args.out if args.out.exists() else RECORD).read_text(encoding="utf-8"))
    own = {"provenance": provenance({"quick": args.quick}), "machine": machine()}
    if args.end_to_end:
        ways = end_to_end.measured(QUICK_LOG, turns=1) if args.quick else end_to_end.measured()
        record["end_to_end"] = own | ways
    else:
        record |= own | measured(QUICK if args.quick else Effort())
    args.out.parent.mkdir(parents=True, exist_ok=True)
    write_json(args.out, record)
    print(end_to_end.markdown(record["end_to_end"]) if args.end_to_end else markdown(record))


if __name__ == "__main__":
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    main()
