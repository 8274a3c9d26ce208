"""Designs the joint motion that tells most about a mechanism's base parameters, within limits and without collisions.

The motion is a finite Fourier series for every joint, which starts and ends at rest. For the double pendulum the limits
are those of the paper's excitation, which is also what the design is compared with.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

import scenes
from experiments.cli import options
from experiments.output import figures, report
from experiments.output.excite_report import Motion, figure, recording, table_limits, table_quality
from experiments.studies import excitation
from experiments.studies.excitation import Problem
from ident.errors import InputError
from sim.models.mechanism import mechanism
from sim.motion.collisions import Collisions
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.motion.excitation_design import Limits
from sim.motion.fourier import FEWEST, FourierTrajectory
from sim.simulation.simulate import RATE, SAMPLES

PAPER = "double_pendulum"
"""Scene whose excitation the paper's is compared with."""

BASES = {"double_pendulum": "base", "humanoid": "pelvis"}
"""Body whose frame is {0} in the scenes."""

SECONDS, VELOCITY, ACCELERATION = 10.0, 1.0, 3.0
"""Duration in s, and limits in rad/s and rad/s² (m/s and m/s² of slides), where nobody gives others: modest ones,
because models do not know them."""

PER_PERIOD = 10
"""Samples that a period of the fastest harmonic needs at least."""

LONGEST = 1_000_000
"""Samples at most."""


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
    """The part of the given range that the model allows to each joint: lower and upper limits (n,)."""
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


def paper_motion(time: np.ndarray) -> Motion:
    """The paper's excitation without its noise."""
    return Motion(time, *DOUBLE_PENDULUM.trajectory(time))


def run(args: argparse.Namespace) -> None:
    """Designs a motion, and writes and prints it."""
    scene = args.model in scenes.NAMES
    base = args.base or BASES.get(args.model) if scene else args.base
    arm = mechanism(scenes.load(args.model) if scene else args.model, base, ignore=args.ignore)
    problem = excitation.problem(
        arm, args.joints, sensors=args.sensors, noise=(args.noise[0], args.noise[1]), ignore=args.ignore
    )
    published = args.model == PAPER and len(problem.joints) == len(DOUBLE_PENDULUM.offset)
    duration = (SAMPLES - 1) / RATE if published else SECONDS
    time = sample_times(duration if args.seconds is None else args.seconds, args.harmonics)
    reference = paper_motion(time) if published else None
    limits = joint_limits(args, problem, reference)
    collisions = _collisions(args, problem)
    before, trajectory = _designed(args, problem, limits, reference, time, collisions)
    after = Motion(time, *trajectory.states(time))
    start = "the paper's excitation" if published else "the first random start"
    title = f"Excitation of {', '.join(problem.joints)}: {start} and the designed one"
    tables = {
        "table_quality": table_quality(problem, before, after, title),
        "table_limits": table_limits(problem, limits, before, after),
    }
    _write(args, problem, tables, figure(problem, limits, before, after), after, trajectory)
    for table in tables.values():
        print(table.text())
    _print_summary(args, problem, tables["table_quality"], start, collisions)


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
    """What the design is compared with, and the design."""
    rest = np.array([problem.rest[joint] for joint in problem.joints])
    starts = excitation.start_motions(limits, rest, float(time[-1]), args.harmonics, args.starts, args.seed)
    if reference is None:
        before = Motion(time, *starts[0].states(time))
    else:
        before = reference
        starts[0] = FourierTrajectory.closest(float(time[-1]), args.harmonics, time, reference.q)
    found = excitation.best(problem, limits, args.criterion, starts, collisions, args.iterations)
    return before, found


