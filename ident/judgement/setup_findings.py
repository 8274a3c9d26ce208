"""Findings on the set-up and its sensors: gravity, times, estimated errors, ranges, steps, and checks left out."""

from collections.abc import Iterator, Mapping, Sequence
from math import degrees
from typing import Any

import numpy as np

from ident.arguments import rpy_text
from ident.estimation.noise import channel_unit
from ident.estimation.preparation import Prepared
from ident.estimation.recorded_motion import WIDTH
from ident.judgement.evidence import Evidence
from ident.judgement.finding import FINDINGS, Finding, Place, doubt, judged, listed, percent, remark
from ident.judgement.fit_findings import FAR_ABOVE, fast_noise
from ident.recordings.resolution import UNIFORM

MOST = 0.5
"""Share of a signal's noise variance due to its steps above which there is a remark."""


def gravity_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubt on the stated direction of gravity."""
    check = evidence.checks.gravity
    if check is not None and check.suspicious:
        own: dict[str, Any] = {key: getattr(check, key) for key in ("rpy_deg", "stated", "misfit", "joint")}
        yield Finding.of("gravity_direction", moving=evidence.prepared.recording.base is not None, **own)


def delay_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubt on the times of channels that are late by more than the estimate includes."""
    check = evidence.checks.delay
    if check is not None and check.suspicious:
        # Checks are of the recording with the set-up of the estimate.
        included = [each.value for each in evidence.setup if each.kind == "delay" and check.of == "wrench"]
        values: dict[str, Any] = {key: getattr(check, key) for key in ("of", "std", "stated", "misfit")}
        yield Finding.of("channels_late", delay=check.delay + sum(included), **values)


def setup_remarks(evidence: Evidence) -> Iterator[Finding]:
    """Set-up errors, and a doubt where none explains the recording."""
    for each in evidence.setup:
        yield Finding.of(each.code, each.place, **each.values)
    if evidence.trajectory is not None and evidence.trajectory.search.incredible:
        yield Finding.of("setup_unexplained", changed=bool(evidence.setup))


def clipped_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on channels that are clipped by a sensor's range."""
    for k, (log, _) in enumerate(evidence.logs):
        for each in log.clipped:
            contact, _, component = each.channel.rpartition(" ")
            place = Place(wrenches=(contact,), log=k) if contact else Place(channels=(component,), log=k)
            values: dict[str, Any] = {key: getattr(each, key) for key in ("channel", "limits", "share", "kept")}
            unit, number = channel_unit(component, log.mechanism.tree), k + 1 if len(evidence.logs) > 1 else None
            yield Finding.of("clipped_channel", place, unit=unit, log=number, **values)


def resolution_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on channels and coordinates whose noise is mostly quantisation."""
    log, joint = evidence.prepared, evidence.trajectory
    noise = dict(zip(evidence.channels, evidence.scale.tolist(), strict=True))
    if joint is not None:
        noise = dict(zip(evidence.channels, joint.fit.channel_noise.tolist(), strict=False))
        each = [f"{name}_position" for name in log.mechanism.joints]
        names = [name for name in each for _ in np.atleast_2d(log.recording[name].T)]
        own = joint.fit.coordinate_noise[-len(names) :] if names else np.zeros(0)
        noise |= dict(zip(names, own.tolist(), strict=True))
    least = {name: UNIFORM * step / np.sqrt(MOST) for name, step in log.steps.items()}
    coarse = {name: log.steps[name] for name, x in least.items() if x > noise.get(name, np.inf)}
    if coarse:
        place = Place(channels=tuple(name for name in coarse if name in evidence.channels))
        yield Finding.of("coarse_steps", place, steps=[_step(log, name, step) for name, step in coarse.items()])


def tracked_findings(evidence: Evidence) -> Iterator[Finding]:
    """Noise of each tracked body's poses; a doubt where it is far above their fast noise."""
    if (joint := evidence.trajectory) is None:
        return
    fit, first = joint.fit, len(joint.measurement.equations.channels)
    for name, tracked in joint.measurement.tracked.items():
        own, first = range(first, first + WIDTH), first + WIDTH
        noise, floor = fit.channel_noise[own], np.maximum(fast_noise(fit, own), fit.noises[0].floor_channels[own])
        position, orientation = np.sqrt((noise.reshape(2, 3) ** 2).mean(axis=1)).tolist()
        times, place = float(np.max(noise / floor)), Place(bodies=(evidence.mechanism.tree.names[tracked.body],))
        values = {"name": name, "position": position, "orientation": orientation, "times": times}
        yield Finding.of("tracked_poses", place, times > FAR_ABOVE, **values)


