"""Findings on a fit: its course, set-up errors, agreement of its parts, and residuals of each channel."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from scipy import linalg

from ident.judgement.candidates import ESTIMATE, Candidates
from ident.judgement.evidence import Evidence
from ident.judgement.finding import Finding
from ident.judgement.halves import DISAGREE
from ident.judgement.place import Place
from ident.parameters.prior import known_covariance
from ident.recordings.resolution import white_noise
from ident.recordings.wrench import GROUND
from ident.tolerances import CONDITION_LIMIT, LEFT, POOR, UNEXPLAINED
from ident.trajectory.fit.fitted import TrajectoryFit

RESTLESS = 0.3
"""Last step of the trajectory estimate, in standard deviations, from which it counts as not converged."""

OF_THE_MOTION, WORTH_IT = 0.5, 0.02
"""Share of a residual's variance that posture and motion explain, beyond chance, from which it is a doubt, if the
residual is more than so much of the signal."""

FAR_ABOVE = 3.0
"""Noise of a channel over its high-frequency part, or its floor, from which there is a remark."""

FAR_LESS = 30.0
"""Standard deviation from the data over that of the prior from which the motion determines nothing."""

TINIEST = 1e-300

FAR_APART = 4.0
"""Distance of one log's base parameters from those of the others, in standard deviations, from which it is a doubt,
unless the estimate predicts that log best of all candidates: then no other parameters on offer are nearer."""

CHANGED = 2.0
"""Residual over signal in a log over its median in the others from which something changed, however well it is
predicted beside other candidates: trials of a real pendulum that disagree have up to 1.8, one whose force reads a fifth
more has 4."""

BEYOND, RARELY = 0.05, 0.01
"""Distance beyond a joint's range, of the range, and share of the samples up to which no remark is made."""


def gravity_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubt on the stated direction of gravity."""
    check = evidence.checks.gravity
    if check is not None and check.suspicious:
        own: dict[str, Any] = {key: getattr(check, key) for key in ("rpy_deg", "stated", "misfit", "joint")}
        yield Finding.of("gravity_direction", moving=evidence.logs[0].recording.base is not None, **own)


def delay_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubt on the times of channels that are late by more than the estimate includes."""
    check = evidence.checks.delay
    if check is not None and check.suspicious:
        # Checks are of the recording with the set-up of the estimate.
        delay = check.delay + sum(
            each.value for each in evidence.setup if each.kind == "delay" and check.of == "wrench"
        )
        values: dict[str, Any] = {key: getattr(check, key) for key in ("of", "std", "stated", "misfit")}
        yield Finding.of("channels_late", delay=delay, **values)


def setup_remarks(evidence: Evidence) -> Iterator[Finding]:
    """Set-up errors, and a doubt where none explains the recording."""
    for each in evidence.setup:
        yield Finding.of(each.code, each.place, **each.values)
    if evidence.trajectory is not None and evidence.trajectory.search.incredible:
        yield Finding.of("setup_unexplained", changed=bool(evidence.setup))


def course_findings(evidence: Evidence) -> Iterator[Finding]:
    """A doubt on a trajectory estimate that has not converged."""
    if evidence.trajectory is None:
        return
    fit = evidence.trajectory.fit
    if fit.status == "interrupted" or (fit.status != "converged" and fit.trace[-1] > RESTLESS):
        yield Finding.of("not_converged", status=fit.status, rounds=len(fit.trace))


def halves_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on halves and logs that disagree."""
    if evidence.disagreement is not None and evidence.disagreement > DISAGREE:
        yield Finding.of("halves_disagree", rms_z=evidence.disagreement)
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


def prior_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on a prior that was used, and on the need for it."""
    if evidence.trajectory is not None and evidence.trajectory.known:
        yield Finding.of("prior_beside_data" if _separated(evidence) else "prior_needed")


def _separated(evidence: Evidence) -> bool:
    """True if the data of an estimate with a prior determine every base parameter without it."""
    before = known_covariance(
        evidence.mechanism, evidence.fit.parameters, evidence.known, evidence.fit.equations.absorbed
    )
    # Of the variance with the prior, over that of the prior alone, this share is left where the data's own is so large.
    share = FAR_LESS**2 / (1 + FAR_LESS**2)
    left = linalg.eigvalsh(evidence.covariance / evidence.widening**2, before)
    return evidence.condition_number < CONDITION_LIMIT and bool(left[-1] < share)


