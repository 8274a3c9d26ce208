"""Sentences on sensors: ranges, steps, channels that are constant, and what could not be checked."""

from collections.abc import Mapping, Sequence
from math import degrees
from typing import Any

from ident.judgement.codes.row import Row, in_log, listed, percent


def _clipped(channel: str, limits: Sequence[float], unit: str, share: float, kept: bool, log: int | None) -> str:
    ends = " and ".join(f"{value:.4g} {unit}" for value in limits)
    done = "These samples are" if kept else "The whole channel is"
    return (
        f"{channel} is clipped at {ends}{in_log(log)}, in {percent(share)} of its samples. {done} left out. Use a "
        "sensor with a larger range, or move more slowly."
    )


def _coarse(steps: Sequence[Mapping[str, Any]]) -> str:
    return (
        f"Recorded in steps that are most of the noise: {listed(_step(**each) for each in steps)}. Use a finer range "
        "of the sensor, or write more digits."
    )


def _step(name: str, joint: bool, step: float, unit: str) -> str:
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


def _constant(channels: Sequence[str]) -> str:
    return f"Constant, though the motion would change it: {listed(channels)}. Check the sensor and its columns."


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


SENSORS = {
    "clipped_channel": Row(_clipped, doubt=False),
    "coarse_steps": Row(_coarse, doubt=False),
    "stuck_channels": Row(_stuck, doubt=True),
    "constant_channels": Row(_constant, doubt=True),
    "unchecked": Row(_unchecked, doubt=False),
}
