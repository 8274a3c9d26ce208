"""Design of a motion for a model or a scene: limits, starts, and the search for the best motion."""

import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

import scenes
from experiments.data import paper
from experiments.data.paper import ACCELERATION, MARGIN, RANDOM_START, SCENE, SECONDS, VELOCITY
from experiments.studies import excitation_problem
from experiments.studies.excitation_problem import DesignProblem, cost, known_root, predicted_deviations, quality
from ident.errors import InputError
from ident.estimation.recorded_motion import motion_cutoff, recorded_motion
from ident.mechanism.motion import Motion
from ident.recordings.log import read_log
from ident.recordings.recording import STATES, Recording
from ident.recordings.smoothing import settling
from sim.models.model_mechanism import mechanism
from sim.motion.collisions import Collisions, reachable
from sim.motion.excitation import DOUBLE_PENDULUM, FourierTrajectory
from sim.motion.excitation_design import Cost, Limits, design, nearby_start, random_start, scaled_into
from sim.simulation.simulate import LONGEST, RATE

PER_PERIOD = 10
"""Smallest number of samples in a period of the fastest harmonic."""


@dataclass(frozen=True, eq=False)
class Excited:
    """A motion, and what it determines of a mechanism.

    Attributes:
        motion: The motion.
        quality: All criteria, by name.
        std: Predicted standard deviations of the base parameters (r,).
    """

    motion: Motion
    quality: Mapping[str, float]
    std: np.ndarray

    @property
    def mean_deviation(self) -> float:
        """Geometric mean of the standard deviations."""
        return geometric_mean(self.std)


def geometric_mean(deviations: np.ndarray) -> float:
    """Geometric mean of standard deviations; ratios of it do not depend on units."""
    with np.errstate(divide="ignore"):
        return float(np.exp(np.log(deviations).mean()))


@dataclass(frozen=True, eq=False)
class Design:
    """A designed motion, and the one that it is compared with.

    Attributes:
        problem: The problem.
        known: Standard deviations of the prior (r + d,); None without one.
        limits: Limits of the joints.
        time: Times of the samples, s (N,).
        start: Name of the motion before, in words.
        before: That motion.
        after: The design.
        series: Its Fourier series, in JSON types.
        recording: The designed motion of all hinges and slides.
        collisions: Result of the collision checks, in words.
    """

    problem: DesignProblem
    known: np.ndarray | None
    limits: Limits
    time: np.ndarray
    start: str
    before: Excited
    after: Excited
    series: Mapping[str, Any]
    recording: Recording
    collisions: str


@dataclass(frozen=True)
class DesignSearch:
    """Options of the search for a motion; by default the model's range, and the paper's or usual numbers.

    Attributes:
        harmonics: Terms of the series.
        starts: Random motions to begin from.
        iterations: Largest number of iterations from each.
        seconds: Duration, by default `SECONDS` or the paper's.
        criterion: One of `paper.CRITERIA`.
        seed: Seed of the starts.
        clearance: Distance that counts as a collision, m; None for no checks.
        floor: Height in the world's frame above which all moving bodies stay, m; None for none.
        log: Recording to compare with; by default the paper's excitation or the first start.
        columns: Mapping of the log's columns.
        position: Lowest and highest position of all joints, rad or m.
        margin: Share of the model's range that is kept free at each stop.
        velocity: Largest velocity, rad/s or m/s; by default that of the paper's motion, or `VELOCITY`.
        acceleration: Largest acceleration, rad/s² or m/s², likewise.
    """

    harmonics: int
    starts: int
    iterations: int
    seconds: float | None = None
    criterion: str = "deviations"
    seed: int = 0
    clearance: float | None = None
    floor: float | None = None
    log: Path | None = None
    columns: Path | None = None
    position: Sequence[float] | None = None
    margin: float = MARGIN
    velocity: float | None = None
    acceleration: float | None = None


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


def joint_limits(search: DesignSearch, problem: DesignProblem, reference: Motion | None) -> Limits:
    """Limits from the options, else from the paper's motion, else from the model.

    Raises:
        InputError: A joint has no range and none is given, or the ranges leave no room.
    """
    if reference is None or search.position is not None:
        low, high = _ranges(problem, search)
    else:
        low, high = reference.q.min(axis=0), reference.q.max(axis=0)
    peaks = [abs(x).max(axis=0) for x in (reference.dq, reference.ddq)] if reference else [VELOCITY, ACCELERATION]
    velocity, acceleration = (
        np.full(len(low), peak if given is None else given)
        for given, peak in zip((search.velocity, search.acceleration), peaks, strict=True)
    )
    return Limits(low, high, velocity, acceleration)


