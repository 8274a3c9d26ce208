"""Findings on a fit: its residuals, course, agreement of its parts, the prior, postures and assumptions."""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence

import numpy as np
from scipy import linalg

from ident.judgement.agreement import DISAGREE
from ident.judgement.candidates import NEGLIGIBLE, Candidates
from ident.judgement.evidence import Evidence
from ident.judgement.finding import FINDINGS, Finding, Row, bracketed, doubt, judged, listed, number_of, percent, remark
from ident.parameters.prior import known_covariance
from ident.recordings.resolution import white_noise
from ident.recordings.wrench import GROUND
from ident.regression.held_out import ESTIMATE
from ident.tolerances import CONDITION_LIMIT, LEFT, POOR, UNEXPLAINED
from ident.trajectory.fit.fitted import TrajectoryFit

RESTLESS = 0.3
"""Last step of the trajectory estimate, in standard deviations, from which it counts as not converged."""

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

BEYOND, RARELY = 0.05, 0.01
"""Distance beyond a joint's range, of the range, and share of the samples up to which no remark is made."""

OF_THE_MOTION = 0.5
"""Share of a residual's variance that posture and motion explain, beyond chance, from which it is a doubt, if the
residual is not negligible."""

FAR_ABOVE = 3.0
"""Noise of a channel over its high-frequency part, or its floor, from which there is a remark."""


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


def posture_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on joints that were recorded beyond the model's ranges."""
    mechanism = evidence.mechanism
    beyond: dict[str, float] = {}
    coordinates = mechanism.tree.body_coordinates(evidence.prepared.samples.motion.q)
    for joint, q in zip((body.joint for body in mechanism.tree.bodies), coordinates, strict=True):
        if joint in mechanism.ranges and q.shape[1] == 1:
            low, high = mechanism.ranges[joint]
            slack = BEYOND * (high - low)
            share = float(((q < low - slack) | (q > high + slack)).mean())
            beyond |= {joint: share} if share > RARELY else {}
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
    """Doubt on channels whose residuals depend on the motion."""
    if evidence.trajectory is None:
        return
    shares = zip(evidence.channels, evidence.model_error, evidence.ratios.values(), strict=True)
    if channels := tuple(c for c, share, ratio in shares if share > OF_THE_MOTION and ratio > NEGLIGIBLE):
        yield Finding.of("residual_follows_motion", channels=channels)


def slow_residual_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on channels whose residual is far above the sensor's noise; intervals include it."""
    if evidence.trajectory is None:
        return
    if large := beyond_fast_noise(evidence.trajectory.fit, evidence.channels):
        every = 1 < len(large) == len(evidence.channels)
        yield Finding.of("residual_above_fast_noise", factors=large, all_channels=every)


def beyond_fast_noise(fit: TrajectoryFit, channels: Sequence[str]) -> dict[str, float]:
    """Noise of channels that are far above the sensor's fast noise, over it, by channel."""
    number = len(fit.channel_noise[: len(channels)])
    fast, floor = fast_noise(fit, range(number)), fit.noises[0].floor_channels[:number]
    far = fit.channel_noise[:number] > FAR_ABOVE * np.maximum(fast, floor)
    factors = fit.channel_noise[:number] / np.maximum(fast, 1e-300)
    return {channels[c]: float(factors[c]) for c in np.flatnonzero(far).tolist()}


def fast_noise(fit: TrajectoryFit, columns: Iterable[int]) -> np.ndarray:
    """Noise of channels from sample to sample (k,)."""
    return np.array([white_noise(*(piece.measured[:, c] for piece in fit.pieces), robust=True) for c in columns])


def _not_converged(status: str, rounds: int) -> str:
    how = {"interrupted": "was interrupted", "stuck": "found no better step"}.get(status, "did not settle")
    after = number_of(rounds, "round")
    return f"The trajectory estimate {how} after {after}. Its last iterate is given; do not rely on it."