def unchecked_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remarks on checks that could not be made."""
    for each in evidence.checks.unchecked:
        yield Finding.of("unchecked", **each)


def stuck_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on channels that never change although the model predicts it."""
    if stuck := evidence.prepared.stuck:
        in_fitted = tuple(each.channel for each in stuck if each.in_fitted)
        yield Finding.of("stuck_channels", channels={each.channel: each.value for each in stuck}, in_fitted=in_fitted)


def _step(log: Prepared, name: str, step: float) -> dict[str, Any]:
    """A step of a channel or of a joint's position, with its unit."""
    joint = name.removesuffix("_position")
    if joint == name:
        return {"name": name, "joint": False, "step": step, "unit": channel_unit(name, log.mechanism.tree)}
    return {"name": joint, "joint": True, "step": step, "unit": "rad" if _is_hinge(log, joint) else "m"}


def _is_hinge(log: Prepared, joint: str) -> bool:
    """True for a joint that turns."""
    trees = [log.mechanism.tree, *([log.mechanism.carrier.tree] if log.mechanism.carrier else [])]
    return next((body.turns for tree in trees for body in tree.bodies if body.joint == joint), True)


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


def _clipped(channel: str, limits: Sequence[float], unit: str, share: float, kept: bool, log: int | None) -> str:
    ends = " and ".join(f"{value:.4g} {unit}" for value in limits)
    where = "" if log is None else f" in log {log}"
    done = "These samples are" if kept else "The whole channel is"
    return (
        f"{channel} is clipped at {ends}{where}, in {percent(share)} of its samples. {done} left out. Use a "
        "sensor with a larger range, or move more slowly."
    )


def _coarse(steps: Sequence[Mapping[str, Any]]) -> str:
    each = listed((_step_in_words(**step) for step in steps), "columns")
    return (
        f"Recorded in steps that are most of the noise: {each}. Use a finer range of the sensor, or write more digits."
    )


def _step_in_words(name: str, joint: bool, step: float, unit: str) -> str:
    """A step with its unit, of a joint's position in degrees or millimetres."""
    if not joint:
        return f"{name} {step:.2g} {unit}"
    return f"joint '{name}' " + (f"{degrees(step):.2g}°" if unit == "rad" else f"{1e3 * step:.2g} mm")


def _stuck(channels: Mapping[str, float], in_fitted: Sequence[str]) -> str:
    each = (f"{name} ({value:g}{' in what is fitted' * (name in in_fitted)})" for name, value in channels.items())
    return (
        f"Stuck at one value, though the model predicts a change, and so left out: {listed(each, 'channels')}. Mend "
        'the sensor, or map columns that are not connected as missing, by "" in --columns.'
    )


def _tracked(name: str, position: float, orientation: float, times: float) -> str:
    text = f"The poses '{name}' have noise of {1e3 * position:.2g} mm and {degrees(orientation):.2g}°"
    if times <= FAR_ABOVE:
        return f"{text}."
    return (
        f"{text}, up to {times:.0f} times what they have from sample to sample. Check the body, the units and order of "
        "columns, and whether the tracker lags behind the joint angles."
    )


def _unchecked(check: str, reason: str, channels: Sequence[str] = (), error: str = "") -> str:
    checks = {"weight": "The weight", "contact": "A contact left out", "torques": "Joint torques"}
    reasons = {
        "no gravity": "the model has no gravity",
        "no force": "no force is measured",
        "not measured": f"it shows in {listed(channels, 'channels')} of the sensor, not measured here",
        "not fitted": f"it shows in {listed(channels, 'channels')}, not fitted here",
        "error": error,
    }
    return f"{checks[check]} could not be checked: {reasons[reason]}."


FINDINGS.update(
    gravity_direction=doubt(_gravity),
    channels_late=doubt(_late),
    setup_unexplained=doubt(_unexplained),
    clipped_channel=remark(_clipped),
    coarse_steps=remark(_coarse),
    tracked_poses=judged(_tracked),
    stuck_channels=doubt(_stuck, channels="channels"),
    unchecked=remark(_unchecked),
)
