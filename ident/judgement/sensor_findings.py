"""Findings on sensors: clipped ranges, coarse steps, columns that stay the same, and checks that could not be made."""

from collections.abc import Iterator, Mapping, Sequence
from math import degrees
from typing import Any

import numpy as np

from ident.estimation.equations import COMPONENTS
from ident.estimation.preparation import Prepared
from ident.judgement.evidence import Evidence
from ident.judgement.finding import FINDINGS, Finding, Place, Row, in_log, listed, percent
from ident.recordings.resolution import UNIFORM

MOST = 0.5
"""Share of a signal's noise variance due to its steps above which there is a remark."""


def clipped_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on channels that are clipped by a sensor's range."""
    for k, log in enumerate(evidence.logs):
        for each in log.clipped:
            yield Finding.of(
                "clipped_channel",
                _place(each.channel, k),
                channel=each.channel,
                limits=each.limits,
                unit=unit_of(log, each.channel.rpartition(" ")[2]),
                share=each.share,
                kept=each.kept,
                log=k + 1 if len(evidence.logs) > 1 else None,
            )


def _place(channel: str, log: int) -> Place:
    """Place of a clipped channel: that of a contact belongs to its wrench."""
    contact, _, _ = channel.rpartition(" ")
    return Place(wrenches=(contact,), log=log) if contact else Place(channels=(channel,), log=log)


def resolution_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on channels and coordinates whose noise is mostly quantisation."""
    if not evidence.logs:
        return
    log, joint = evidence.logs[0], evidence.trajectory
    noise = dict(evidence.scale)
    if joint is not None:
        noise = dict(zip(evidence.channels, joint.fit.channel_noise.tolist(), strict=False))
        names = [f"{joint_}_position" for joint_ in log.mechanism.joints for _ in range(_coordinates(log, joint_))]
        own = joint.fit.coordinate_noise[-len(names) :] if names else np.zeros(0)
        noise |= dict(zip(names, own.tolist(), strict=True))
    least = {name: UNIFORM * step / np.sqrt(MOST) for name, step in log.steps.items()}
    coarse = {name: log.steps[name] for name, x in least.items() if x > noise.get(name, np.inf)}
    if coarse:
        place = Place(channels=tuple(name for name in coarse if name in evidence.channels))
        yield Finding.of("coarse_steps", place, steps=[_step(log, name, step) for name, step in coarse.items()])


def unchecked_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remarks on checks that could not be made."""
    for each in evidence.checks.unchecked:
        yield Finding.of("unchecked", **each._asdict())


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


def _coordinates(log: Prepared, joint: str) -> int:
    values = log.recording[f"{joint}_position"]
    return 1 if values.ndim == 1 else values.shape[1]


def _step(log: Prepared, name: str, step: float) -> dict[str, Any]:
    """A step of a channel or of a joint's position, with its unit."""
    joint = name.removesuffix("_position")
    if joint == name:
        return {"name": name, "joint": False, "step": step, "unit": unit_of(log, name)}
    return {"name": joint, "joint": True, "step": step, "unit": "rad" if _is_hinge(log, joint) else "m"}


def unit_of(log: Prepared, channel: str) -> str:
    """Unit of a channel."""
    if channel in COMPONENTS:
        return "N" if channel[0] == "F" else "N m"
    return "N m" if _is_hinge(log, channel.partition(".")[0]) else "N"


def _is_hinge(log: Prepared, joint: str) -> bool:
    """True for a joint that turns."""
    trees = [log.mechanism.tree, *([log.mechanism.carrier.tree] if log.mechanism.carrier else [])]
    return next((body.turns for tree in trees for body in tree.bodies if body.joint == joint), True)


def _clipped(channel: str, limits: Sequence[float], unit: str, share: float, kept: bool, log: int | None) -> str:
    ends = " and ".join(f"{value:.4g} {unit}" for value in limits)
    done = "These samples are" if kept else "The whole channel is"
    return (
        f"{channel} is clipped at {ends}{in_log(log)}, in {percent(share)} of its samples. {done} left out. Use a "
        "sensor with a larger range, or move more slowly."
    )


def _coarse(steps: Sequence[Mapping[str, Any]]) -> str:
    return (
        f"Recorded in steps that are most of the noise: {listed(_step_in_words(**each) for each in steps)}. Use a "
        "finer range of the sensor, or write more digits."
    )


def _step_in_words(name: str, joint: bool, step: float, unit: str) -> str:
    """A step with its unit, of a joint's position in degrees or millimetres."""
    if not joint:
        return f"{name} {step:.2g} {unit}"
    return f"joint '{name}' " + (f"{degrees(step):.2g}°" if unit == "rad" else f"{1e3 * step:.2g} mm")


def _stuck(channels: Mapping[str, float], in_fitted: Sequence[str]) -> str:
    each = listed(
        f"{name} ({value:g}{' in what is fitted' if name in in_fitted else ''})" for name, value in channels.items()
    )
    return (
        f"Stuck at one value, though the model predicts a change, and so left out: {each}. Mend the sensor, or map "
        'columns that are not connected as missing, by "" in --columns.'
    )


def _unchecked(check: str, reason: str, channels: Sequence[str] = (), error: str = "") -> str:
    checks = {"weight": "The weight", "contact": "A contact left out", "torques": "Joint torques"}
    reasons = {
        "no gravity": "the model has no gravity",
        "no force": "no force is measured",
        "not measured": f"it shows in {listed(channels)} of the sensor, not measured here",
        "not fitted": f"it shows in {listed(channels)}, not fitted here",
        "error": error,
    }
    return f"{checks[check]} could not be checked: {reasons[reason]}."


FINDINGS.update(
    clipped_channel=Row(_clipped, doubt=False),
    coarse_steps=Row(_coarse, doubt=False),
    stuck_channels=Row(_stuck, doubt=True),
    constant_channels=Row(
        "Constant, though the motion would change it: {channels}. Check the sensor and its columns.", doubt=True
    ),
    unchecked=Row(_unchecked, doubt=False),
)