def model_error_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubt on channels whose residuals depend on the motion."""
    if evidence.model_error is None:
        return
    shares = zip(evidence.channels, evidence.model_error, evidence.ratios.values(), strict=True)
    if channels := tuple(c for c, share, ratio in shares if share > OF_THE_MOTION and ratio > WORTH_IT):
        yield Finding.of("residual_follows_motion", Place(channels=channels), channels=channels)


def beyond_fast_noise(fit: TrajectoryFit, channels: Sequence[str]) -> dict[str, float]:
    """Noise of channels that are far above the sensor's fast noise, over it, by channel."""
    large = dict[str, float]()
    for c, (channel, noise) in enumerate(zip(channels, fit.channel_noise, strict=False)):
        fast = white_noise(*(piece.measured[:, c] for piece in fit.pieces), robust=True)
        if noise > FAR_ABOVE * max(fast, float(fit.noises[0].floor_channels[c])):
            large[channel] = float(noise / max(fast, TINIEST))
    return large


def slow_residual_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on channels whose residual is far above the sensor's noise; intervals include it."""
    if evidence.trajectory is None:
        return
    if large := beyond_fast_noise(evidence.trajectory.fit, evidence.channels):
        every = 1 < len(large) == len(evidence.channels)
        yield Finding.of("residual_above_fast_noise", Place(channels=tuple(large)), factors=large, all_channels=every)


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
            yield Finding.of(code, Place(channels=tuple(between)), ratios=between, part=evidence.part)


def inseparable_findings(evidence: Evidence) -> Iterator[Finding]:
    """A remark on channels whose constant offset cannot be separated from parameters."""
    if channels := evidence.inseparable:
        yield Finding.of("inseparable_offsets", Place(channels=channels), channels=channels)


def stuck_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on channels that never change although the model predicts it: left out, or fitted in one pass."""
    if evidence.constant:
        yield Finding.of("constant_channels", Place(channels=evidence.constant), channels=evidence.constant)
    if evidence.logs and (stuck := evidence.logs[0].stuck):
        yield Finding.of(
            "stuck_channels",
            Place(channels=tuple(each.channel for each in stuck)),
            channels={each.channel: each.value for each in stuck},
            in_fitted=tuple(each.channel for each in stuck if each.in_fitted),
        )


def posture_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on joints that were recorded beyond the model's ranges."""
    if not evidence.logs:
        return
    mechanism = evidence.mechanism
    beyond: dict[str, float] = {}
    coordinates = mechanism.tree.body_coordinates(evidence.logs[0].samples.motion.q)
    for joint, q in zip((body.joint for body in mechanism.tree.bodies), coordinates, strict=True):
        if joint in mechanism.ranges and q.shape[1] == 1:
            low, high = mechanism.ranges[joint]
            slack = BEYOND * (high - low)
            share = float(((q < low - slack) | (q > high + slack)).mean())
            beyond |= {joint: share} if share > RARELY else {}
    if beyond:
        yield Finding.of("beyond_joint_ranges", Place(joints=tuple(beyond)), shares=beyond)


def caveats(evidence: Evidence) -> Iterator[Finding]:
    """Remarks on the assumptions of least squares."""
    if evidence.trajectory is not None or not evidence.logs:
        return
    if evidence.logs[0].cutoff is None:
        yield Finding.of("unfiltered_wrenches")
    yield Finding.of("joint_noise_not_included")


def exact_setup_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on a set-up that is stated as uncertain, and that least squares take as exact; on torques a doubt."""
    if evidence.trajectory is not None or not evidence.logs:
        return
    joints = tuple(evidence.fit.equations.scaled)
    kinds = tuple(dict.fromkeys(kind for log in evidence.logs for kind, std in log.recording.setup.items() if std))
    if joints:
        yield Finding.of("torque_scale_taken_as_exact", Place(channels=joints), joints=joints)
    if kinds:
        yield Finding.of("setup_taken_as_exact", kinds=kinds)