def _ranges(problem: DesignProblem, search: DesignSearch) -> tuple[np.ndarray, np.ndarray]:
    """The part of the given range that the model allows for each joint, off its stops: lower and upper limits (n,)."""
    limits, given = [], search.position
    for joint in problem.joints:
        allowed, unit = problem.mechanism.ranges.get(joint), problem.units[joint]
        if given is None and allowed is None:
            raise InputError(
                f"Joint '{joint}' has no range in the model; give one with --position LOW HIGH, in {unit}."
            )
        low, high = given or (-np.inf, np.inf)
        inner, outer = allowed or (-np.inf, np.inf)
        free = search.margin * (outer - inner) if allowed else 0.0
        inner, outer = inner + free, outer - free
        if not max(low, inner) < min(high, outer):
            raise InputError(
                f"Joint '{joint}' needs a range with a lower limit below the upper one, got {low:g} to {high:g} "
                f"{unit} where the model allows {inner:g} to {outer:g}."
            )
        limits.append((max(low, inner), min(high, outer)))
    low, high = np.array(limits).T
    return low, high


def problem_of(
    model: str, joints: Sequence[str] | None = None, *, base: str | None = None, **more: Any
) -> DesignProblem:
    """Problem of exciting a model or a scene.

    Args:
        model: Model file, or name of a scene.
        joints: As for `excitation.problem`.
        base: Body whose frame is {0}, by default the scene's or the world's.
        more: Further arguments of `excitation.problem`, and of `sim.mechanism`.
    """
    scene = model in scenes.NAMES
    base = base or scenes.BASES.get(model) if scene else base
    stated = {key: more.pop(key) for key in ("packages", "base_rpy_deg") if key in more}
    both = {key: more[key] for key in ("ignore", "fix") if key in more}
    arm = mechanism(scenes.load(model) if scene else model, base, **stated, **both)
    return excitation_problem.problem(arm, joints, **{"sensors": "wrench", **more})


def designed(problem: DesignProblem, model: str, search: DesignSearch) -> Design:
    """A motion for a problem.

    Args:
        problem: The problem.
        model: Model file or scene that it is of; the double pendulum has the paper's duration and limits.
        search: What to search for.

    Raises:
        InputError: A joint has no range, the motion is too short or too long, or all motions collide.
    """
    published = model == SCENE and len(problem.joints) == len(DOUBLE_PENDULUM.offset)
    duration = (paper.SAMPLES - 1) / RATE if published else SECONDS
    time = sample_times(duration if search.seconds is None else search.seconds, search.harmonics)
    reference = Motion(*DOUBLE_PENDULUM.trajectory(time)) if published else None
    problem, limits = _within_loops(problem, joint_limits(search, problem, reference))
    own, arm, collisions = None, problem.mechanism, None
    if search.log is not None:
        own = recorded(problem, search.log, search.columns)
    if search.clearance is not None:
        collisions = Collisions(arm.source.model, arm.tree, search.clearance, problem.still, search.floor)
    if collisions is not None and search.floor is not None and not collisions.checks_floor:
        raise InputError("--floor needs moving bodies with geoms that can collide; this model has none.")
    rest = np.array([problem.rest[joint] for joint in problem.joints])
    motions = start_motions(limits, rest, float(time[-1]), search.harmonics, search.starts, search.seed)
    before = own or reference or Motion(*motions[0].states(time))
    if reference is not None:
        motions[0] = FourierTrajectory.closest(float(time[-1]), search.harmonics, time, reference.q)
    value = cost(problem, search.criterion, len(time))
    trajectory = best(value, limits, motions, collisions, search.iterations, search.seed)
    after = Motion(*trajectory.states(time))
    series = {
        "duration": trajectory.duration,
        "joints": list(problem.joints),
        "center": trajectory.center.tolist(),
        "coefficients": trajectory.coefficients.tolist(),
    }
    known = None if arm.prior is None else np.linalg.norm(known_root(problem), axis=0)
    start = str(search.log) if search.log else "the paper's excitation" if published else RANDOM_START
    first, last = (
        Excited(
            motion,
            quality(problem, motion),
            predicted_deviations(problem, motion),
        )
        for motion in (before, after)
    )
    made = recording(problem, time, after, {"designed": model, "criterion": search.criterion, "series": series})
    return Design(problem, known, limits, time, start, first, last, series, made, _checked(collisions))


def _within_loops(problem: DesignProblem, limits: Limits) -> tuple[DesignProblem, Limits]:
    """Limits in which the loops close, and the problem with loops closed all over them."""
    tree = problem.mechanism.tree
    if tree.closure is None:
        return problem, limits
    rest = np.array([problem.rest[joint] for joint in problem.joints])
    low, high = reachable(tree, problem.whole.ranges, rest, limits.low, limits.high)
    # Searches start from the nearest of some random postures in which the loops are closed.
    q = np.random.default_rng(0).uniform(low, high, (200, len(low)))
    closure = tree.closure.along(q[:, tree.of_loops[0]], np.zeros(len(q)))
    mechanism = replace(problem.mechanism, tree=replace(tree, closure=closure))
    return replace(problem, mechanism=mechanism), replace(limits, low=low, high=high)


