"""All judges of an estimate, and the verdict: decided by channels and codes of findings, then put into words."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum
from typing import Any, Self

import numpy as np

from ident.display.brief import Worded, rounded
from ident.estimation.equations import COMPONENTS
from ident.geometry.inertia import with_bodies
from ident.judgement import fit_findings as fit
from ident.judgement import mass_findings as masses
from ident.judgement import recording_findings as recorded
from ident.judgement import torque_findings as torques
from ident.judgement.evidence import Evidence
from ident.judgement.finding import Finding, doubts_first
from ident.judgement.fit_findings import Candidates, candidate_findings
from ident.judgement.mass_findings import Mass, estimated_mass
from ident.judgement.unmodelled import unmodelled_findings
from ident.judgement.wording import CANDIDATES, listed, number_of
from ident.tolerances import NAMED, POOR, UNEXPLAINED

PRECISIONS = 0.1, 0.2, 0.5
"""Relative standard deviations up to which parameters are counted as known."""

BEHIND = "worse_than_candidate", "candidate_better"
"""Codes of findings that another candidate predicts better, clearly, which is a doubt, or somewhat."""

IDLE = {
    "plane": "out of the plane that the model moves in",
    "still": "the model does not change it",
    "noise": "noise alone is left",
    "rest": "the joint rests",
}
"""Reasons for which channels that are not predicted do not count, in words."""


class Outcome(Enum):
    """Decision on an estimate."""

    USABLE = "usable"
    PARTLY = "partly"
    NOT = "not"

    @property
    def word(self) -> str:
        """The decision in a word."""
        return "unusable" if self is Outcome.NOT else str(self.value)


@dataclass(frozen=True)
class Precision:
    """Precision of base parameters and masses.

    Attributes:
        total: Number of base parameters.
        known: Numbers of those whose standard deviation is within each of `PRECISIONS` of the value.
        wider: Names of those whose deviation the uncertainty of the set-up more than doubles.
        bodies: Names of the bodies.
        weighed: Names of the bodies whose own mass is a base parameter, known within the last of `PRECISIONS`.
        mass: The whole mass, if the base parameters determine it.
    """

    total: int
    known: tuple[int, ...]
    wider: tuple[str, ...]
    bodies: tuple[str, ...]
    weighed: tuple[str, ...] = ()
    mass: Mass | None = None

    @classmethod
    def of(cls, evidence: Evidence) -> Self:
        """The precision of an estimate."""
        base, bodies, sizes = evidence.fit.parameters, evidence.mechanism.bodies, np.abs(evidence.fit.psi)
        covariances = evidence.covariance, evidence.covariance_setup
        std, wide = (np.sqrt(np.maximum(np.diag(each)[: base.rank], 0)) for each in covariances)
        known = tuple(int((wide <= share * sizes).sum()) for share in PRECISIONS)
        alone = ~base.beta.any(axis=1) & (wide <= PRECISIONS[-1] * sizes)
        weighed = (bodies[k // 10] for k, own in zip(base.kept, alone, strict=True) if own and k % 10 == 0)
        wider = tuple(np.array(base.names)[wide > 2 * std].tolist())
        return cls(base.rank, known, wider, bodies, tuple(weighed), estimated_mass(evidence))

    @property
    def poor(self) -> bool:
        """True if less than a third of the base parameters are known within 20 %, so that single ones are of no use.

        Of many mechanisms half are zero by symmetry and thus known within no share.
        """
        return self.known[1] < self.total / 3

    def sentences(self) -> Iterator[str]:
        """Yields sentences on the number of known parameters, on masses, and on what the set-up makes uncertain."""
        counts = ", ".join(f"{n} within {100 * share:.0f} %" for n, share in zip(self.known, PRECISIONS, strict=True))
        yield f"Of {self.total} base parameters it knows {counts}."
        yield self._of_masses()
        if self.wider:
            many = len(self.wider) > NAMED
            names = f"{len(self.wider)} of them" if many else with_bodies(self.wider, self.bodies)
            yield f"The uncertain set-up more than doubles the standard deviations of {names}."

    def _of_masses(self) -> str:
        """Sentence on the masses that are determined."""
        if self.weighed:
            return f"It determines the mass of {listed(self.weighed, f'of {len(self.bodies)} bodies')}."
        if self.mass is not None and self.mass.std_setup <= PRECISIONS[-1] * abs(self.mass.value):
            value, std = rounded(self.mass.value, self.mass.std_setup)
            return f"It determines the whole mass, {value} ± {std} kg, but no single ones."
        return "Single masses are not determined."


@dataclass(frozen=True, kw_only=True, repr=False)
class Verdict(Worded):
    """Decision on an estimate, with its reasons.

    Attributes:
        outcome: The decision.
        doubts: Codes of the findings against it.
        ratios: RMS residual over the signal's standard deviation of each channel.
        idle: Reason, as a key of `IDLE`, by the channels that are not predicted and do not count.
        part: Samples of the ratios, "fitted" or "held-out".
        candidates: The candidates, the estimate among them.
        worse: The finding that another candidate predicts better, if it does.
        precision: Precision of the base parameters; None if they are not what is asked for.
    """

    outcome: Outcome
    doubts: tuple[str, ...]
    ratios: Mapping[str, float]
    idle: Mapping[str, str]
    part: str
    candidates: Candidates
    worse: Finding | None = None
    precision: Precision | None = None

    @classmethod
    def of(cls, evidence: Evidence, findings: Sequence[Finding], **more: Any) -> Self:
        """The verdict on evidence and the findings on it; `more` are attributes that a subclass adds."""
        doubts = tuple(finding.code for finding in findings if finding.doubt)
        moving = [ratio for channel, ratio in evidence.ratios.items() if channel not in evidence.idle]
        return cls(
            outcome=decided(moving, doubts),
            doubts=doubts,
            ratios=evidence.ratios,
            idle=evidence.idle,
            part=evidence.held_out.part,
            candidates=Candidates.of(evidence),
            worse=next((finding for finding in findings if finding.code in BEHIND), None),
            precision=Precision.of(evidence),
            **more,
        )

    @property
    def usable(self) -> bool:
        """True if it can be used as it is."""
        return self.outcome is Outcome.USABLE

    @property
    def counted(self) -> dict[str, float]:
        """Ratios of the channels that count: those that move."""
        return {channel: ratio for channel, ratio in self.ratios.items() if channel not in self.idle}

    @property
    def predicted(self) -> dict[str, float]:
        """Ratios of the channels that are predicted."""
        return {channel: ratio for channel, ratio in self.counted.items() if ratio <= POOR}

    @property
    def missed(self) -> dict[str, float]:
        """Ratios of the channels that count and are not predicted."""
        return {channel: ratio for channel, ratio in self.counted.items() if not ratio <= POOR}

    @property
    def best(self) -> str | None:
        """Candidate that predicts best over all channels; None if none explains any."""
        return self.candidates.best

    def to_dict(self) -> dict[str, Any]:
        """The verdict in words, the decision, and the channels by how they are predicted, in JSON's types."""
        channels = {"predicted": list(self.predicted), "missed": list(self.missed), "idle": dict(self.idle)}
        return {"verdict": str(self), "outcome": self.outcome.value, "channels": channels}

    @property
    def word(self) -> str:
        """The decision in a word."""
        return self.outcome.word.capitalize()

    @property
    def brief(self) -> str:
        """The decision's reason in a sentence of at most 20 words."""
        if not self.predicted:
            return "It predicts no channel; check names, units and signs of the columns."
        if self.doubts:
            speak = "One finding speaks" if len(self.doubts) == 1 else f"{len(self.doubts)} findings speak"
            return f"{speak} against it; it predicts {self.channels}."
        if self.outcome is Outcome.PARTLY:
            return f"It predicts {self.channels}; use it for nothing else."
        poor = self.precision is not None and self.precision.poor and not self.missed
        but, most = ", single parameters are uncertain" * poor, max(self.predicted.values())
        return f"It predicts {self.channels}; {self.part} residuals are at most {most:.2g} of the signal{but}."

    @property
    def channels(self) -> str:
        """The predicted channels in words: all, all but some, some by name, or how many."""
        count, predicted, missed = len(self.counted), list(self.predicted), list(self.missed)
        what = "channels that count" if self.idle else "channels"
        if not missed:
            return f"all {count} {what}" if count > 1 else listed(predicted)
        if len(missed) <= NAMED and len(missed) < len(predicted):
            return f"all {what} but {listed(missed)}"
        return listed(predicted) if 0 < len(predicted) <= NAMED else f"{len(predicted)} of {count} {what}"

    def __str__(self) -> str:
        # What is wrong with a recording comes before what it does to an estimate.
        caused = self.worse is not None and self.worse.doubt and self.doubts[0] != self.worse.code
        first = [] if self.worse is None or caused else [self.worse.text]
        doubtful = self.outcome is Outcome.NOT
        known = self.precision.sentences() if self.precision is not None and not doubtful else ()
        return " ".join([*first, *self._decision(), *self._best(), *known])

    def _decision(self) -> Iterator[str]:
        """Yields sentences on the decision, the channels that are predicted, and what to do."""
        if self.doubts:
            speak = "one finding below speaks" if len(self.doubts) == 1 else f"{len(self.doubts)} findings below speak"
            yield f"Not usable as it is: {speak} against it. It predicts {self.channels}."
        elif self.outcome is Outcome.NOT:
            what = f"none of {number_of(len(self.counted), 'channel')} ({self.part})"
            yield f"Not usable: it predicts {what if self.counted else 'nothing, as no channel counts'}."
            yield "Check names, units and signs of the columns, and that the motors alone move the joints."
        elif self.outcome is Outcome.PARTLY:
            yield f"Partly usable: it predicts {self.channels}."
            yield self._part()
        else:
            yield from self._use()
        if self.idle:
            of = {why: [c for c, own in self.idle.items() if own == why] for why in self.idle.values()}
            each = (f"{listed(names, 'channels')} ({IDLE[why]})" for why, names in of.items())
            yield f"Not counted: {listed(each)}."

    def _part(self) -> str:
        """Sentence on what a partly usable estimate may be used for."""
        return "Use it for nothing else; for the others move further and faster, or complete the model."

    def _use(self) -> Iterator[str]:
        """Yields sentences on what a usable estimate may be used for."""
        wrenches = any(channel in COMPONENTS for channel in self.predicted)
        torques = any(channel not in COMPONENTS for channel in self.predicted)
        what = " and ".join(["wrenches"] * wrenches + ["joint torques"] * torques)
        but = ", not to read off single parameters" if self.precision is not None and self.precision.poor else ""
        yield (
            f"Usable to predict {what}{but}: {self.part} residuals are at most {max(self.predicted.values()):.2g} of "
            f"the signal in {self.channels}."
        )

    def _best(self) -> Iterator[str]:
        """Yields a sentence on the candidate that predicts best, if there are others."""
        if len(self.candidates.ratios) > 1:
            best = self.best and f"Over all channels {CANDIDATES[self.best]} predicts best."
            yield best or "No candidate explains any channel, so that none is best."