def _logs_disagree(logs: Sequence[int], rms_z: Sequence[float], best: Sequence[int] = ()) -> str:
    names = listed((f"log {log}" for log in best), "logs")
    still = f" It still predicts {names} best, or about as well as other candidates." * bool(best)
    each = bracketed({f"log {log}": z for log, z in zip(logs, rms_z, strict=True)}, "logs", ".1f")
    return (
        "Logs disagree on the base parameters, in root mean square standard deviations of the noise: "
        f"{each}.{still} A load, a mounting or friction may have changed: identify the logs one by one."
    )


def _own_in_logs(values: Mapping[str, Sequence[float]]) -> str:
    each = listed((f"{name} ({', '.join(f'{x:.2g}' for x in own)})" for name, own in values.items()), "of them")
    return (
        f"Friction and offsets differ between logs, so that each log has its own: {each}. Other logs are predicted "
        "with their means."
    )


def _ratios(row: Callable[..., Row], what: str, end: str = "") -> Row:
    """Row of channels by the size of their residuals."""
    return row(f"{what}, {{part}} residual over signal in brackets: {{ratios:channels .3g}}.{end}", channels="ratios")


def _beyond_fast_noise(factors: Mapping[str, float], all_channels: bool) -> str:
    times = {channel: "over 100" if factor > 100 else f"{factor:.0f}" for channel, factor in factors.items()}
    if all_channels:
        ends = dict.fromkeys(times[choose(factors, key=factors.__getitem__)] for choose in (min, max))
        what = f"In all channels the residual is far above the fast noise of the sensors, {' to '.join(ends)} times."
    else:
        each = listed((f"{channel} {factor} times" for channel, factor in times.items()), "channels")
        what = f"The residual is far above the fast noise of the sensors: {each}."
    return (
        f"{what} The model is not quite right, the trajectory cannot follow jumps, or the channel was low-passed "
        "before. The standard deviations include this residual and its correlation."
    )


def _beyond_ranges(shares: Mapping[str, float]) -> str:
    each = listed((f"{joint} ({percent(share)} of the samples)" for joint, share in shares.items()), "joints")
    return f"Joints are recorded beyond the model's ranges: {each}. Check zero, sign and unit of their columns."


FINDINGS.update(
    residual_above_signal=_ratios(
        doubt,
        "Residuals larger than the channel's own variation",
        " Look for a constant offset or a dead sensor.",
    ),
    unexplained_channels=_ratios(remark, "Not explained by this motion"),
    poor_prediction=_ratios(remark, "Predicted poorly"),
    residual_follows_motion=doubt(
        "Residuals of {channels} depend on the motion: the model lacks something of the mechanism. Check its "
        "dimensions, joints and contacts.",
        channels="channels",
    ),
    residual_above_fast_noise=remark(_beyond_fast_noise, channels="factors"),
    not_converged=doubt(_not_converged),
    halves_disagree=remark(
        "Two halves of the data differ by {rms_z:.1f} standard deviations of the noise (root mean square). Model or "
        "set-up are not quite right; all standard deviations are widened by as much."
    ),
    logs_disagree=judged(_logs_disagree),
    own_in_logs=remark(_own_in_logs),
    prior_beside_data=remark(
        "The model's bodies served as a prior, though the recordings determine all base parameters without it."
    ),
    prior_needed=remark(
        "The recordings alone do not determine all base parameters: the model's bodies served as a prior. Parameters "
        "that the data hardly determine stay near the model's; move further and faster to determine more."
    ),
    beyond_joint_ranges=doubt(_beyond_ranges, joints="shares"),
    torque_scale_taken_as_exact=doubt(
        "Least squares take the scale of the torques of {joints} as exact, though it is stated as uncertain "
        "(torque_std, kp_std). The standard deviations are without its error; --estimator trajectory estimates it.",
        channels="joints",
    ),
    setup_taken_as_exact=remark(
        "Least squares take the set-up as exact, though it is stated as uncertain ({kinds}). The standard "
        "deviations are without its errors; --estimator trajectory estimates them."
    ),
    unfiltered_wrenches=remark(
        "Velocities and accelerations are the log's own, and wrenches are not filtered. If the log's were filtered, "
        "--cutoff auto treats both alike."
    ),
    joint_noise_not_included=remark(
        "The standard deviations are those of noise on the wrenches. Noise on the joint angles biases the estimate, "
        "and is not in them; --estimator trajectory includes it."
    ),
)
