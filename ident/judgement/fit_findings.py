"""How a fit went, what of the set-up it found, and what it leaves of each channel."""

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from scipy import linalg

from ident.judgement.finding import Finding, Place
from ident.judgement.halves import DISAGREE
from ident.parameters.prior import KNOWN, known_covariance
from ident.recordings.resolution import white_noise
from ident.tolerances import CONDITION_LIMIT, LEFT, POOR, UNEXPLAINED

if TYPE_CHECKING:
    from ident.estimate import Estimate

RESTLESS = 0.3
"""Last step of the trajectory estimate, in standard deviations, from which it is a doubt that it did not settle."""

OF_THE_MOTION, WORTH_IT = 0.5, 0.02
"""Share of a residual's variance that posture and motion explain, beyond chance, from which it is a doubt, if the
residual is more than so much of the signal."""

FAR_ABOVE = 3.0
"""Noise of a channel over what is fast of it, or its floor, from which it is worth a remark."""

FAR_LESS = 30.0
"""Standard deviation from the data, over that of what is known beforehand, from which the motion tells nothing."""

TINIEST = 1e-300

FAR_APART = 4.0
"""Distance of one log's base parameters from those of the others, in standard deviations, from which it is a doubt."""

BEYOND, RARELY = 0.05, 0.01
"""How far beyond a joint's range, of the range, and for which share of the samples a posture is not worth a word."""


def setup_remarks(result: "Estimate") -> Iterator[Finding]:
    """What of the set-up is not as stated."""
    for each in result.setup:
        yield Finding(each.text, False, each.place)
    if result.trajectory is not None and result.trajectory.search.incredible:
        taken = "nothing else of it was changed" if result.setup else "the set-up was taken as stated"
        yield Finding(
            "No set-up near the one that was stated explains the recording, though something is wrong beyond noise: a "
            f"contact, a frame, a unit, or the model; {taken}.",
            True,
        )


def course_findings(result: "Estimate") -> Iterator[Finding]:
    """How the trajectory estimate went."""
    if result.trajectory is None:
        return
    fit = result.trajectory.fit
    if fit.status == "interrupted" or (fit.status != "converged" and fit.trace[-1] > RESTLESS):
        how = {"interrupted": "was interrupted", "stuck": "found no better step"}.get(fit.status, "did not settle")
        rounds = "1 round" if len(fit.trace) == 1 else f"{len(fit.trace)} rounds"
        yield Finding(f"The trajectory estimate {how} after {rounds}; its last iterate is given.", True)


def halves_findings(result: "Estimate") -> Iterator[Finding]:
    """Whether parts of the data agree."""
    if result.widening > 1:
        yield Finding(
            f"Two halves of the data differ by {result.disagreement:.1f} of their standard deviations from the noise "
            "(root mean square): model or set-up are not quite right, and those deviations are widened by as much.",
            False,
        )
    if apart := [f"{k} ({z:.1f})" for k, z in enumerate(result.disagreements, start=1) if z > DISAGREE]:
        yield Finding(
            f"Logs disagree: what each says of the base parameters differs from what the others say, in standard "
            f"deviations from the noise (root mean square) of log {', '.join(apart)}. Something changed between them, "
            "as a load, a mounting or friction; look at them one by one.",
            max(result.disagreements) > FAR_APART,
        )


def prior_findings(result: "Estimate") -> Iterator[Finding]:
    """Whether what the model says was put in, and whether the motion needed it."""
    if result.trajectory is not None and result.trajectory.known:
        put = "what the model says of its bodies, give or take, was put in"
        if _separated(result):
            text = f"As asked for, {put}; the motion would separate the base parameters without it."
        else:
            text = f"The motion does not separate all base parameters; {put}, and those that the data hardly see stay "
            text += "near it."
        yield Finding(text, False)


def _separated(result: "Estimate") -> bool:
    """Whether the data of an estimate that has a prior tell every base parameter without it."""
    known = {**KNOWN, **result.prepared.recording.known}
    before = known_covariance(result.prepared.mechanism, result.base, known)
    # Of the variance with the prior, over that of the prior alone, this share is left where the data's own is so large.
    share = FAR_LESS**2 / (1 + FAR_LESS**2)
    left = linalg.eigvalsh(result.covariance / result.widening**2, before)
    return result.condition_number < CONDITION_LIMIT and bool(left[-1] < share)


def model_error_findings(result: "Estimate") -> Iterator[Finding]:
    """Channels whose residuals are not noise."""
    if result.trajectory is None:
        return
    shares = zip(result.channels, result.model_error, result.held_out.ratio, strict=True)
    if correlated := [c for c, share, ratio in shares if share > OF_THE_MOTION and ratio > WORTH_IT]:
        yield Finding(
            f"Residuals of {', '.join(correlated)} go with the motion: the model is not quite that of the mechanism.",
            True,
            Place(channels=tuple(correlated)),
        )


