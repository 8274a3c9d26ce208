"""Identification of base parameters from a mechanism and recordings, by one of several estimators."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from concurrent.futures import Executor
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

from ident.annotations import typed
from ident.arguments import by_joint, check_holdout, checked_deviations, checked_names, described
from ident.errors import InputError
from ident.estimate import Estimate
from ident.estimation.preparation import Prepared, prepared
from ident.estimators import least_squares
from ident.estimators.trajectory import trajectory
from ident.files.readers import TYPES, InMemory, kind_of
from ident.judgement.unmodelled import without_unmeasured
from ident.mechanism.mechanism import Mechanism
from ident.parameters.prior import KNOWN
from ident.problem import Problem, problem_of
from ident.recordings.log import read_log
from ident.recordings.recording import Recording
from ident.setup import LARGEST, OWN, PRIORS, SETUP
from ident.tolerances import HOLDOUT
from ident.trajectory.fit.iteration import Report

Source: TypeAlias = Recording | str | Path | InMemory
"""A recording, or what `read_log` reads."""


class Estimator(NamedTuple):
    """An estimator.

    Attributes:
        estimate: Function that solves a problem.
        filters: True if it takes low-passed states as exact; else it estimates the motion from joint coordinates.
    """

    estimate: Callable[[Problem], Estimate]
    filters: bool


ESTIMATORS = {
    "trajectory": Estimator(trajectory, filters=False),
    "weighted": Estimator(least_squares.weighted, filters=True),
    "ordinary": Estimator(least_squares.ordinary, filters=True),
}
"""All estimators by name."""

FORMER = {"joint": "trajectory"}
"""Former names of estimators, which are still accepted."""

NO_CUTOFF = "The trajectory estimate filters nothing: --cutoff belongs to --estimator weighted or ordinary."


def checked_estimator(name: str) -> str:
    """Name of an estimator.

    Raises:
        InputError: There is none of that name.
    """
    name = FORMER.get(name, name)
    if name not in ESTIMATORS:
        raise InputError(f"An estimator is one of {', '.join(ESTIMATORS)}, got '{name}'.")
    return name


def check_choices(
    estimator: str, *, own: Sequence[str] = (), physical: bool = False, setup: Mapping[str, float] | None = None
) -> None:
    """Refuses what the trajectory estimate alone can do, for other estimators; arguments as for `identified`.

    Raises:
        InputError: It is asked of another one.
    """
    if not ESTIMATORS[checked_estimator(estimator)].filters:
        return
    if own:
        raise InputError(f"Only the trajectory estimate gives recordings {' and '.join(own)} of their own.")
    if physical:
        raise InputError("Only the trajectory estimate can be held to physical bodies.")
    if uncertain := [kind for kind, std in (setup or {}).items() if std]:
        raise InputError(
            f"Only the trajectory estimate takes the set-up as uncertain; for estimator '{estimator}' leave out "
            f"{', '.join(uncertain)} in setup, or state zero."
        )


def checked_setup(given: Any, joints: Iterable[str]) -> dict[str, float]:
    """Standard deviations of set-up errors by kind, zero for what is exact; of single joints as `centre(elbow)`.

    Raises:
        InputError: They are malformed, or one is given to scales of torques, which have their own by joint.
    """
    choices = (*PRIORS, *(f"centre({joint})" for joint in joints))
    setup = checked_deviations("setup", by_joint(given, "centre"), choices, most=LARGEST)
    for kind, std in setup.items():
        if std and kind in SETUP and SETUP[kind].stated:
            raise InputError(
                f"setup.{kind} needs zero or false for exact torques, got {std:g}: how uncertain a torque's scale is "
                "belongs to its joint (torque_std or kp_std of the columns file, scales of a Recording)."
            )
    return setup


def _as_stated(log: Prepared, setup: Mapping[str, float]) -> Prepared:
    """Recording whose stated set-up is exact where `setup` is zero."""
    recording = replace(log.recording, setup={**log.recording.setup, **setup})
    scales = log.equations.scales if setup.get("scale", 1.0) else ()
    return replace(log, recording=recording, equations=replace(log.equations, scales=scales))


@typed("recording", "held_out", "drive", "own", "setup", "known", "holdout", "columns")
def identify(
    mechanism: Mechanism,
    recording: Source | Iterable[Source],
    *,
    columns: str | Path | Mapping[str, Any] | None = None,
    estimator: str = "trajectory",
    cutoff: str | float | None = None,
    drive: Sequence[str] | None = None,
    leave_out: Sequence[str] = (),
    offsets: bool = True,
    holdout: float = HOLDOUT,
    held_out: Source | Iterable[Source] = (),
    own: Sequence[str] = (),
    setup: Mapping[str, float] | None = None,
    known: Mapping[str, float] | bool | None = None,
    physical: bool = False,
) -> Estimate:
    """Base parameters of a mechanism from recordings, judged on samples that were not fitted.

    Args:
        mechanism: The mechanism, with a prior, from `sim.mechanism`.
        recording: Joint states and wrenches, torques or commands: a `Recording`, the path of a log, or columns in
            memory as for `read_log`; or a list of these, which share their parameters.
        columns: For logs: TOML file that maps their columns, or its content, as for `read_log`.
        estimator: `trajectory` for motion, parameters, set-up and noise at once, from joint angles; `weighted` for
            least squares with states taken as exact, channels weighted by their residuals and outliers weighted down;
            `ordinary` for the least squares of the paper.
        cutoff: Cut-off of the low-pass for least squares in Hz, `auto`, or None for the recording's own velocities and
            accelerations. The trajectory estimate has none, and uses joint coordinates alone.
        drive: Columns of drives for joint torques, out of `rotor`, `viscous`, `coulomb`, `stribeck` and `spring`; by
            default rotor inertia, viscous and Coulomb friction of all joints, the springs that the model has, and in
            the trajectory estimate Stribeck friction where recordings ask for it. The model's values are a prior where
            its bodies are one. An empty list fits the links alone.
        leave_out: Channels that are neither fitted nor judged, as `Fz`, `Mx` and `My` of a model that moves in the
            plane normal to z; joints' names for joint torques.
        offsets: True to fit a constant offset of every channel for which it can be separated from the parameters.
        holdout: Fraction of each recording, its end, that is not fitted but predicted, from 0 to below 1. With zero the
            fit is judged on the fitted samples. Of three recordings or more the trajectory estimate fits all samples,
            and predicts each from the rest.
        held_out: Other recordings to judge by, as for `recording`; then all others are fitted whole.
        own: Parameters that each recording has separately in the trajectory estimate: `offset`, `friction`,
            `delay`, `lag`, `torque_delay`, `tracker_delay`.
        setup: Standard deviations of set-up errors in the trajectory estimate by their kinds, in SI units and radians,
            as `{"delay": 0.01, "gain": 0.0}`, of joints' centres by joint, too, as `{"centre": {"knee": 0.02}}`; zero
            for what is exactly as stated. By default those of the recording, else `ident.setup.PRIORS`. Of `scale`,
            only zero: each joint's torque has its own, in the recording.
        known: Standard deviations of the model's bodies in the trajectory estimate, as `{"mass": 0.1, "center": 0.02,
            "inertia": 0.3}` (relative, m, relative); True for the default, False for no prior, None for the default
            where the motion does not separate all parameters or left-out pieces are predicted better with it.
        physical: True if the trajectory estimate's bodies must be physical, as close to the model's as the recordings
            allow; by default only those of `Estimate.consistent` are.

    Raises:
        InputError: Something is missing or does not fit; the message names it.
        ExcitationError: The motion does not separate the base parameters.
    """
    estimator = checked_estimator(estimator)
    if not ESTIMATORS[estimator].filters and cutoff is not None:
        raise InputError(NO_CUTOFF)
    options: dict[str, Any] = {"cutoff": cutoff, "drive": drive, "leave_out": leave_out}
    options |= {"filters": ESTIMATORS[estimator].filters}
    if columns is not None and _is_recorded(recording) and _is_recorded(held_out):
        raise InputError("columns maps the columns of logs, but every recording here is a Recording; leave it out.")
    logs, judges = (
        [prepared(mechanism, each, **options) for each in _recordings(where, given, mechanism, columns)]
        for where, given in (("recording", recording), ("held_out", held_out))
    )
    return identified(
        logs,
        estimator=estimator,
        offsets=offsets,
        holdout=holdout,
        judges=judges,
        own=own,
        setup=setup,
        known=known,
        physical=physical,
    )


def identified(
    logs: Prepared | Sequence[Prepared],
    *,
    estimator: str = "trajectory",
    offsets: bool = True,
    holdout: float = HOLDOUT,
    judges: Sequence[Prepared] = (),
    own: Sequence[str] = (),
    setup: Mapping[str, float] | None = None,
    known: Mapping[str, float] | bool | None = None,
    physical: bool = False,
    executor: Executor | None = None,
    report: Report | None = None,
) -> Estimate:
    """Fits recordings and judges the fit on held-out samples.

    Args:
        logs: Mechanism and recording, one or several.
        estimator: As for `identify`; so are `offsets`, `holdout`, `own`, `setup`, `known` and `physical`.
        judges: Other recordings of the same channels to judge by, of any length; then all logs are fitted whole.
        executor: Executor for the pieces of the trajectory estimate.
        report: Called with every round of the trajectory estimate, and its step in standard deviations.

    Raises:
        ExcitationError: The motion does not separate the base parameters.
        InputError: A recording is too short, or has other channels than the first.
    """
    estimator = checked_estimator(estimator)
    check_holdout(holdout)
    own = checked_names("own", own, OWN)
    beforehand = {} if known is None or isinstance(known, bool) else checked_deviations("known", known, KNOWN)
    logs = [logs] if isinstance(logs, Prepared) else list(logs)
    if not logs:
        raise InputError("An identification needs at least one recording, got none.")
    if carried := [log.recording.loaded for log in (*logs, *judges) if log.recording.loaded]:
        raise InputError(
            f"A log states a load on '{carried[0]}', under [load] in its columns file: `payload` (in Python "
            "`identify_load`) identifies it beside logs without it."
        )
    # Channels of torques come last; those of commanded joints are not measured.
    torques = [k >= len(x.channels) - len(x.torques) for x in (log.equations for log in logs) for k in x.sensed]
    for kind, has, what in (
        ("lag", any(log.recording.servos for log in logs), "commands"),
        ("torque_delay", any(torques), "joint torques"),
        ("tracker_delay", any(log.recording.trackers for log in logs), "tracked bodies"),
    ):
        if kind in own and not has:
            raise InputError(f"own has {kind}, but no recording has {what}; leave it out.")
    if "offset" in own and not offsets:
        raise InputError("own has offset, but no offsets are fitted (offsets, --no-offsets); leave one of them out.")
    tree, setup = logs[0].mechanism.tree, {} if setup is None else setup
    setup, stated = (checked_setup(each, tree.compounds) for each in (setup, logs[0].recording.setup))
    if "centre" in setup:
        stated = {name: std for name, std in stated.items() if not name.startswith("centre(")}
    logs, judges = ([without_unmeasured(log) for log in several] for several in (logs, judges))
    check_choices(estimator, own=own, physical=physical, setup=setup)
    if ESTIMATORS[estimator].filters:
        logs = [_as_stated(log, setup) for log in logs]
    else:
        # Without a filter no ends are left out.
        logs, judges = ([replace(log, cutoff=None) for log in several] for several in (logs, judges))
        holdout = 0.0 if len(logs) > 2 and not judges else holdout
    recording = logs[0].recording
    if recording.still and not ESTIMATORS[estimator].filters:
        raise InputError("Poses at rest have no trajectory: fit them by estimator='weighted' (--estimator weighted).")
    problem = problem_of(
        logs,
        holdout,
        judges,
        alone=not ESTIMATORS[estimator].filters,
        offsets=offsets,
        known={**KNOWN, **checked_deviations("known", recording.known, KNOWN), **beforehand},
        # Who states what is known of single bodies asks for it.
        wanted=bool(recording.known_bodies) or None if known is None else bool(known),
        setup={**stated, **setup},
        own=own,
        physical=physical,
        executor=executor,
        report=report,
    )
    return ESTIMATORS[estimator].estimate(problem)


def _recordings(where: str, given: Any, mechanism: Mechanism, columns: Any) -> list[Recording]:
    """Recordings as a list, logs and columns in memory read."""
    if _is_one(given):
        return [_recording(given, mechanism, columns)]
    needed = f"a Recording, the path of a log, {TYPES}"
    if isinstance(given, Estimate) or not isinstance(given, Iterable):
        raise InputError(f"{where} needs {needed}, or a list; got {described(given)}.")
    several = list(given)
    for k, each in enumerate(several):
        if not _is_one(each):
            raise InputError(f"{where}[{k}] needs {needed}; got {described(each)}.")
    return [_recording(each, mechanism, columns) for each in several]


def _is_recorded(given: Any) -> bool:
    """True if nothing is read: a recording, a list of such, or an empty one."""
    return isinstance(given, Recording) or (
        isinstance(given, Sequence) and all(isinstance(each, Recording) for each in given)
    )


def _is_one(given: Any) -> bool:
    """True for a recording and for what may be read as one."""
    return isinstance(given, Recording | str | Path | Mapping) or hasattr(given, "columns")


def _recording(given: Any, mechanism: Mechanism, columns: Any) -> Recording:
    """A recording, or one that is read, with a note on what it is."""
    if isinstance(given, Recording):
        return given
    read = read_log(given, mechanism, columns)
    name = str(given) if isinstance(given, str | Path) else f"the {kind_of(given)}"
    unused = f"; not used: {', '.join(read.unused[:12])}" if read.unused else ""
    note = f"Read {name}: {len(read.time)} samples at {read.rate:.4g} Hz of {', '.join(read.measured)}{unused}."
    return replace(read, notes=(note, *read.notes))
