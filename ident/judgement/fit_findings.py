"""Findings on a fit: its candidates, residuals, course, agreement of its parts, the prior, postures and assumptions.

Three candidates predict what was held out: the model as it came, least squares on filtered states, and the estimate.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg

from ident.judgement.evidence import Evidence
from ident.judgement.finding import Finding, Place
from ident.judgement.residuals import BEYOND_CHANCE, DISAGREE, beyond_fast_noise
from ident.parameters.prior import known_covariance
from ident.recordings.wrench import GROUND
from ident.regression.held_out import ESTIMATE, LEAST_SQUARES, MODEL
from ident.tolerances import CLEARLY, CONDITION_LIMIT, FAR_BETTER, LEFT, NOTABLY, POOR, UNEXPLAINED
from ident.trajectory.fit.repeats import repeating

RIVALS = LEAST_SQUARES, MODEL
"""The other candidates, as they are called in `Estimate.rivals`."""

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
        take = "nothing" if evidence.checks.grossly_wrong else take
        yield Finding.of("worse_than_candidate", place, worse=worse, take=take, cutoff_hz=evidence.filtered_at)
    elif (other := candidates.better_overall) is not None and not evidence.checks.grossly_wrong:
        behind, pairs = candidates.behind(other), candidates.pairs(other)
        yield Finding.of("candidate_better", candidate=other, behind=behind, ratios=pairs)


FAR_LESS = 30.0
"""Standard deviation from the data over that of the prior from which the motion determines nothing: .2 and .3 in a
simulated arm and a real pendulum, 43 in a real UR10 whose torques leave one combination open, more for people."""


def course_findings(evidence: Evidence) -> Iterator[Finding]:
    """A doubt on a trajectory estimate that was interrupted, or whose last step was above 0.3 standard deviations."""
    if evidence.trajectory is None:
        return
    fit = evidence.trajectory.fit
    if fit.status == "interrupted" or (fit.status != "converged" and fit.trace[-1] > 0.3):
        yield Finding.of("not_converged", status=fit.status, rounds=len(fit.trace))


def halves_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on halves and logs that disagree.

    A log far beyond chance from the others is a doubt, unless the estimate predicts it best of all candidates: then no
    other parameters on offer are nearer.
    """
    if evidence.disagreement is not None and evidence.disagreement > DISAGREE:
        yield Finding.of("halves_disagree", rms_z=evidence.disagreement)
    if evidence.widened:
        yield Finding.of("parameter_widened", factors=dict(evidence.widened))
    if apart := {log: z for log, z in enumerate(evidence.disagreements, start=1) if z > DISAGREE}:
        best = tuple(log for log in apart if evidence.in_logs and _predicted(evidence, log - 1))
        far = any(z > BEYOND_CHANCE and log not in best for log, z in apart.items())
        yield Finding.of("logs_disagree", doubt=far, logs=tuple(apart), rms_z=tuple(apart.values()), best=best)


def _predicted(evidence: Evidence, k: int) -> bool:
    """True if the estimate predicts a log best of all candidates, and no channel far worse than in the other logs.

    Of trials of a real pendulum that disagree, the residual is up to 1.8 of the others' median; of one whose force
    reads a fifth more it is 4.
    """
    ratios = np.array([each[ESTIMATE] for each in evidence.in_logs])
    usual = np.median(np.delete(ratios, k, axis=0), axis=0)
    best = Candidates.explaining(evidence.channels, evidence.in_logs[k]).best
    return best == ESTIMATE and not (FAR_BETTER * ratios[k] > usual).any()


def own_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on friction and offsets that each recording has for itself."""
    joint = evidence.trajectory
    if joint is None:
        return
    names = joint.measurement.equations.names
    each = np.array([joint.parameters_of(k)[: len(names)] for k in range(len(joint.counts))])
    if own := {name: tuple(x.tolist()) for name, x in zip(names, each.T, strict=True) if np.ptp(x) > 0}:
        yield Finding.of("own_in_logs", values=own)


def repetition_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on motions that repeat together with what is not explained."""
    if evidence.trajectory is not None:
        every = repeating(evidence.trajectory.measurement, evidence.trajectory.fit)
        if periods := tuple(each.period for each in every for _ in each.starts if each.period < np.inf):
            yield Finding.of("motion_repeats", periods=periods)
        if logs := tuple(1 + log for each in every if len(each.starts) > 1 for log in each.starts):
            yield Finding.of("logs_repeat", logs=logs)


