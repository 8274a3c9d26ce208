"""Three predictions of what was held out: the model as it came, least squares on filtered states, and the estimate."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ident.judgement.evidence import Evidence
from ident.judgement.finding import Finding, Place
from ident.regression.held_out import ESTIMATE, LEAST_SQUARES, MODEL
from ident.tolerances import CONDITION_LIMIT, UNEXPLAINED

RIVALS = LEAST_SQUARES, MODEL
"""The other candidates, as they are called in `Estimate.rivals`."""

NOTABLY = 1.1
"""Ratio of two residuals from which one prediction is better than another."""

CLEARLY = 1.25
"""The same from which it is clearly better: of a hundred independent samples, more than which few held-out parts have,
the root mean square is known to 7 % and the ratio of two to 10 %."""

NEGLIGIBLE = 0.02
"""Residual over signal below which a prediction is good whatever the others' are."""


def about_best(ratios: np.ndarray) -> np.ndarray:
    """Mask of the candidates that predict a channel about as well as the best one, by their residuals (k, C)."""
    sizes = np.maximum(ratios, NEGLIGIBLE)
    return np.asarray(sizes <= NOTABLY * np.fmin.reduce(sizes, axis=0))


@dataclass(frozen=True, eq=False)
class Candidates:
    """Residuals of the candidates in the channels that one of them explains.

    Attributes:
        channels: Names of these channels (C,).
        ratios: Residual over signal by the candidate's name (C,), the estimate's among them.
    """

    channels: tuple[str, ...]
    ratios: dict[str, np.ndarray]

    @classmethod
    def of(cls, evidence: Evidence) -> "Candidates":
        """The candidates of an identification."""
        every = {ESTIMATE: np.array(list(evidence.ratios.values()))}
        every |= {name: np.asarray(evidence.rivals[name]) for name in RIVALS if name in evidence.rivals}
        return cls.explaining(evidence.channels, every)

    @classmethod
    def explaining(cls, channels: Sequence[str], every: Mapping[str, np.ndarray]) -> "Candidates":
        """Candidates in the channels that one of them explains, by their ratios in all channels (C,)."""
        explained = np.min(list(every.values()), axis=0) <= UNEXPLAINED
        kept = tuple(c for c, e in zip(channels, explained, strict=True) if e)
        return cls(kept, {name: ratio[explained] for name, ratio in every.items()})

    def overall(self, name: str) -> float:
        """Geometric mean of a candidate's residuals over the signals, each at least `NEGLIGIBLE`."""
        return float(np.exp(np.log(np.maximum(self.ratios[name], NEGLIGIBLE)).mean())) if self.channels else np.inf

    @property
    def best(self) -> str | None:
        """Candidate that predicts best over all channels, the estimate if about as good; None without channels."""
        if not self.channels:
            return None
        first = min(self.ratios, key=self.overall)
        alike = self.overall(ESTIMATE) <= NOTABLY * self.overall(first) and first != self.better_overall
        return ESTIMATE if alike else first

    def behind(self, other: str) -> float:
        """Median over the channels of the estimate's residual over that of another candidate."""
        own, others = (np.maximum(self.ratios[name], NEGLIGIBLE) for name in (ESTIMATE, other))
        return float(np.median(own / others))

    @property
    def better_overall(self) -> str | None:
        """The other candidate that predicts best of those better overall, and by 5 % in the median channel."""
        others = [name for name in RIVALS if name in self.ratios and self.channels]
        own = self.overall(ESTIMATE)
        ahead = [name for name in others if self.overall(name) < own and self.behind(name) > 1.05]
        return min(ahead, key=self.overall, default=None)

    def pairs(self, other: str) -> dict[str, tuple[float, float]]:
        """Residuals over signal of the estimate and of another candidate by channel."""
        both = zip(self.ratios[ESTIMATE].tolist(), self.ratios[other].tolist(), strict=True)
        return dict(zip(self.channels, both, strict=True))

    def clearly_worse(self, other: str) -> dict[str, tuple[float, float]]:
        """The `pairs` in which the estimate is clearly worse than another candidate; none if it is better overall."""
        if other not in self.ratios or self.overall(ESTIMATE) < self.overall(other):
            return {}
        pairs = self.pairs(other).items()
        return {c: (own, least) for c, (own, least) in pairs if CLEARLY * least < own and own > NEGLIGIBLE}


def candidate_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubt that another candidate predicts clearly better, with what to use instead, or remark that it is better."""
    candidates = Candidates.of(evidence)
    if worse := {name: pairs for name in RIVALS if (pairs := candidates.clearly_worse(name))}:
        place = Place(channels=tuple(dict.fromkeys(channel for pairs in worse.values() for channel in pairs)))
        # Least squares are usable if they need no prior.
        take = LEAST_SQUARES if evidence.condition_number < CONDITION_LIMIT else None
        take = MODEL if min(worse, key=candidates.overall) == MODEL else take
        yield Finding.of("worse_than_candidate", place, worse=worse, take=take, cutoff_hz=evidence.filtered_at)
    elif (other := candidates.better_overall) is not None:
        behind, pairs = candidates.behind(other), candidates.pairs(other)
        yield Finding.of("candidate_better", candidate=other, behind=behind, ratios=pairs)
