"""Estimators that the study of noise compares, and their answers to a recording.

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

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
from scipy.interpolate import make_smoothing_spline

from docs.tools.noise.conditions import SUBJECTS, Condition, Subject, drives, truth
from docs.tools.noise.recordings import TOOL, noisy_recording, true_bodies
from experiments.studies.person_on_plates import USUAL
from ident.estimate import Estimate
from ident.identification import identify
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.model.regressor import base_wrench_regressor
from ident.payload import described
from ident.payload.beyond_sensor import identify_payload
from ident.recordings.recording import Recording
from ident.recordings.smoothing import chosen_cutoff, settling, smoothed
from ident.recordings.stated import model_servo
from ident.setup import SETUP
from sim.models.model_mechanism import Origin


def low_passed(mechanism: Mechanism, recording: Recording, cutoff: float | None = None) -> tuple[Motion, int]:
    """Angles and derivatives by a zero-phase Butterworth filter, and the samples that it takes to settle at each end.

    Args:
        mechanism: The mechanism.
        recording: Its joint angles.
        cutoff: Cut-off frequency, Hz, by default chosen from the angles.
    """
    q, rate = recording.of_joints(mechanism.tree.joints, "position"), recording.rate
    cutoff = chosen_cutoff(q, rate) if cutoff is None else cutoff
    return Motion(*smoothed(q, rate, cutoff)), settling(rate, cutoff)


def splined(mechanism: Mechanism, recording: Recording) -> tuple[Motion, int]:
    """Angles and derivatives by cubic smoothing splines, chosen by generalised cross-validation.

    Natural splines have no acceleration at the ends: half a second is to be left out there.
    """
    angles = recording.of_joints(mechanism.tree.joints, "position").T
    splines = [make_smoothing_spline(recording.time, q) for q in angles]
    q, dq, ddq = (np.stack([s.derivative(d)(recording.time) for s in splines], axis=1) for d in range(3))
    return Motion(q, dq, ddq), round(recording.rate / 2)


def instrumental(
    mechanism: Mechanism,
    kept: tuple[int, ...],
    recording: Recording,
    motion: Motion,
    instruments: Motion | None = None,
    edge: int = 0,
) -> tuple[np.ndarray, np.ndarray]:
    """Base parameters from the ground wrench by instrumental variables, channels weighted by their sensors' noise.

    Args:
        mechanism: The mechanism.
        kept: Columns of the regressor that the base parameters keep.
        recording: The ground wrench, with the covariance of its noise.
        motion: States of the regressor Y.
        instruments: States of the instruments Z, by default those of Y: least squares.
        edge: Samples to leave out at each end.

    Returns:
        Base parameters, and their standard deviations for residuals that are correlated within 50 samples, half a
            second (r,).
    """
    wrench = recording.wrench("ground")
    std = np.sqrt(np.diag(wrench.covariance)) if wrench.covariance is not None else np.ones(6)
    inside = slice(edge, len(motion) - edge)
    Y, Z = (_weighted(mechanism, kept, states[inside], std) for states in (motion, instruments or motion))
    measured = wrench.values[inside] / std
    normal = np.einsum("ncr,ncs->rs", Z, Y)
    psi = np.linalg.solve(normal, np.einsum("ncr,nc->r", Z, measured))
    pulls = np.einsum("ncr,nc->nr", Z, measured - Y @ psi)
    together = np.add.reduceat(pulls, np.arange(0, len(pulls), 50))
    spread = np.linalg.solve(normal, together.T)
    return psi, np.sqrt((spread**2).sum(axis=1))


def _weighted(mechanism: Mechanism, kept: tuple[int, ...], motion: Motion, std: np.ndarray) -> np.ndarray:
    """Columns of the regressor, each channel divided by its noise (N, 6, r)."""
    Y = base_wrench_regressor(mechanism.tree, *motion.states, gravity=mechanism.gravity)
    return Y[..., list(kept)] / std[:, None]


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
        stribeck = self.condition.stribeck
        rubs = self.condition.rubs or stribeck
        return drives(self.subject.mechanism, origin.model, stribeck=stribeck) if rubs else {}


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
    """States from a filter, by default a stronger one than with the usual cut-off."""
    return low_passed(case.subject.mechanism, case.recording, cutoff)


def cross_validated(case: Case) -> tuple[Motion, int]:
    """States from splines chosen by cross-validation."""
    return splined(case.subject.mechanism, case.recording)


def regressed(case: Case, states: States, instruments: States | None = None) -> Answer:
    """Answer by instrumental variables: the regressor at some states, the instruments at the same or at others."""
    who, (motion, edge), others = case.subject, states(case), None
    if instruments is not None:
        others, edge = instruments(case)
    psi, std = instrumental(who.mechanism, who.parameters.kept, case.recording, motion, others, edge)
    return Answer(who.parameters.names, psi, std, who.parameters.regroup(case.phi))


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
        "spline": partial(regressed, states=cross_validated),
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
