"""Design of a motion for a model or a scene, from its limits to its files."""

import argparse
from collections.abc import Sequence
from pathlib import Path

import numpy as np

import scenes
from experiments.data import paper
from experiments.data.defaults import ACCELERATION, SCENE, SECONDS, VELOCITY
from experiments.document import report
from experiments.document.page import PAGE, Said, complain, write_results
from experiments.document.results import Results
from experiments.document.terminal import wrapped
from experiments.reports.excite_report import figure, recording, table_deviations, table_limits, table_quality
from experiments.studies import criteria, excitation
from experiments.studies.excitation import Problem
from ident.errors import InputError
from ident.geometry.inertia import with_bodies
from ident.mechanism.motion import Motion
from sim.models.mechanism import mechanism
from sim.motion.collisions import Collisions
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.motion.excitation_design import Limits
from sim.motion.fourier import FourierTrajectory
from sim.simulation.simulate import LONGEST, RATE

PER_PERIOD = 10
"""Smallest number of samples in a period of the fastest harmonic."""


def sample_times(seconds: float, harmonics: int) -> np.ndarray:
    """Times of the samples, both ends included, s (N,).

    Raises:
        InputError: The motion is too short for its harmonics, or too long.
    """
    shortest = PER_PERIOD * harmonics / RATE
    if not shortest <= seconds <= LONGEST / RATE:
        raise InputError(
            f"{harmonics} harmonics at {RATE:g} Hz need {shortest:g} s to {LONGEST / RATE:g} s, which is {PER_PERIOD} "
            f"samples or more for a period of the fastest; got {seconds:g} s."
        )
    return np.arange(round(seconds * RATE) + 1) / RATE


def joint_limits(args: argparse.Namespace, problem: Problem, reference: Motion | None) -> Limits:
    """Limits from the options, else from the paper's motion, else from the model.

    Raises:
        InputError: A joint has no range and none is given, or the ranges leave no room.
    """
    if reference is None:
        low, high = _ranges(problem, args.position)
        velocity, acceleration = (np.full(len(low), limit) for limit in (VELOCITY, ACCELERATION))
    else:
        low, high = reference.q.min(axis=0), reference.q.max(axis=0)
        velocity, acceleration = abs(reference.dq).max(axis=0), abs(reference.ddq).max(axis=0)
        if args.position is not None:
            low, high = _ranges(problem, args.position)
    if args.velocity is not None:
        velocity = np.full(len(low), args.velocity)
    if args.acceleration is not None:
        acceleration = np.full(len(low), args.acceleration)
    return Limits(low, high, velocity, acceleration)


def _ranges(problem: Problem, given: Sequence[float] | None) -> tuple[np.ndarray, np.ndarray]:
    """The part of the given range that the model allows for each joint: lower and upper limits (n,)."""
    limits = []
    for joint in problem.joints:
        allowed, unit = problem.mechanism.ranges.get(joint), problem.units[joint]
        if given is None and allowed is None:
            raise InputError(
                f"Joint '{joint}' has no range in the model; give one with --position LOW HIGH, in {unit}."
            )
        low, high = given if given is not None else (-np.inf, np.inf)
        inner, outer = allowed if allowed is not None else (-np.inf, np.inf)
        if not max(low, inner) < min(high, outer):
            raise InputError(
                f"Joint '{joint}' needs a range with a lower limit below the upper one, got {low:g} to {high:g} "
                f"{unit} where the model allows {inner:g} to {outer:g}."
            )
        limits.append((max(low, inner), min(high, outer)))
    low, high = np.array(limits).T
    return low, high