def slow_residual_findings(result: "Estimate") -> Iterator[Finding]:
    """A remark on channels of which more is left than a sensor's noise: intervals include it."""
    if result.trajectory is None:
        return
    fit, large = result.trajectory.fit, dict[str, float]()
    for c, (channel, noise) in enumerate(zip(result.channels, fit.noise.channels, strict=True)):
        fast = white_noise(*(piece.measured[:, c] for piece in fit.pieces), robust=True)
        if noise > FAR_ABOVE * max(fast, float(fit.noise.floor_channels[c])):
            large[channel] = noise / max(fast, TINIEST)
    if large:
        if 1 < len(large) == len(result.channels):
            least, most = _times(min(large.values())), _times(max(large.values()))
            times = least if least == most else f"{least} to {most}"
            what = f"In all channels what is left is far more than the fast noise of the sensors, {times} times."
        else:
            listed = ", ".join(f"{channel} {_times(times)} times" for channel, times in large.items())
            what = f"What is left is far more than the fast noise of the sensors: {listed}."
        yield Finding(
            f"{what} The model is not quite right, the trajectory cannot follow jumps, or the channel was low-passed "
            "before; what is left, and how slow it is, is in the standard deviations.",
            False,
            Place(channels=tuple(large)),
        )


def _times(factor: float) -> str:
    return "over 100" if factor > 100 else f"{factor:.0f}"


def quality_findings(ratios: Mapping[str, float], part: str) -> Iterator[Finding]:
    """What residuals over signals, of each channel on some part, say."""
    more = "More is left over than the channel varies, as of a constant offset or a sensor that died"
    kinds = (
        (more, LEFT, np.inf, True),
        ("Not explained by this motion", UNEXPLAINED, LEFT, False),
        ("Predicted poorly", POOR, UNEXPLAINED, False),
    )
    for what, low, high, doubt in kinds:
        if found := {channel: ratio for channel, ratio in ratios.items() if low < ratio <= high}:
            listed = ", ".join(f"{channel} ({ratio:.3g})" for channel, ratio in found.items())
            text = f"{what}, {part} residual over standard deviation in brackets: {listed}."
            yield Finding(text, doubt, Place(channels=tuple(found)))


def inseparable_findings(channels: Sequence[str]) -> Iterator[Finding]:
    """A remark on channels whose constant offset cannot be told."""
    if channels:
        yield Finding(
            f"Constant offsets of {', '.join(channels)} cannot be told from masses and first moments: "
            "those take them up.",
            False,
            Place(channels=tuple(channels)),
        )


def stuck_findings(result: "Estimate") -> Iterator[Finding]:
    """Channels that never change, though they should."""
    if result.prepared.stuck:
        yield Finding(
            f"Stuck at one value, though the model says that they change, and so left out: "
            f'{", ".join(result.prepared.stuck)}. Mend the sensor, or map what is not connected as missing, by "" in '
            "--columns.",
            True,
            Place(channels=tuple(each.partition(" (")[0] for each in result.prepared.stuck)),
        )


def posture_findings(result: "Estimate") -> Iterator[Finding]:
    """Joints that were recorded beyond the model's ranges."""
    mechanism = result.prepared.mechanism
    beyond: dict[str, str] = {}
    coordinates = mechanism.tree.body_coordinates(result.prepared.samples.motion.q)
    for joint, q in zip((body.joint for body in mechanism.tree.bodies), coordinates, strict=True):
        if joint in mechanism.ranges and q.shape[1] == 1:
            low, high = mechanism.ranges[joint]
            slack = BEYOND * (high - low)
            share = float(((q < low - slack) | (q > high + slack)).mean())
            beyond |= {joint: f"{joint} ({share:.0%} of the samples)"} if share > RARELY else {}
    if beyond:
        yield Finding(
            f"Joints are recorded beyond the model's ranges: {', '.join(beyond.values())}; a zero, a sign or a unit "
            "may be wrong.",
            True,
            Place(joints=tuple(beyond)),
        )


def caveats(result: "Estimate") -> Iterator[Finding]:
    """What least squares takes for granted."""
    if result.trajectory is not None:
        return
    if result.prepared.cutoff is None:
        yield Finding(
            "Velocities and accelerations are the log's own and the wrenches are not filtered: if the log's were, "
            "--cutoff auto treats both alike.",
            False,
        )
    yield Finding(
        "The standard deviations are those of noise on the wrenches; noise on the joint angles biases the estimate "
        "and is not in them.",
        False,
    )
