"""Biases and spreads of estimators with noisy sensors, friction and bad motions, and coverage of their intervals.

Others than the trajectory estimate are filters, splines and instrumental variables. Each estimates velocities and
accelerations first, and treats the regressor Y at these states as exact:

    ψ = (Zᵀ Y)⁻¹ Zᵀ Γ

Least squares has Z = Y. With instrumental variables, Z is the regressor at other states, whose noise should be
independent of Y's.

References:
    Janot, Vandanjon and Gautier, A Generic Instrumental Variable Approach for Industrial Robot Identification, IEEE
    Transactions on Control Systems Technology 22(1), 2014, doi:10.1109/TCST.2013.2246163.
    Woltring, A Fortran package for generalized, cross-validatory spline smoothing and differentiation, Advances in
    Engineering Software 8(2), 1986, doi:10.1016/0141-1195(86)90098-7.
"""

import argparse
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.interpolate import make_smoothing_spline

from docs.tools.noise_conditions import CONDITIONS, SUBJECTS, Condition, Subject, drives, truth
from docs.tools.noise_recordings import TOOL, noisy_recording, true_bodies
from experiments.cli import options, running
from experiments.data.fitting import Errors
from experiments.document import tabular
from experiments.document.result_folder import provenance
from experiments.document.writer import Document, write
from experiments.runs.workers import Checkpoint
from experiments.studies.person_on_plates import USUAL
from ident.errors import InputError
from ident.estimate import Estimate
from ident.identification import identify
from ident.mechanism.motion import Motion
from ident.model.regressor import base_wrench_regressor
from ident.payload import described
from ident.payload.beyond_sensor import identify_payload
from ident.recordings.recording import Recording
from ident.recordings.smoothing import chosen_cutoff, settling, smoothed
from ident.recordings.stated import model_servo
from ident.setup import SETUP
from sim.models.model_mechanism import Origin

FILE = "fits.npz"
"""File in the output folder with the fits of each recording."""

SERVOS = "lag", "scale"
"""Set-up parameters of servos, which are estimated beside their joints' drives."""


@dataclass(frozen=True, eq=False)
class Case:
    """One recording of a condition, and its truth.

    Attributes:
        condition: Motion and sensors.
        recording: The recording.
        phi: φ of its bodies (10 b,).
    """

    condition: Condition
    recording: Recording
    phi: np.ndarray

    @classmethod
    def drawn(cls, condition: Condition, seed: int, number: int) -> "Case":
        """Case of a condition, by the recording's number."""
        return cls(condition, noisy_recording(condition, seed, number), true_bodies(condition, seed, number))

    @property
    def subject(self) -> Subject:
        """The subject of the condition."""
        return SUBJECTS[self.condition.subject]

    @cached_property
    def drives(self) -> dict[str, float]:
        """True rotor inertia and friction of each joint; empty without friction."""
        origin = self.subject.mechanism.source
        assert isinstance(origin, Origin)
        model, stribeck = origin.model, self.condition.stribeck
        if not (self.condition.rubs or stribeck):
            return {}
        by_euler = self.condition.rubs and "commands" not in self.condition.sensors
        delay = model.opt.timestep / 2 if by_euler else 0.0
        return drives(self.subject.mechanism, model, stribeck=stribeck, delay=delay)


@dataclass(frozen=True, eq=False)
class Answer:
    """An estimate of a case, beside its truth.

    Attributes:
        names: Names of base parameters, drives and servos' lag and scales, or of a payload's mass and centre of mass.
        values: Their estimates (p,).
        std: Standard deviations from noise alone (p,).
        true: True values (p,).
        std_setup: Standard deviations including the set-up (p,); None for estimators without a set-up.
        setup: Names of the set-up errors that it reports.
    """

    names: tuple[str, ...]
    values: np.ndarray
    std: np.ndarray
    true: np.ndarray
    std_setup: np.ndarray | None = None
    setup: tuple[str, ...] = ()

    def to_dict(self) -> dict[str, Any]:
        """Everything in JSON types, with errors in place of the values."""
        wide = None if self.std_setup is None else self.std_setup.tolist()
        out = {"error": (self.values - self.true).tolist(), "std": self.std.tolist(), "true": self.true.tolist()}
        return {"names": list(self.names), **out, "std_setup": wide, "setup": list(self.setup)}


