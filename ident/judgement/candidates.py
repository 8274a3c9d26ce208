"""Three predictions of what was held out: the model as it came, least squares on filtered states, and the estimate."""

from collections.abc import Collection, Iterator, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ident.judgement.finding import Finding, Place
from ident.tolerances import CONDITION_LIMIT, UNEXPLAINED

if TYPE_CHECKING:
    from ident.estimate import Estimate

ESTIMATE, MODEL, LEAST_SQUARES = "the estimate", "the model as it came", "least squares"
RIVALS = {"least squares": LEAST_SQUARES, "model": MODEL}
"""Names of the other candidates in sentences, by what they are in `Estimate.rivals`."""

NOTABLY = 1.1
"""Ratio of two residuals from which one prediction is better than another."""

CLEARLY = 1.25
"""The same from which it is clearly better: of a hundred independent samples, more than which few held-out parts have,
the root mean square is known to 7 % and the ratio of two to 10 %."""

NEGLIGIBLE = 0.02
"""Residual over signal below which a prediction is good whatever others are."""


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
    def of(cls, result: "Estimate") -> "Candidates":
        """The candidates of an identification."""
        every = {ESTIMATE: result.held_out.ratio}
        every |= {name: np.asarray(result.rivals[key]) for key, name in RIVALS.items() if key in result.rivals}
        explained = np.min(list(every.values()), axis=0) <= UNEXPLAINED
        channels = tuple(c for c, e in zip(result.channels, explained, strict=True) if e)
        return cls(channels, {name: ratio[explained] for name, ratio in every.items()})

    def overall(self, name: str) -> float:
        """Geometric mean of what a candidate leaves, what is negligible counted as such."""
        return float(np.exp(np.log(np.maximum(self.ratios[name], NEGLIGIBLE)).mean())) if self.channels else np.inf

    @property
    def best(self) -> str | None:
        """The candidate that predicts best over all channels, of those that are alike the estimate; None if none."""
        if not self.channels:
            return None
        first = min(self.ratios, key=self.overall)
        return ESTIMATE if self.overall(ESTIMATE) <= NOTABLY * self.overall(first) else first

    def better(self, name: str, other: str, factor: float) -> tuple[str, ...]:
        """Channels in which a candidate predicts better than another one by a factor."""
        pairs = zip(self.channels, self.ratios[name], self.ratios[other], strict=True)
        return tuple(c for c, a, b in pairs if factor * a < b and b > NEGLIGIBLE)

    def clearly_worse(self, other: str) -> tuple[str, ...]:
        """Channels in which the estimate is clearly worse than another candidate; none if it is better overall."""
        if other not in self.ratios or self.overall(ESTIMATE) < self.overall(other):
            return ()
        return self.better(other, ESTIMATE, CLEARLY)

    def listed(self, channels: Sequence[str], other: str) -> str:
        """Channels with what the estimate and another candidate leave."""
        at = [self.channels.index(channel) for channel in channels]
        own, others = self.ratios[ESTIMATE], self.ratios[other]
        return ", ".join(f"{self.channels[k]} ({own[k]:.3g} against {others[k]:.3g})" for k in at)


def candidate_findings(result: "Estimate") -> Iterator[Finding]:
    """The doubt that another candidate predicts better, and which one to take."""
    candidates = Candidates.of(result)
    worse = {name: channels for name in RIVALS.values() if (channels := candidates.clearly_worse(name))}
    if not worse:
        return
    parts = [f"{name} in {candidates.listed(channels, name)}" for name, channels in worse.items()]
    named = {channel: None for channels in worse.values() for channel in channels}
    yield Finding(
        f"Worse than {', and than '.join(parts)}, held-out residual over standard deviation in brackets: "
        f"{_advice(result, candidates, worse)}.",
        True,
        Place(channels=tuple(named)),
    )


def _advice(result: "Estimate", candidates: Candidates, better: Collection[str]) -> str:
    """Advice on what to take instead of an estimate to which some candidates are clearly better in a channel."""
    if min(better, key=candidates.overall) == MODEL:
        return "keep the model"
    if result.condition_number < CONDITION_LIMIT:
        cutoff = "" if result.filtered_at is None else f" --cutoff {result.filtered_at:.3g}"
        return f"take least squares, --estimator weighted{cutoff}"
    keep = "keep the model, or " if MODEL in better else ""
    return (
        f"{keep}move the joints further; least squares had the model's bodies for a prior here, without which "
        "--estimator weighted does not separate the parameters"
    )


def comparisons(result: "Estimate") -> Iterator[str]:
    """Sentences on how the estimate predicts beside the others, channel by channel, and which candidate is best."""
    candidates = Candidates.of(result)
    others = [name for name in RIVALS.values() if name in candidates.ratios]
    if not others:
        return
    if not candidates.channels:
        yield "No candidate explains any channel, so that none is best."
        return
    for name in others:
        better = candidates.better(ESTIMATE, name, NOTABLY)
        worse = candidates.better(name, ESTIMATE, NOTABLY)
        alike = [c for c in candidates.channels if c not in (*better, *worse)]
        kinds = ((better, "better than"), (alike, "as well as"), (worse, "worse than"))
        parts = [f"{how} {name} in {', '.join(channels)}" for channels, how in kinds if channels]
        yield f"It predicts {', '.join(parts)}."
    yield f"Over all channels {candidates.best} predicts best."
