"""Findings on the residuals of each channel: how large they are, and what they depend on."""

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from ident.judgement.evidence import Evidence
from ident.judgement.finding import FINDINGS, Finding, Place, Row, bracketed, listed
from ident.recordings.resolution import white_noise
from ident.recordings.wrench import GROUND
from ident.tolerances import LEFT, POOR, UNEXPLAINED
from ident.trajectory.fit.fitted import TrajectoryFit

OF_THE_MOTION, WORTH_IT = 0.5, 0.02
"""Share of a residual's variance that posture and motion explain, beyond chance, from which it is a doubt, if the
residual is more than so much of the signal."""

FAR_ABOVE = 3.0
"""Noise of a channel over its high-frequency part, or its floor, from which there is a remark."""

TINIEST = 1e-300


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
            yield Finding.of(code, Place(channels=tuple(between)), ratios=between, part=evidence.held_out.part)


def model_error_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubt on channels whose residuals depend on the motion."""
    if evidence.trajectory is None:
        return
    shares = zip(evidence.channels, evidence.model_error, evidence.ratios.values(), strict=True)
    if channels := tuple(c for c, share, ratio in shares if share > OF_THE_MOTION and ratio > WORTH_IT):
        yield Finding.of("residual_follows_motion", Place(channels=channels), channels=channels)


def slow_residual_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on channels whose residual is far above the sensor's noise; intervals include it."""
    if evidence.trajectory is None:
        return
    if large := beyond_fast_noise(evidence.trajectory.fit, evidence.channels):
        every = 1 < len(large) == len(evidence.channels)
        yield Finding.of("residual_above_fast_noise", Place(channels=tuple(large)), factors=large, all_channels=every)


def beyond_fast_noise(fit: TrajectoryFit, channels: Sequence[str]) -> dict[str, float]:
    """Noise of channels that are far above the sensor's fast noise, over it, by channel."""
    large = dict[str, float]()
    for c, (channel, noise) in enumerate(zip(channels, fit.channel_noise, strict=False)):
        fast = white_noise(*(piece.measured[:, c] for piece in fit.pieces), robust=True)
        if noise > FAR_ABOVE * max(fast, float(fit.noises[0].floor_channels[c])):
            large[channel] = float(noise / max(fast, TINIEST))
    return large


def _ratios(what: str, do: str = "", *, doubt: bool) -> Row:
    def sentence(ratios: Mapping[str, float], part: str) -> str:
        return f"{what}, {part} residual over signal in brackets: {bracketed(ratios)}.{do}"

    return Row(sentence, doubt)


def _beyond_fast_noise(factors: Mapping[str, float], all_channels: bool) -> str:
    if all_channels:
        least, most = _times(min(factors.values())), _times(max(factors.values()))
        times = least if least == most else f"{least} to {most}"
        what = f"In all channels the residual is far above the fast noise of the sensors, {times} times."
    else:
        each = listed(f"{channel} {_times(factor)} times" for channel, factor in factors.items())
        what = f"The residual is far above the fast noise of the sensors: {each}."
    return (
        f"{what} The model is not quite right, the trajectory cannot follow jumps, or the channel was low-passed "
        "before. The standard deviations include this residual and its correlation."
    )


def _times(factor: float) -> str:
    return "over 100" if factor > 100 else f"{factor:.0f}"


_DEAD = "Residuals larger than the channel's own variation"


FINDINGS.update(
    residual_above_signal=_ratios(_DEAD, " Look for a constant offset or a dead sensor.", doubt=True),
    unexplained_channels=_ratios("Not explained by this motion", doubt=False),
    poor_prediction=_ratios("Predicted poorly", doubt=False),
    residual_follows_motion=Row(
        "Residuals of {channels} depend on the motion: the model lacks something of the mechanism. Check its "
        "dimensions, joints and contacts.",
        doubt=True,
    ),
    residual_above_fast_noise=Row(_beyond_fast_noise, doubt=False),
)