def identified(case: Case, estimator: str, cutoff: str | None = None) -> Answer:
    """Answer of `ident.identify`, from all samples and, unless the condition says otherwise, without offsets."""
    options = {"offsets": False, "holdout": 0.0, **(case.condition.options if estimator == "trajectory" else {})}
    arm = case.subject.mechanism
    estimate = identify(arm, case.recording, estimator=estimator, cutoff=cutoff, **options)
    equations = estimate.fit.equations
    count = equations.parameters.rank + len(equations.drives)
    names, (values, std, wider, true) = _of_servos(case, estimate)
    wide = np.sqrt(np.diag(estimate.covariance_setup))[:count]
    return Answer(
        names=(*equations.names[:count], *names),
        values=np.r_[estimate.fit.values[:count], values],
        std=np.r_[estimate.fit.std[:count], std],
        true=np.r_[truth(equations, case.phi, case.drives), true],
        std_setup=np.r_[wide, wider] if estimator == "trajectory" else None,
        setup=tuple(deviation.name for deviation in estimate.setup if not SETUP[deviation.kind].stated),
    )


def _of_servos(case: Case, estimate: Estimate) -> tuple[list[str], np.ndarray]:
    """Names of the lag and the scales of servos; estimates, standard deviations as in `Answer`, and true values (4, k).

    Of a lag that is not fitted, the estimate is what it would be if it were.
    """
    joint, stated = estimate.trajectory, case.recording.servos
    if joint is None or not stated:
        return [], np.zeros((4, 0))
    own = {k: each for k, each in joint.setup.items() if each.kind in SERVOS}
    at, fit = list(own), joint.fit
    moves, open_ = fit.scores(np.eye(len(fit.theta))[at])
    fitted = fit.theta, *(np.sqrt(np.diag(C)) for C in (fit.covariance, fit.covariance + joint.covariance_of_setup))
    estimates = np.where(fit.free[at], np.array(fitted)[:, at], [moves, open_, open_])
    model = {each: model_servo(case.subject.mechanism, each) for each in stated}
    true = {each: stated[each].kp / servo.kp - 1 for each, servo in model.items() if servo is not None}
    # A lag is that of all joints, and zero.
    return [x.name for x in own.values()], np.vstack([estimates, [true.get(x.of, 0.0) for x in own.values()]])


def carried(case: Case) -> Answer:
    """Mass and centre of mass of the tool on its sensor, by `ident.payload`, from a robot without masses."""
    robot = case.subject.mechanism
    massless = replace(robot, prior=0 * robot.known)
    body = identify_payload(massless, case.recording, body=TOOL, sensor=TOOL, holdout=0.0, **case.condition.options)
    k = 10 * robot.bodies.index(TOOL)
    true = described(case.phi[k : k + 10])[:4]
    names = ("mass", *(f"centre({axis})" for axis in "xyz"))
    load = body.in_frame()
    setup = tuple(each.name for each in body.estimate.setup)
    return Answer(names, load.values[:4], load.std[:4], true, load.std_setup[:4], setup)


States = Callable[[Case], tuple[Motion, int]]
"""States of a case, and samples to leave out at each end."""


def measured(case: Case) -> tuple[Motion, int]:
    """The measured states."""
    return Motion(*case.recording.joint_states(case.subject.mechanism.tree.joints)), 0


def commanded(case: Case) -> tuple[Motion, int]:
    """The commanded states, which are free of noise; a person has none."""
    return case.subject.commanded, 0


def filtered(case: Case, cutoff: float | None = None) -> tuple[Motion, int]:
    """States by a zero-phase Butterworth filter with a cut-off in Hz, by default chosen from the angles."""
    recording = case.recording
    q, rate = recording.of_joints(case.subject.mechanism.tree.joints, "position"), recording.rate
    cutoff = chosen_cutoff(q, rate) if cutoff is None else cutoff
    return Motion(*smoothed(q, rate, cutoff)), settling(rate, cutoff)


def splined(case: Case) -> tuple[Motion, int]:
    """States by cubic smoothing splines, chosen by generalised cross-validation.

    Natural splines have no acceleration at the ends: half a second is to be left out there.
    """
    recording = case.recording
    angles = recording.of_joints(case.subject.mechanism.tree.joints, "position").T
    splines = [make_smoothing_spline(recording.time, q) for q in angles]
    q, dq, ddq = (np.stack([s.derivative(d)(recording.time) for s in splines], axis=1) for d in range(3))
    return Motion(q, dq, ddq), round(recording.rate / 2)


