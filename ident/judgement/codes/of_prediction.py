"""Sentences on the prediction of the samples to judge by: the candidates, and the residual of each channel."""

from collections.abc import Mapping, Sequence
from typing import Any

from ident.judgement.codes.row import Row, bracketed, listed, percent

CANDIDATES = {"estimate": "the estimate", "model": "the model as it came", "least squares": "least squares"}
"""Candidates in words."""


def _worse(worse: Mapping[str, Mapping[str, Sequence[float]]], **advice: Any) -> str:
    parts = [f"{CANDIDATES[name]} in {_pairs(channels)}" for name, channels in worse.items()]
    return f"Worse than {', and than '.join(parts)}, residual over signal. {_advice('model' in worse, **advice)}"


def _pairs(channels: Mapping[str, Sequence[float]]) -> str:
    """The estimate's ratios beside another candidate's, of the worst channel if there are many."""
    pairs = [f"{channel} ({own:.3g} against {other:.3g})" for channel, (own, other) in channels.items()]
    more = [own - other for own, other in channels.values()]
    most = pairs[more.index(max(more))]
    return listed(pairs) if len(pairs) <= NAMED else f"{len(pairs)} channels, most in {most}"


NAMED = 4
"""Largest number of channels that a sentence on candidates names; the table of channels has all."""


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


def _ratios(what: str, do: str = "", *, doubt: bool) -> Row:
    def sentence(ratios: Mapping[str, float], part: str) -> str:
        return f"{what}, {part} residual over signal in brackets: {bracketed(ratios)}.{do}"

    return Row(sentence, doubt)


def _follow_motion(channels: Sequence[str]) -> str:
    return (
        f"Residuals of {listed(channels)} depend on the motion: the model lacks something of the mechanism. Check its "
        "dimensions, joints and contacts."
    )


LACKS = {
    "force": "a force on '{body}' that changes with its place (cable, spring)",
    "length": "another distance of the joint of '{body}' from the body that carries it",
}
"""Words for the forces and lengths that a model may lack, by kind."""


def _unmodelled(causes: Sequence[Mapping[str, str]], ratio: float) -> str:
    first, *others = (LACKS[cause["kind"]].format(body=cause["body"]) for cause in causes)
    return (
        "The model lacks something, which the parameters take up in part. "
        f"The residual where it is judged would be {percent(1 - ratio)} smaller with {first}."
        f"{''.join(f' Or it is {other}.' for other in others)} Add it to the model."
    )


_DEAD = "Residuals larger than the channel's own variation"

PREDICTION = {
    "worse_than_candidate": Row(_worse, doubt=True),
    "candidate_better": Row(_better, doubt=False),
    "residual_above_signal": _ratios(_DEAD, " Look for a constant offset or a dead sensor.", doubt=True),
    "unexplained_channels": _ratios("Not explained by this motion", doubt=False),
    "poor_prediction": _ratios("Predicted poorly", doubt=False),
    "residual_follows_motion": Row(_follow_motion, doubt=True),
    "unmodelled": Row(_unmodelled, doubt=True),
    "residual_above_fast_noise": Row(_beyond_fast_noise, doubt=False),
}
