"""Findings on a fit: its residuals, course, agreement of its parts, the prior, postures and assumptions."""

from collections.abc import Iterator

import numpy as np
from scipy import linalg

from ident.judgement.candidates import NEGLIGIBLE, Candidates
from ident.judgement.evidence import Evidence
from ident.judgement.finding import Finding
from ident.judgement.residuals import DISAGREE, beyond_fast_noise
from ident.parameters.prior import known_covariance
from ident.recordings.wrench import GROUND
from ident.regression.held_out import ESTIMATE
from ident.tolerances import CONDITION_LIMIT, LEFT, POOR, UNEXPLAINED
from ident.trajectory.fit.repeats import repeating

FAR_LESS = 30.0
"""Standard deviation from the data over that of the prior from which the motion determines nothing: .2 and .3 in a
simulated arm and a real pendulum, 43 in a real UR10 whose torques leave one combination open, more for people."""

FAR_APART = 4.0
"""Distance of one log's base parameters from those of the others, in standard deviations, from which it is a doubt,
unless the estimate predicts that log best of all candidates: then no other parameters on offer are nearer."""

CHANGED = 2.0
"""Residual over signal in a log over its median in the others from which something changed, however well it is
predicted beside other candidates: trials of a real pendulum that disagree have up to 1.8, one whose force reads a fifth
more has 4."""


def course_findings(evidence: Evidence) -> Iterator[Finding]:
    """A doubt on a trajectory estimate that was interrupted, or whose last step was above 0.3 standard deviations."""
    if evidence.trajectory is None:
        return
    fit = evidence.trajectory.fit
    if fit.status == "interrupted" or (fit.status != "converged" and fit.trace[-1] > 0.3):
        yield Finding.of("not_converged", status=fit.status, rounds=len(fit.trace))


def halves_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on halves and logs that disagree."""
    if evidence.disagreement is not None and evidence.disagreement > DISAGREE:
        yield Finding.of("halves_disagree", rms_z=evidence.disagreement)
    if evidence.widened:
        yield Finding.of("parameter_widened", factors=dict(evidence.widened))
    if apart := {log: z for log, z in enumerate(evidence.disagreements, start=1) if z > DISAGREE}:
        best = tuple(log for log in apart if evidence.in_logs and _predicted(evidence, log - 1))
        far = any(z > FAR_APART and log not in best for log, z in apart.items())
        yield Finding.of("logs_disagree", doubt=far, logs=tuple(apart), rms_z=tuple(apart.values()), best=best)


def _predicted(evidence: Evidence, k: int) -> bool:
    """True if the estimate predicts a log best of all candidates, and no channel far worse than in the other logs."""
    ratios = np.array([each[ESTIMATE] for each in evidence.in_logs])
    usual = np.median(np.delete(ratios, k, axis=0), axis=0)
    best = Candidates.explaining(evidence.channels, evidence.in_logs[k]).best
    return best == ESTIMATE and not (ratios[k] > CHANGED * usual).any()


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
