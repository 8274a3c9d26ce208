"""Sentences on the prediction of held-out samples: the candidates, and the residual of each channel."""

from collections.abc import Mapping, Sequence
from typing import Any

from ident.judgement.codes.row import Row, bracketed, listed, percent

CANDIDATES = {"estimate": "the estimate", "model": "the model as it came", "least squares": "least squares"}
"""Candidates in words."""


def _worse(worse: Mapping[str, Mapping[str, Sequence[float]]], **advice: Any) -> str:
    parts = [
        f"{CANDIDATES[name]} in "
        + listed(f"{channel} ({own:.3g} against {other:.3g})" for channel, (own, other) in channels.items())
        for name, channels in worse.items()
    ]
    return (
        f"Worse than {', and than '.join(parts)}, held-out residual over signal. {_advice('model' in worse, **advice)}"
    )


SHOWN = 8
"""Largest number of channels whose residuals a sentence lists."""


def _better(candidate: str, behind: float, ratios: Mapping[str, Sequence[float]]) -> str:
    pairs = [f"{channel} {other:.3g} against {own:.3g}" for channel, (own, other) in ratios.items()]
    more = f" and {len(pairs) - SHOWN} more" if len(pairs) > SHOWN else ""
    name = CANDIDATES[candidate]
    return (
        f"{name[0].upper()}{name[1:]} predicts better than the estimate, by {percent(behind - 1)} in the median "
        f"channel. For prediction alone it is the better choice; residual over signal: {listed(pairs[:SHOWN])}{more}."
    )


def _advice(model_too: bool, take: str, cutoff_hz: float | None) -> str:
    if take == "model":
        return "Keep the model."
    if take == "least squares":
        cutoff = "" if cutoff_hz is None else f" --cutoff {cutoff_hz:.3g}"
        return f"Take least squares: --estimator weighted{cutoff}."
    keep = "Keep the model, or move" if model_too else "Move"
    return (
        f"{keep} the joints further. Least squares had the model's bodies for a prior here, and --estimator weighted "
        "alone does not separate the parameters."
    )


def _beyond_fast_noise(factors: Mapping[str, float], all_channels: bool) -> str:
    if all_channels:
        least, most = _times(min(factors.values())), _times(max(factors.values()))
        times = least if least == most else f"{least} to {most}"
        what = f"In all channels what is left is far more than the fast noise of the sensors, {times} times."
    else:
        each = listed(f"{channel} {_times(factor)} times" for channel, factor in factors.items())
        what = f"What is left is far more than the fast noise of the sensors: {each}."
    return (
        f"{what} The model is not quite right, the trajectory cannot follow jumps, or the channel was low-passed "
        "before. The standard deviations include what is left, and how slow it is."
    )


def _times(factor: float) -> str:
    return "over 100" if factor > 100 else f"{factor:.0f}"


def _ratios(what: str, advice: str = "", *, doubt: bool) -> Row:
    def sentence(ratios: Mapping[str, float], part: str) -> str:
        return f"{what}, {part} residual over signal in brackets: {bracketed(ratios)}.{advice}"

    return Row(sentence, doubt)


def _follow_motion(channels: Sequence[str]) -> str:
    return f"Residuals of {listed(channels)} go with the motion: the model is not quite that of the mechanism."


LACKS = {
    "force": "a force on '{body}' by its place (cable, spring)",
    "length": "another length up to the joint of '{body}'",
}
"""Words for the forces and lengths that a model may lack, by kind."""


def _unmodelled(causes: Sequence[Mapping[str, str]], ratio: float) -> str:
    each = " or ".join(LACKS[cause["kind"]].format(body=cause["body"]) for cause in causes)
    return (
        f"The model lacks something that the parameters take up in part. What is held out leaves {percent(1 - ratio)} "
        f"less with this: {each}."
    )


PREDICTION = {
    "worse_than_candidate": Row(_worse, doubt=True),
    "candidate_better": Row(_better, doubt=False),
    "residual_above_signal": _ratios(
        "More is left than the channel varies", " Look for a constant offset or a dead sensor.", doubt=True
    ),
    "unexplained_channels": _ratios("Not explained by this motion", doubt=False),
    "poor_prediction": _ratios("Predicted poorly", doubt=False),
    "residual_follows_motion": Row(_follow_motion, doubt=True),
    "unmodelled": Row(_unmodelled, doubt=True),
    "residual_above_fast_noise": Row(_beyond_fast_noise, doubt=False),
}