def run(args: argparse.Namespace) -> None:
    """Designs a motion, and writes and prints it."""
    scene = args.model in scenes.NAMES
    base = args.base or scenes.BASES.get(args.model) if scene else args.base
    source = scenes.load(args.model) if scene else args.model
    arm = mechanism(source, base, ignore=args.ignore, packages=args.packages)
    problem = excitation.problem(arm, args.joints, sensors=args.sensors, noise=args.noise, ignore=args.ignore)
    published = args.model == SCENE and len(problem.joints) == len(DOUBLE_PENDULUM.offset)
    duration = (paper.SAMPLES - 1) / RATE if published else SECONDS
    time = sample_times(duration if args.seconds is None else args.seconds, args.harmonics)
    reference = Motion(*DOUBLE_PENDULUM.trajectory(time)) if published else None
    limits = joint_limits(args, problem, reference)
    collisions = _collisions(args, problem)
    before, trajectory = _designed(args, problem, limits, reference, time, collisions)
    after = Motion(*trajectory.states(time))
    start = "the paper's excitation" if published else "the first random start"
    title = (
        f"Excitation of {', '.join(problem.joints)}: predicted standard deviations, SI units, of {start} and the "
        "designed one"
    )
    tables = {
        "table_deviations": table_deviations(problem, before, after, title),
        "table_quality": table_quality(problem, before, after),
        "table_limits": table_limits(problem, limits, before, after),
    }
    lines = _lines(problem, start, (before, after), collisions)
    drawing = figure(problem, limits, time, before, after)
    caption = f"Position, velocity and acceleration of the joints that move: designed, and before, {start}."
    results = Results(tables, {"figure_excitation": (drawing, caption)})
    refused = _write(args, problem, results, lines, time, trajectory)
    for table in tables.values():
        print(table.text())
    print(wrapped("\n".join(lines)))
    print(f"Everything is in {args.out}; open {PAGE}.")
    complain(refused)


def _collisions(args: argparse.Namespace, problem: Problem) -> Collisions | None:
    if args.collisions == "ignore":
        return None
    return Collisions(problem.mechanism.source.model, problem.joints, args.clearance)


def _designed(
    args: argparse.Namespace,
    problem: Problem,
    limits: Limits,
    reference: Motion | None,
    time: np.ndarray,
    collisions: Collisions | None,
) -> tuple[Motion, FourierTrajectory]:
    """The motion that the design is compared with, and the design."""
    rest = np.array([problem.rest[joint] for joint in problem.joints])
    starts = excitation.start_motions(limits, rest, float(time[-1]), args.harmonics, args.starts, args.seed)
    if reference is None:
        before = Motion(*starts[0].states(time))
    else:
        before = reference
        starts[0] = FourierTrajectory.closest(float(time[-1]), args.harmonics, time, reference.q)
    value = criteria.cost(problem, args.criterion, len(time))
    return before, excitation.best(value, limits, starts, collisions, args.iterations, args.seed)


def _write(
    args: argparse.Namespace,
    problem: Problem,
    results: Results,
    lines: Sequence[str],
    time: np.ndarray,
    trajectory: FourierTrajectory,
) -> str:
    """Writes everything, and returns the result of `write_results`."""
    given = {key: str(value) if isinstance(value, Path) else value for key, value in vars(args).items()}
    series = {
        "duration": trajectory.duration,
        "joints": list(problem.joints),
        "center": trajectory.center.tolist(),
        "coefficients": trajectory.coefficients.tolist(),
    }
    source = report.provenance(given, {"series": series, "base_parameters": list(problem.parameters.names)})
    shown = results | Results(numbers={"provenance": source})
    with report.results_folder(args.out, stale=report.OUTPUTS, inputs=[Path(args.model)]) as folder:
        about = {"designed": args.model, "criterion": args.criterion, "series": series}
        samples = recording(problem, time, Motion(*trajectory.states(time)), about)
        files = ("trajectory.csv", "trajectory.npz")
        for name in files:
            samples.save(folder / name)
        said = Said(f"Excitation of {Path(args.model).name}", lines=lines, files=files)
        return write_results(args, folder, shown, args.formats, said)


def _lines(problem: Problem, start: str, compared: tuple[Motion, Motion], collisions: Collisions | None) -> list[str]:
    """Sentences for the terminal and the page, besides the tables."""
    before, after = (criteria.mean_deviation(problem, motion) for motion in compared)
    first, last = (criteria.quality(problem, motion)["condition_number"] for motion in compared)
    named = with_bodies(problem.parameters.names, problem.mechanism.bodies)
    return [
        f"{problem.parameters.rank} base parameters: {named}.",
        f"Predicted standard deviations (kg, kg m, kg m²), geometric mean before, {start}: {before:.2e}; after: "
        f"{after:.2e}, {after / before - 1:+.0%}.",
        f"Condition number before: {first:.1f}; after: {last:.1f}.",
        f"Collisions: {_checked(collisions)}.",
    ]


def _checked(collisions: Collisions | None) -> str:
    """Result of the collision checks in words."""
    if collisions is None:
        return "not checked"
    pairs = collisions.pairs()
    if pairs == 0:
        return "not checked, because the model has no geoms that could collide with one another"
    return f"none; of {pairs} pairs of geoms none comes closer than {collisions.clearance:g} m"
