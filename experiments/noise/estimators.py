"""Estimators that the study of noise compares, and their answers to a recording."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import numpy as np

from experiments.noise.conditions import SUBJECTS, Condition, Subject
from experiments.noise.recordings import noisy_recording, true_bodies
from experiments.noise.truth import drives, truth
from experiments.studies import competitors
from ident.identification import identify
from ident.mechanism.motion import Motion
from ident.recordings.recording import Recording
from sim.models.mechanism import Origin


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
        return drives(self.subject.mechanism, origin.model) if self.condition.rubs else {}


@dataclass(frozen=True, eq=False)
class Answer:
    """An estimate of a case, beside its truth.

    Attributes:
        names: Names of base parameters and drives.
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
    return Answer(
        names=equations.names[:count],
        values=estimate.fit.values[:count],
        std=estimate.fit.std[:count],
        true=truth(equations, case.phi, case.drives),
        std_setup=np.sqrt(np.diag(estimate.covariance_setup))[:count] if estimator == "trajectory" else None,
        setup=tuple(deviation.name for deviation in estimate.setup),
    )


def commanded_instruments(case: Case) -> Answer:
    """Instrumental variables: the regressor at measured states, the instruments at the commanded ones."""
    who = case.subject
    motion = Motion(*case.recording.joint_states(who.mechanism.tree.joints))
    return _instrumental(case, motion, who.commanded)


def usual_filter(case: Case) -> Answer:
    """Least squares at states from a filter with the usual cut-off."""
    motion, edge = competitors.low_passed(case.subject.mechanism, case.recording, competitors.USUAL)
    return _instrumental(case, motion, edge=edge)


def filtered_instruments(case: Case) -> Answer:
    """Instrumental variables: the regressor at those states, the instruments at more strongly filtered states.

    A person has no commanded motion from which noise-free instruments could be simulated.
    """
    motion, _ = competitors.low_passed(case.subject.mechanism, case.recording, competitors.USUAL)
    instruments, edge = competitors.low_passed(case.subject.mechanism, case.recording)
    return _instrumental(case, motion, instruments, edge)


def cross_validated(case: Case) -> Answer:
    """Least squares at states from splines chosen by cross-validation."""
    motion, edge = competitors.splined(case.subject.mechanism, case.recording)
    return _instrumental(case, motion, edge=edge)


def _instrumental(case: Case, motion: Motion, instruments: Motion | None = None, edge: int = 0) -> Answer:
    """Answer of `competitors.instrumental`."""
    who = case.subject
    kept = who.parameters.kept
    psi, std = competitors.instrumental(who.mechanism, kept, case.recording, motion, instruments, edge)
    return Answer(who.parameters.names, psi, std, who.parameters.regroup(case.phi))


Estimator = Callable[[Case], Answer]

TRAJECTORY: Mapping[str, Estimator] = {"trajectory": partial(identified, estimator="trajectory")}

ESTIMATORS: Mapping[str, Mapping[str, Estimator]] = {
    "pendulum": {
        "ordinary": partial(identified, estimator="ordinary"),
        "weighted": partial(identified, estimator="weighted"),
        "instruments": commanded_instruments,
        **TRAJECTORY,
    },
    "person": {
        "usual_filter": usual_filter,
        "instruments": filtered_instruments,
        "spline": cross_validated,
        "chosen_filter": partial(identified, estimator="weighted", cutoff="auto"),
        **TRAJECTORY,
    },
    "arm": TRAJECTORY,
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
