"""Three predictions of what was held out: the model as it came, least squares on filtered states, and the estimate."""

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.judgement.evidence import Evidence
from ident.judgement.finding import FINDINGS, NAMED, Finding, Place, Row, listed, percent
from ident.regression.held_out import ESTIMATE, LEAST_SQUARES, MODEL
from ident.tolerances import CONDITION_LIMIT, UNEXPLAINED

RIVALS = LEAST_SQUARES, MODEL
"""The other candidates, as they are called in `Estimate.rivals`."""

NOTABLY = 1.1
"""Ratio of two residuals from which one prediction is better than another."""

CLEARLY = 1.25
"""The same from which it is clearly better: of a hundred independent samples, more than which few held-out parts have,
the root mean square is known to 7 % and the ratio of two to 10 %."""

BETTER = 1.05
"""Median over the channels of the ratio of two residuals from which one candidate predicts better than another one."""

NEGLIGIBLE = 0.02
"""Residual over signal below which a prediction is good whatever the others' are."""

CANDIDATES = {"estimate": "the estimate", "model": "the model as it came", "least squares": "least squares"}
"""Candidates in words."""


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
        """The other candidate that predicts best of those that are better in the median channel and overall."""
        others = [name for name in RIVALS if name in self.ratios and self.channels]
        own = self.overall(ESTIMATE)
        ahead = [name for name in others if self.overall(name) < own and self.behind(name) > BETTER]
        return min(ahead, key=self.overall, default=None)

    def better(self, name: str, other: str, factor: float) -> tuple[str, ...]:
        """Channels in which a candidate predicts better than another one by a factor."""
        pairs = zip(self.channels, self.ratios[name], self.ratios[other], strict=True)
        return tuple(c for c, a, b in pairs if factor * a < b and b > NEGLIGIBLE)

    def clearly_worse(self, other: str) -> tuple[str, ...]:
        """Channels in which the estimate is clearly worse than another candidate; none if it is better overall."""
        if other not in self.ratios or self.overall(ESTIMATE) < self.overall(other):
            return ()
        return self.better(other, ESTIMATE, CLEARLY)

    def pairs(self, channels: Sequence[str], other: str) -> dict[str, tuple[float, float]]:
        """Residuals over signal of the estimate and of another candidate in some channels."""
        at = [self.channels.index(channel) for channel in channels]
        own, others = self.ratios[ESTIMATE], self.ratios[other]
        return {self.channels[k]: (float(own[k]), float(others[k])) for k in at}


def candidate_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubt that another candidate predicts clearly better, with what to use instead, or remark that it is better."""
    candidates = Candidates.of(evidence)
    worse = {name: channels for name in RIVALS if (channels := candidates.clearly_worse(name))}
    if not worse:
        yield from _better_overall(candidates)
        return
    named = {channel: None for channels in worse.values() for channel in channels}
    yield Finding.of(
        "worse_than_candidate",
        Place(channels=tuple(named)),
        worse={name: candidates.pairs(channels, name) for name, channels in worse.items()},
        take=_instead(evidence, candidates, worse),
        cutoff_hz=evidence.filtered_at,
    )


def _better_overall(candidates: Candidates) -> Iterator[Finding]:
    """Remark that another candidate predicts somewhat better over the channels."""
    if (other := candidates.better_overall) is not None:
        pairs = candidates.pairs(candidates.channels, other)
        place = Place(channels=candidates.channels)
        yield Finding.of("candidate_better", place, candidate=other, behind=candidates.behind(other), ratios=pairs)


def _instead(evidence: Evidence, candidates: Candidates, better: Collection[str]) -> str | None:
    """Candidate to use instead of an estimate that is clearly worse in a channel; None if none is usable."""
    if min(better, key=candidates.overall) == MODEL:
        return MODEL
    return LEAST_SQUARES if evidence.condition_number < CONDITION_LIMIT else None


def _worse(worse: Mapping[str, Mapping[str, Sequence[float]]], **advice: Any) -> str:
    parts = [f"{CANDIDATES[name]} in {_pairs(channels)}" for name, channels in worse.items()]
    return f"Worse than {', and than '.join(parts)}, residual over signal. {_advice('model' in worse, **advice)}"


def _pairs(channels: Mapping[str, Sequence[float]]) -> str:
    """The estimate's ratios beside another candidate's, of the worst channel if there are many."""
    pairs = [f"{channel} ({own:.3g} against {other:.3g})" for channel, (own, other) in channels.items()]
    more = [own - other for own, other in channels.values()]
    most = pairs[more.index(max(more))]
    return listed(pairs) if len(pairs) <= NAMED else f"{len(pairs)} channels, most in {most}"


def _better(candidate: str, behind: float, ratios: Mapping[str, Sequence[float]]) -> str:
    name = CANDIDATES[candidate]
    return (
        f"{name[0].upper()}{name[1:]} predicts better than the estimate, by {percent(behind - 1)} in the median "
        f"of {len(ratios)} channels. Take it if you only want to predict."
    )


def _advice(model_too: bool, take: str, cutoff_hz: float | None) -> str:
    if take == "model":
        return "Keep the model."
    if take == "least squares":
        cutoff = "" if cutoff_hz is None else f" --cutoff {cutoff_hz:.3g}"
        return f"Take least squares, --estimator weighted{cutoff}."
    keep = "Keep the model, or move" if model_too else "Move"
    return (
        "Least squares had the model's bodies as a prior, without which --estimator weighted does not separate the "
        f"parameters. {keep} the joints further."
    )


FINDINGS.update(worse_than_candidate=Row(_worse, doubt=True), candidate_better=Row(_better, doubt=False))