def decided(moving: Sequence[float], doubts: Sequence[str]) -> Outcome:
    """Outcome of an estimate with these residuals over the signals of all channels that move, and these doubts.

    A usable one explains all of them and predicts three quarters.
    """
    predicted = sum(ratio <= POOR for ratio in moving)
    if doubts or not predicted:
        return Outcome.NOT
    explained = all(ratio <= UNEXPLAINED for ratio in moving)
    return Outcome.USABLE if explained and predicted >= 0.75 * len(moving) else Outcome.PARTLY


ON_FIT: Sequence[Callable[[Evidence], Iterator[Finding]]] = (
    *(recorded.gravity_findings, recorded.delay_findings, recorded.frame_findings, torques.torque_findings),
    *(candidate_findings, recorded.contact_findings, recorded.unmeasured_findings),
    *(recorded.clipped_findings, recorded.resolution_findings, recorded.tracked_findings),
    *(masses.weight_findings, masses.offset_findings, torques.cause_findings),
    *(torques.scale_findings, torques.friction_findings, torques.drive_findings, recorded.plane_findings),
    *(fit.quality_findings, recorded.setup_remarks, fit.course_findings, fit.halves_findings, fit.own_findings),
    *(
        fit.repetition_findings,
        fit.prior_findings,
        fit.model_error_findings,
        unmodelled_findings,
        fit.slow_residual_findings,
    ),
    *(fit.posture_findings, masses.inseparable_findings, recorded.stuck_findings, recorded.unchecked_findings),
    fit.caveats,
)
"""Judges of the fit, in the order of their findings."""

ON_BODIES: Sequence[Callable[[Evidence], Iterator[Finding]]] = (masses.mass_findings, masses.consistency_findings)
"""Judges of the updated model."""


def findings(evidence: Evidence) -> list[Finding]:
    """All findings, the doubts first, then those on the fit, and then those on the updated model."""
    return doubts_first(each for judge in (*ON_FIT, *ON_BODIES) for each in judge(evidence))