def regressed(case: Case, states: States, instruments: States | None = None) -> Answer:
    """Answer by instrumental variables, channels of the ground wrench weighted by their sensors' noise.

    Standard deviations are for residuals that are correlated within 50 samples, half a second.

    Args:
        case: The case.
        states: States of the regressor Y.
        instruments: States of the instruments Z, by default those of Y: least squares.
    """
    who, wrench = case.subject, case.recording.wrench("ground")
    std = np.sqrt(np.diag(wrench.covariance)) if wrench.covariance is not None else np.ones(6)
    (motion, edge), (others, end) = states(case), (instruments or states)(case)
    inside = slice(max(edge, end), len(motion) - max(edge, end))

    def weighted(motion: Motion) -> np.ndarray:
        Y = base_wrench_regressor(who.mechanism.tree, *motion[inside].states, gravity=who.mechanism.gravity)
        return Y[..., list(who.parameters.kept)] / std[:, None]

    Y, Z, measured = weighted(motion), weighted(others), wrench.values[inside] / std
    normal = np.einsum("ncr,ncs->rs", Z, Y)
    psi = np.linalg.solve(normal, np.einsum("ncr,nc->r", Z, measured))
    pulls = np.einsum("ncr,nc->nr", Z, measured - Y @ psi)
    spread = np.linalg.solve(normal, np.add.reduceat(pulls, np.arange(0, len(pulls), 50)).T)
    return Answer(who.parameters.names, psi, np.sqrt((spread**2).sum(axis=1)), who.parameters.regroup(case.phi))


Estimator = Callable[[Case], Answer]

USUALLY_FILTERED = partial(filtered, cutoff=USUAL)

TRAJECTORY: Mapping[str, Estimator] = {"trajectory": partial(identified, estimator="trajectory")}

ESTIMATORS: Mapping[str, Mapping[str, Estimator]] = {
    "pendulum": {
        "ordinary": partial(identified, estimator="ordinary"),
        "weighted": partial(identified, estimator="weighted"),
        "instruments": partial(regressed, states=measured, instruments=commanded),
        **TRAJECTORY,
    },
    "person": {
        "usual_filter": partial(regressed, states=USUALLY_FILTERED),
        "instruments": partial(regressed, states=USUALLY_FILTERED, instruments=filtered),
        "spline": partial(regressed, states=splined),
        "chosen_filter": partial(identified, estimator="weighted", cutoff="auto"),
        **TRAJECTORY,
    },
    "arm": TRAJECTORY,
    "payload": {"trajectory": carried},
}
"""Estimators that are compared, for each subject."""

LABELS = {
    "ordinary": "ordinary least squares",
    "weighted": "weighted by channel",
    "usual_filter": "cut-off at 6 Hz",
    "chosen_filter": "cut-off from the data",
    "spline": "cross-validated spline",
    "instruments": "instrumental variables",
    "trajectory": "trajectory estimate",
}
"""Labels of the estimators in tables and figures."""

Answers = Mapping[tuple[str, str], Sequence[Mapping[str, Any]]]
"""`Answer.to_dict` of all recordings, or refusals, by condition and estimator."""

ALL = "all"
"""Kind of the rows of all parameters."""


def fits(seed: int, task: tuple[int, str]) -> dict[str, Any]:
    """`Answer.to_dict` of each estimator, or its error, for a recording's number and a condition."""
    number, name = task
    case, outcome = Case.drawn(CONDITIONS[name], seed, number), {}
    estimators = ESTIMATORS[case.condition.subject]
    for key in estimators if case.condition.compared else ("trajectory",):
        try:
            outcome[key] = estimators[key](case).to_dict()
        except InputError as error:
            outcome[key] = {"refused": str(error)}
    return outcome


def by_estimator(todo: Sequence[tuple[int, str]], outcomes: Sequence[Mapping[str, Any]]) -> Answers:
    """Answers of all tasks; one with other parameters than the first is a refusal."""
    gathered: dict[tuple[str, str], list[Mapping[str, Any]]] = {}
    for (_, name), outcome in zip(todo, outcomes, strict=True):
        for key, answer in outcome.items():
            before = gathered.setdefault((name, key), [])
            first = next((each for each in before if "names" in each), answer)
            alike = "refused" in answer or answer["names"] == first["names"]
            before.append(answer if alike else {"refused": "It identifies other parameters than the first recording."})
    return gathered


def answered(answers: Answers) -> Iterator[tuple[str, str, list[Mapping[str, Any]], int]]:
    """Condition, estimator, answers and number of refusals, where there are two answers or more."""
    for (name, key), every in answers.items():
        given = [each for each in every if "refused" not in each]
        if len(given) > 1:
            yield name, key, given, len(every) - len(given)


def errors_of(given: Sequence[Mapping[str, Any]]) -> tuple[Errors, Errors | None]:
    """Errors beside standard deviations from noise alone, and beside those with the set-up if there are any."""
    names, error = tuple(given[0]["names"]), np.array([each["error"] for each in given])
    wide = None if given[0]["std_setup"] is None else np.array([each["std_setup"] for each in given])
    noise = Errors(names, error, np.array([each["std"] for each in given]))
    return noise, None if wide is None else Errors(names, error, wide)


