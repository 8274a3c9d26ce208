"""Sentences on sensors, what could not be checked, and the set-up: its deviations from what is stated."""

from collections.abc import Mapping, Sequence
from functools import partial
from math import degrees
from typing import Any

from ident.arguments import rpy_text
from ident.judgement.codes.row import Row, in_log, listed, percent
from ident.judgement.setup_findings import setup_sentence
from ident.setup import SETUP as KINDS


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


def _unexplained(changed: bool) -> str:
    taken = "nothing else of it was changed" if changed else "the set-up was taken as stated"
    return (
        f"No set-up near the stated one explains the recording, whose residuals are more than noise; {taken}. Check "
        "contacts, frames, units and the model."
    )


def _gravity(rpy_deg: Sequence[float], stated: float, misfit: float, joint: str | None, moving: bool) -> str:
    rpy, option = rpy_text(rpy_deg), " ".join(f"{angle:g}" for angle in rpy_deg)
    of = "axes of the base's poses are" if moving else "base is"
    zero = "" if joint is None else f" Another zero of joint '{joint}' would look the same."
    return (
        f"Gravity has another direction than stated: the {of} turned to roll, pitch and yaw {rpy}°. With it the model "
        f"leaves {misfit:.2f} of the measurements unexplained, as stated {stated:.2f}. Write rpy_deg = {rpy} under "
        f"[base] in the columns file, or --base-rpy {option}.{zero}"
    )


def _late(of: str, delay: float, std: float, stated: float, misfit: float) -> str:
    how = "late behind" if delay > 0 else "early before"
    cure = f"Write delay = {abs(delay):.2g} under [setup] in the columns file, so that the estimate includes it"
    if of == "torques":
        cure = f"Log them in a file of their own, with constant = {-delay:.2g} for its times in the columns file"
    return (
        f"The {of} {'looks' if of == 'wrench' else 'look'} {1e3 * abs(delay):.0f} ± {1e3 * std:.0f} ms {how} the joint "
        f"angles. With that the model leaves {misfit:.2f} of the measurements unexplained, without it {stated:.2f}. "
        f"{cure}."
    )


SETUP = {f"setup_{kind}": Row(partial(setup_sentence, kind), doubt=False) for kind in KINDS} | {
    "gravity_direction": Row(_gravity, doubt=True),
    "channels_late": Row(_late, doubt=True),
    "setup_unexplained": Row(_unexplained, doubt=True),
}