def _write(
    args: argparse.Namespace,
    problem: Problem,
    tables: dict[str, report.Table],
    drawing: Figure,
    motion: Motion,
    trajectory: FourierTrajectory,
) -> None:
    given = {key: str(value) if key == "out" else value for key, value in vars(args).items()}
    series = {
        "duration": trajectory.duration,
        "joints": list(problem.joints),
        "center": trajectory.center.tolist(),
        "coefficients": trajectory.coefficients.tolist(),
    }
    source = report.provenance(given, {"series": series, "base_parameters": list(problem.parameters.names)})
    with report.results_folder(args.out, stale=report.OUTPUTS, inputs=[Path(args.model)]) as folder:
        figures.save(drawing, folder, "figure_excitation", args.formats)
        for name, table in tables.items():
            table.write(folder, name)
        samples = recording(problem, motion, {"designed": args.model, "criterion": args.criterion, "series": series})
        samples.save(folder / "trajectory.csv")
        samples.save(folder / "trajectory.npz")
        report.write_json(folder / "provenance.json", source)


def _print_summary(
    args: argparse.Namespace, problem: Problem, table: report.Table, start: str, collisions: Collisions | None
) -> None:
    before, after = table.rows[0][1:]
    print(f"{problem.parameters.rank} base parameters: {', '.join(problem.parameters.names)}.")
    print(f"Condition number before, {start}: {before:.1f}; after: {after:.1f}.")
    print(f"Collisions: {_checked(collisions)}.")
    print(f"Trajectory, figure and tables are in {args.out}.")


def _checked(collisions: Collisions | None) -> str:
    """What is known about collisions."""
    if collisions is None:
        return "not checked"
    pairs = collisions.pairs()
    if pairs == 0:
        return "not checked, because the model has no geoms that could collide with one another"
    return f"none; of {pairs} pairs of geoms none comes closer than {collisions.clearance:g} m"


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.output_parser("excite", __doc__)
    out.add_argument("model", help=f"an MJCF or URDF file, or a scene: {', '.join(scenes.NAMES)}")
    out.add_argument("--seconds", type=_positive, help=f"duration; {SECONDS:g} or the paper's if not given")
    out.add_argument("--joints", nargs="+", help="hinge and slide joints to move; all if not given, the others rest")
    out.add_argument("--base", help="body whose frame is {0}; the scene's or the world's if not given")
    out.add_argument(
        "--position", nargs=2, type=float, metavar=("LOW", "HIGH"), help="rad or m; the model's range if not given"
    )
    limits = "for every joint; {:g} or the peak of the paper's if not given"
    out.add_argument("--velocity", type=_positive, help=f"largest, rad/s or m/s, {limits.format(VELOCITY)}")
    out.add_argument("--acceleration", type=_positive, help=f"largest, rad/s² or m/s², {limits.format(ACCELERATION)}")
    out.add_argument(
        "--criterion",
        choices=excitation.CRITERIA,
        default="condition",
        help="; ".join(f"{key}, {what}" for key, what in excitation.CRITERIA.items()),
    )
    out.add_argument("--sensors", choices=excitation.SENSORS, default="wrench", help="what the regressor explains")
    out.add_argument(
        "--noise",
        nargs=2,
        type=_positive,
        default=[0.5, 0.05],
        metavar=("N", "NM"),
        help="sensors' standard deviations",
    )
    out.add_argument("--harmonics", type=options.whole_number(FEWEST, 100), default=5, help="terms of the series")
    out.add_argument("--starts", type=options.whole_number(1, 10_000), default=8, help="motions to begin from")
    out.add_argument("--iterations", type=options.whole_number(1, 100_000), default=100, help="at most, each start")
    out.add_argument("--seed", type=options.whole_number(0), default=0, help="seed of the starts")
    out.add_argument("--collisions", choices=("avoid", "ignore"), default="avoid", help="what to do about them")
    out.add_argument("--clearance", type=_positive, default=0.005, help="distance in m that counts as a collision")
    out.add_argument("--ignore", nargs="*", default=[], help="equality constraints and tendons to leave out")
    return out


def _positive(text: str) -> float:
    """Type of an option: a positive number."""
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not 0 < value < np.inf:
        raise argparse.ArgumentTypeError(f"needs a positive number, got '{text}'")
    return value


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return options.run(run, parser(), argv)


if __name__ == "__main__":
    sys.exit(main())