def table_coverage(answers: Answers) -> tabular.Table:
    """Coverage of 95 % intervals, normalized errors, biases and reported set-up, of all parameters and by kind."""
    rows: list[tuple[tabular.Cell, ...]] = []
    for name, key, given, refused in answered(answers):
        errors, wide = errors_of(given)
        bias, reported = errors.mean / errors.std, float(np.mean([bool(each["setup"]) for each in given]))
        kinds = np.array([_kind(each) for each in errors.names])
        for kind in (ALL, *(dict.fromkeys(kinds.tolist()) if len({*kinds}) > 1 else ())):
            of = (kinds == kind) | (kind == ALL)
            coverage = errors.coverage[of]
            cells: list[tabular.Cell] = [CONDITIONS[name].subject, CONDITIONS[name].label, LABELS[key], kind]
            cells += [float(coverage.mean()), float(coverage.min())]
            cells += [None if wide is None else float(wide.coverage[of].mean())]
            cells += [_rms(errors.errors[:, of], errors.predicted[:, of])]
            cells += [_rms(errors.errors[:, of], errors.predicted_std[of]), reported]
            rows.append(
                (*cells, float(np.sqrt((bias[of] ** 2).mean())), float(abs(bias[of]).max()), len(given), refused)
            )
    columns = (
        *("subject", "noise", "estimator", "kind", "coverage_95", "lowest_coverage_95", "setup_coverage_95", "rms_z"),
        *("error_over_std", "setup_reported", "bias_rms", "largest_bias", "recordings", "refused"),
    )
    return tabular.Table("Coverage of 95 % intervals, by noise alone and with the set-up", columns, tuple(rows))


def _rms(errors: np.ndarray, std: np.ndarray) -> float | None:
    """RMS of errors over standard deviations; None if one of these is zero."""
    return float(np.sqrt(np.mean((errors / std) ** 2))) if std.all() else None


def _kind(name: str) -> str:
    """Kind of a parameter: that of a drive, of a servo or of a payload, or `base parameter`."""
    kind, bracket, _ = name.partition("(")
    return kind if bracket or kind in (*SERVOS, "mass") else "base parameter"


def table_parameters(answers: Answers) -> tabular.Table:
    """Bias, RMS error, spread, predicted standard deviation and coverage of every parameter."""
    rows: list[tuple[tabular.Cell, ...]] = []
    for name, key, given, _ in answered(answers):
        errors, _ = errors_of(given)
        true = np.mean([each["true"] for each in given], axis=0)
        rms = np.sqrt((errors.errors**2).mean(axis=0))
        numbers = np.stack([true, errors.mean, rms, errors.std, errors.predicted_std, errors.coverage])
        labels = CONDITIONS[name].label, LABELS[key]
        rows += [(*labels, each, *numbers[:, k].tolist()) for k, each in enumerate(errors.names)]
    columns = ("noise", "estimator", "parameter", "true", "bias", "rms_error", "spread", "predicted", "coverage_95")
    return tabular.Table("Errors of all parameters, SI units", columns, tuple(rows), decimals=5)


def reported(answers: Answers) -> dict[str, dict[str, int]]:
    """Number of recordings in which each set-up error is reported, by condition."""
    return {
        name: dict(Counter(each for answer in given for each in answer["setup"]))
        for name, key, given, _ in answered(answers)
        if key == "trajectory"
    }


def run(args: argparse.Namespace) -> None:
    """Identifies all recordings, and writes and prints the results."""
    if unknown := [name for name in args.conditions or () if name not in CONDITIONS]:
        raise InputError(f"Conditions are {', '.join(CONDITIONS)}; got '{unknown[0]}'.")
    chosen = {name: asdict(CONDITIONS[name]) for name in CONDITIONS if name in (args.conditions or CONDITIONS)}
    identity = {"seed": args.seed, "conditions": chosen}
    args.out.mkdir(parents=True, exist_ok=True)
    todo = [(number, name) for number in range(args.recordings) for name in chosen]
    kept = Checkpoint("fits", args.out / FILE, identity)
    outcomes = options.workers_of(args).collected(partial(fits, args.seed), todo, kept)
    answers = by_estimator(todo, outcomes)
    tables = {"table_coverage": table_coverage(answers), "table_parameters": table_parameters(answers)}
    origin = provenance({**identity, "recordings": args.recordings})
    numbers = {"summary": {"setup_reported": reported(answers)}, "provenance": origin}
    document = Document(
        "Bad motions and sensors", tables=tables, numbers=numbers, screen=tables["table_coverage"].text()
    )
    write(document, options.output_of(args))


OPTIONS: options.Options = {
    **options.output("results/noise"),
    "--seed": ("seed of all noise", {"type": int, "default": 0}),
    "--recordings": ("recordings of each condition", {"type": options.whole_number(2), "default": 5}),
    "--conditions": ("rows of CONDITIONS, by default all", {"nargs": "+", "metavar": "NAME"}),
    **options.WORKERS,
}
"""Options of the command."""

parser, main = running.command(__name__, "docs.tools.noise", __doc__, run, OPTIONS)