def recorded(problem: DesignProblem, log: Path, columns: Path | None = None) -> Motion:
    """Motion of a log's joints, of those that the problem moves, at the rate of designed motions.

    Raises:
        InputError: The log lacks a joint, or does not fit the mechanism.
    """
    recording = read_log(log, problem.whole, columns)
    joints = problem.joints
    cutoff = motion_cutoff(recording, joints, None, filters=True)
    motion, own = recorded_motion(problem.mechanism, recording, cutoff), recording.time
    edge = 0 if cutoff is None else min(settling(recording.rate, cutoff), len(own) // 4)
    time = np.arange(own[edge], own[-1 - edge], 1 / RATE)
    q, dq, ddq = (np.stack([np.interp(time, own, column) for column in x.T], axis=1) for x in motion.states)
    return Motion(q, dq, ddq)


def recording(problem: DesignProblem, time: np.ndarray, motion: Motion, provenance: Mapping[str, Any]) -> Recording:
    """Recording of the motion of all hinge and slide joints."""
    measured, units = {}, {}
    still, tree = np.zeros(len(time)), problem.mechanism.tree
    states = [np.hstack(each) for each in zip(motion.states, tree.dependent_states(*motion.states), strict=True)]
    # Hinges that stand for a ball joint are none of the model's.
    columns = {joint: k for k, joint in enumerate((*problem.joints, *tree.dependent)) if joint in problem.rest}
    for joint in dict.fromkeys((*columns, *problem.rest)):
        k = columns.get(joint)
        rest = (problem.rest[joint] + still, still, still)
        for kind, x, per, at_rest in zip(STATES, states, ("", "/s", "/s²"), rest, strict=True):
            measured[f"{joint}_{kind}"] = at_rest if k is None else x[:, k]
            units[f"{joint}_{kind}"] = problem.units[joint] + per
    return Recording(time, measured, units=units, provenance=provenance)


def _checked(collisions: Collisions | None) -> str:
    """Result of the collision checks in words."""
    if collisions is None:
        return "not checked"
    pairs = collisions.pairs()
    on_floor = (
        "" if collisions.floor is None else f"; all geoms stay that far above the floor at {collisions.floor:g} m"
    )
    if pairs == 0 and not on_floor:
        return "not checked, because the model has no geoms that could collide with one another"
    return f"none; of {pairs} pairs of geoms none comes closer than {collisions.clearance:g} m{on_floor}"


def best(
    value: Cost,
    limits: Limits,
    starts: Sequence[FourierTrajectory],
    collisions: Collisions | None,
    iterations: int,
    seed: int,
) -> FourierTrajectory:
    """The best motion from several starts, and then from half as many near the best; prints progress to stderr.

    Collisions are only avoided for a motion that is better with them than the best one without so far. While no motion
    is found, the first start counts as the best.

    Args:
        value: Cost to minimize.
        limits: Joint limits.
        starts: Motions to start from.
        collisions: Bodies that must not touch; None for no checks.
        iterations: Largest number of iterations from each start.
        seed: Seed of the starts near the best.

    Raises:
        InputError: All motions collide.
    """
    rng, near = np.random.default_rng([seed, 1]), len(starts) // 2
    lowest, chosen, time = np.inf, None, np.linspace(0, starts[0].duration, 401)
    for k in tqdm(range(len(starts) + near), desc="Starts", file=sys.stderr):
        start = starts[k] if k < len(starts) else nearby_start(chosen or starts[0], limits, rng)
        trajectory = design(value, limits, start, collisions=collisions, iterations=iterations, below=lowest)
        if trajectory is not None and (reached := value(*trajectory.states(time))[0]) < lowest:
            lowest, chosen = reached, trajectory
    if chosen is None:
        assert collisions is not None
        raise InputError(f"No motion without collisions was found: {_collision(collisions, starts, limits)}.")
    return chosen


def _collision(collisions: Collisions, starts: Sequence[FourierTrajectory], limits: Limits) -> str:
    """Bodies that touch along the start with the fewest contacts, and what to do."""
    time = np.linspace(0, starts[0].duration, 401)
    pairs = min((collisions.touching(scaled_into(s, limits).states(time)[0]) for s in starts), key=len)
    named = ", ".join(f"'{a}' and '{b}'" for a, b in list(pairs)[:3]) or "bodies"
    return (
        f"{named} come closer than {collisions.clearance:g} m; to accept that, lower --clearance, exclude the pair in "
        "the model, or choose --collisions ignore"
    )


def start_motions(
    limits: Limits, rest: np.ndarray, duration: float, harmonics: int, count: int, seed: int
) -> list[FourierTrajectory]:
    """Random motions, the first one about the rest position (n,)."""
    rng = np.random.default_rng(seed)
    return [random_start(limits, duration, harmonics, rng, rest if k == 0 else None) for k in range(count)]
