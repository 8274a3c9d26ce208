"""The verdict on an estimate: decided by ratios and codes of findings, then put into words."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from ident.display.brief import Worded
from ident.geometry.inertia import with_bodies
from ident.judgement.candidates import Candidates
from ident.judgement.codes.of_prediction import CANDIDATES
from ident.judgement.evidence import Evidence
from ident.judgement.finding import Finding
from ident.tolerances import POOR

PRECISIONS = 0.1, 0.2, 0.5
"""Relative standard deviations up to which parameters are counted as known."""

WIDER = 2.0
"""Ratio of the standard deviation with the set-up to that from the noise above which parameters are named."""

BEHIND = "worse_than_candidate", "candidate_better"
"""Codes of findings that another candidate predicts better, clearly, which is a doubt, or somewhat."""

SHOWN = 8
"""Largest number of parameters that a sentence names."""


class Outcome(Enum):
    """Decision on an estimate."""

    USABLE = "usable"
    DOUBTFUL = "doubtful"
    PREDICTS_NOTHING = "predicts nothing"


@dataclass(frozen=True)
class Precision:
    """Precision of base parameters.

    Attributes:
        total: Number of base parameters.
        known: Numbers of those whose standard deviation is within each of `PRECISIONS` of the value.
        wider: Names of those whose deviation the uncertainty of the set-up more than doubles.
        bodies: Names of the bodies.
    """

    total: int
    known: tuple[int, ...]
    wider: tuple[str, ...]
    bodies: tuple[str, ...]

    @classmethod
    def of(
        cls, names: Sequence[str], psi: np.ndarray, std: np.ndarray, std_setup: np.ndarray, bodies: Sequence[str]
    ) -> "Precision":
        """The precision of base parameters from their values and both standard deviations (r,)."""
        known = tuple(int((std_setup <= share * np.abs(psi)).sum()) for share in PRECISIONS)
        wider = tuple(name for name, a, b in zip(names, std, std_setup, strict=True) if b > WIDER * a)
        return cls(len(psi), known, wider, tuple(bodies))

    def sentences(self) -> Iterator[str]:
        """Yields sentences on the number of known parameters, and on those that the set-up makes uncertain."""
        counts = ", ".join(f"{n} within {share:.0%}" for n, share in zip(self.known, PRECISIONS, strict=True))
        yield f"Of {self.total} base parameters it knows {counts}."
        if self.wider:
            more = f" and {len(self.wider) - SHOWN} more" if len(self.wider) > SHOWN else ""
            names = with_bodies(self.wider[:SHOWN], self.bodies) + more
            yield f"What is not known of the set-up more than doubles the deviations of {names}."


@dataclass(frozen=True, repr=False)
class Verdict(Worded):
    """Decision on an estimate, with its reasons.

    Attributes:
        outcome: The decision.
        doubts: Codes of the findings against it.
        ratios: RMS residual over the signal's standard deviation of each channel.
        part: Samples of the ratios, "fitted" or "held-out".
        candidates: The candidates, the estimate among them.
        worse: The finding that another candidate predicts better, if it does.
        precision: Precision of the base parameters; None if it is not computed.
    """

    outcome: Outcome
    doubts: tuple[str, ...]
    ratios: Mapping[str, float]
    part: str
    candidates: Candidates
    worse: Finding | None = None
    precision: Precision | None = None

    @classmethod
    def of(cls, evidence: Evidence, findings: Sequence[Finding], precision: Precision | None = None) -> "Verdict":
        """The verdict on evidence and the findings on it."""
        doubts, predicts = doubts_of(findings), any(ratio <= POOR for ratio in evidence.ratios.values())
        outcome = decided(doubts) if predicts else Outcome.PREDICTS_NOTHING
        worse = next((finding for finding in findings if finding.code in BEHIND), None)
        return cls(outcome, doubts, evidence.ratios, evidence.part, Candidates.of(evidence), worse, precision)

    @property
    def usable(self) -> bool:
        """True if it can be used as it is."""
        return self.outcome is Outcome.USABLE

    @property
    def predicted(self) -> dict[str, float]:
        """Ratios of the channels that are predicted."""
        return {channel: ratio for channel, ratio in self.ratios.items() if ratio <= POOR}

    @property
    def best(self) -> str | None:
        """Candidate that predicts best over all channels; None if none explains any."""
        return self.candidates.best

    def __str__(self) -> str:
        first = [] if self.worse is None else [self.worse.text]
        uses = self.precision.sentences() if self.precision is not None and self.usable else ()
        return " ".join([*first, self._decision(), *self._comparisons(), *uses])

    def _decision(self) -> str:
        if self.outcome is Outcome.PREDICTS_NOTHING:
            return f"Do not use it: the model predicts none of the channels on the {self.part} part."
        if self.outcome is Outcome.DOUBTFUL:
            return doubted(len(self.doubts))
        predicted = self.predicted
        return (
            f"Usable: {self.part} residuals are at most {max(predicted.values()):.2f} of the signal in "
            f"{', '.join(predicted)}."
        )

    def _comparisons(self) -> Iterator[str]:
        """Yields sentences that compare the estimate with other candidates, by channel, and name the best."""
        if len(self.candidates.ratios) < 2:
            return
        if self.best is None:
            yield "No candidate explains any channel, so that none is best."
            return
        for other, better, alike, worse in self.candidates.compared():
            kinds = ((better, "better than"), (alike, "as well as"), (worse, "worse than"))
            parts = [f"{how} {CANDIDATES[other]} in {', '.join(channels)}" for channels, how in kinds if channels]
            yield f"It predicts {', '.join(parts)}."
        yield f"Over all channels {CANDIDATES[self.best]} predicts best."


def doubts_of(findings: Sequence[Finding]) -> tuple[str, ...]:
    """Codes of the doubts among findings."""
    return tuple(finding.code for finding in findings if finding.doubt)


def decided(doubts: Sequence[str]) -> Outcome:
    """Outcome of an estimate that predicts something, by the codes of its doubts."""
    return Outcome.DOUBTFUL if doubts else Outcome.USABLE


def doubted(count: int) -> str:
    """Sentence on an estimate with some doubts."""
    speak = "one finding below speaks" if count == 1 else f"{count} findings below speak"
    return f"Do not use it as it is: {speak} against it."