def prior_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on a prior that was used, and on the need for it."""
    joint = evidence.trajectory
    if joint is not None and joint.known:
        separated = _separated(evidence, joint.fit.covariance)
        yield Finding.of("prior_beside_data" if separated else "prior_needed")


def _separated(evidence: Evidence, covariance: np.ndarray) -> bool:
    """True if the data of an estimate with a prior determine every base parameter without it.

    Args:
        evidence: The estimate.
        covariance: Covariance due to the noise, ψ first (p, p).
    """
    before = known_covariance(
        evidence.mechanism, evidence.fit.parameters, evidence.known, evidence.fit.equations.absorbed
    )
    # Of the variance with the prior, over that of the prior alone, this share is left where the data's own is so large.
    share = FAR_LESS**2 / (1 + FAR_LESS**2)
    left = linalg.eigvalsh(covariance[: len(before), : len(before)], before)
    return evidence.condition_number < CONDITION_LIMIT and bool(left[-1] < share)


def posture_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on joints that were recorded beyond the model's ranges, by 5 % of a range in 1 % of the samples."""
    mechanism = evidence.mechanism
    beyond: dict[str, float] = {}
    coordinates = mechanism.tree.body_coordinates(evidence.prepared.samples.motion.q)
    for joint, q in zip((body.joint for body in mechanism.tree.bodies), coordinates, strict=True):
        if joint in mechanism.ranges and q.shape[1] == 1:
            low, high = mechanism.ranges[joint]
            slack = 0.05 * (high - low)
            share = float(((q < low - slack) | (q > high + slack)).mean())
            beyond |= {joint: share} if share > 0.01 else {}
    if beyond:
        yield Finding.of("beyond_joint_ranges", shares=beyond)


def caveats(evidence: Evidence) -> Iterator[Finding]:
    """Remarks on the assumptions of least squares; a doubt where they take a stated scale of torques as exact."""
    if evidence.trajectory is not None:
        return
    if joints := tuple(evidence.fit.equations.scaled):
        yield Finding.of("torque_scale_taken_as_exact", joints=joints)
    if stated := {kind: None for log, _ in evidence.logs for kind, std in log.recording.setup.items() if std}:
        yield Finding.of("setup_taken_as_exact", kinds=tuple(stated))
    if evidence.prepared.cutoff is None:
        yield Finding.of("unfiltered_wrenches")
    yield Finding.of("joint_noise_not_included")


def quality_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on channels with large residuals over their signals, but for mirrored and unpredictable ones."""
    ground = evidence.checks.frames.get(GROUND)
    others = {*evidence.idle, *(() if ground is None else ground.mirrored)}
    ratios = {channel: ratio for channel, ratio in evidence.ratios.items() if channel not in others}
    kinds = (
        ("residual_above_signal", LEFT, np.inf),
        ("unexplained_channels", UNEXPLAINED, LEFT),
        ("poor_prediction", POOR, UNEXPLAINED),
    )
    for code, low, high in kinds:
        if between := {channel: ratio for channel, ratio in ratios.items() if low < ratio <= high}:
            yield Finding.of(code, ratios=between, part=evidence.held_out.part)


def model_error_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubt on channels half of whose residual's variance depends on the motion, if that is not negligible."""
    if evidence.trajectory is None:
        return
    shares = zip(evidence.channels, evidence.model_error, evidence.ratios.values(), strict=True)
    if channels := tuple(c for c, share, ratio in shares if share > 0.5 and ratio > NEGLIGIBLE):
        yield Finding.of("residual_follows_motion", channels=channels)


def slow_residual_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on channels whose residual is far above the sensor's noise; intervals include it."""
    if evidence.trajectory is None:
        return
    if large := beyond_fast_noise(evidence.trajectory, evidence.channels):
        every = 1 < len(large) == len(evidence.channels)
        yield Finding.of("residual_above_fast_noise", factors=large, all_channels=every)
