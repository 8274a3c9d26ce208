"""Findings on what was recorded: gravity, times, frames, contacts, ranges, steps, and errors of the set-up."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ident.estimation.equations import channels_out_of_plane
from ident.estimation.noise import channel_unit
from ident.estimation.preparation import Prepared
from ident.estimation.recorded_motion import WIDTH
from ident.judgement.evidence import Evidence
from ident.judgement.finding import Finding, Place
from ident.judgement.residuals import FAR_ABOVE, fast_noise
from ident.recordings.smoothing import UNIFORM


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
        kind = "delay" if check.of == "wrench" else "torque_delay"
        included = [each.value for each in evidence.setup if each.kind == kind]
        values: dict[str, Any] = {key: getattr(check, key) for key in ("of", "std", "stated", "misfit")}
        yield Finding.of("channels_late", delay=check.delay + sum(included), **values)


def frame_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubts on wrenches of the opposite sign, in other axes or frames, or with components of the opposite sign."""
    gravity, base, frames = evidence.checks.gravity, evidence.checks.base, evidence.checks.frames
    for name, check in frames.items():
        if check.mirrored:
            yield Finding.of("mirrored_components", wrench=name, components=check.mirrored)
        if check.suspicious:
            R, turn = evidence.prepared.recording.wrench(name).pose[:3, :3], check.rotation
            straight = np.array_equal(turn, np.eye(3))
            turned = "transposed" if np.allclose(turn, R.T @ R.T) else "turned"
            yield Finding.of(
                "wrench_sign_or_axes",
                wrench=name,
                opposite=check.sign < 0,
                frame="as stated" if straight else turned,
                axes={axis: _axis(turn[:, k]) for k, axis in enumerate("xyz")},
                error=check.error,
                error_turned=check.error_turned,
                rpy_deg=gravity.rpy_deg if straight and gravity is not None and gravity.possible else None,
            )
    if base is not None and not any(check.suspicious for check in frames.values()):
        yield Finding.of("other_base", **base._asdict())


def _axis(direction: np.ndarray) -> str:
    k = int(np.argmax(np.abs(direction)))
    return ("-" if direction[k] < 0 else "") + "xyz"[k]


def contact_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubt on an unmeasured contact: forces through one point that explain half of the moment of large residuals."""
    # Where noise alone is left, no contact shows.
    counted = [ratio for channel, ratio in evidence.ratios.items() if evidence.idle.get(channel) != "noise"]
    check = evidence.checks.contact
    if check is None or check.explained < 0.5 or not counted or np.median(counted) < 0.3:
        return
    # Noise of a measured contact is a force through its sensor as well.
    measured = {sensor.body for sensor in evidence.prepared.recording.sensors.values()}
    # Nothing touches a body further away from it than the mechanism is long.
    if check.body not in measured and np.linalg.norm(check.point) <= _length(evidence):
        yield Finding.of("contact_left_out", body=check.body, point=check.point.tolist(), explained=check.explained)


def _length(evidence: Evidence) -> float:
    """Reach of the mechanism: distance of the farthest body's frame plus twice that to its centre of mass, m."""
    mechanism = evidence.mechanism
    poses = mechanism.tree.poses(evidence.prepared.samples.motion.q)[:, list(mechanism.tree.inertial)]
    bodies = mechanism.known.reshape(-1, 10)
    centres = np.linalg.norm(bodies[:, 1:4], axis=1) / np.maximum(bodies[:, 0], 1e-12)
    return float((np.linalg.norm(poses[..., :3, 3], axis=-1) + 2 * centres).max())


def _numbered(evidence: Evidence) -> Iterator[tuple[int, Prepared, int | None]]:
    """Yields index and recording of each log, and its number in sentences where there are several."""
    for k, (log, _) in enumerate(evidence.logs):
        yield k, log, k + 1 if len(evidence.logs) > 1 else None


def unmeasured_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remarks on samples that were left out because of unmeasured contacts."""
    for k, log, number in _numbered(evidence):
        for each in log.left_out:
            place = Place(bodies=(each.body,) if each.body else (), span=(each.start, each.end), log=k)
            yield Finding.of("unmeasured_contact", place, **each._asdict(), log=number)


def clipped_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remarks on channels that are clipped by a sensor's range."""
    for k, log, number in _numbered(evidence):
        for each in log.clipped:
            contact, _, component = each.channel.rpartition(" ")
            place = Place(wrenches=(contact,), log=k) if contact else Place(channels=(component,), log=k)
            values: dict[str, Any] = {key: getattr(each, key) for key in ("channel", "limits", "share", "kept")}
            unit = channel_unit(component, log.mechanism.tree)
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
    # Steps that make half of the noise's variance.
    least = {name: UNIFORM * step / np.sqrt(0.5) for name, step in log.steps.items()}
    if coarse := {name: log.steps[name] for name, x in least.items() if x > noise.get(name, np.inf)}:
        place = Place(channels=tuple(name for name in coarse if name in evidence.channels))
        yield Finding.of("coarse_steps", place, steps=[_step(log, name, step) for name, step in coarse.items()])


def _step(log: Prepared, name: str, step: float) -> dict[str, Any]:
    """A step of a channel or of a joint's position, with its unit."""
    joint = name.removesuffix("_position")
    if joint == name:
        return {"name": name, "joint": False, "step": step, "unit": channel_unit(name, log.mechanism.tree)}
    trees = [log.mechanism.tree, *([log.mechanism.carrier.tree] if log.mechanism.carrier else [])]
    turns = next((body.turns for tree in trees for body in tree.bodies if body.joint == joint), True)
    return {"name": joint, "joint": True, "step": step, "unit": "rad" if turns else "m"}


def tracked_findings(evidence: Evidence) -> Iterator[Finding]:
    """Noise of each tracked body's poses; a doubt where it is far above their fast noise."""
    if (joint := evidence.trajectory) is None:
        return
    fit, first = joint.fit, len(joint.measurement.equations.channels)
    for name, tracked in joint.measurement.tracked.items():
        own, first = range(first, first + WIDTH), first + WIDTH
        noise, floor = fit.channel_noise[own], np.maximum(fast_noise(joint, own), fit.noises[0].floor_channels[own])
        sizes, times = np.sqrt((noise.reshape(2, 3) ** 2).mean(axis=1)).tolist(), float(np.max(noise / floor))
        values = {"name": name, "position": sizes[0], "orientation": sizes[1], "times": times}
        place = Place(bodies=(evidence.mechanism.tree.names[tracked.body],))
        yield Finding.of("tracked_poses", place, times > FAR_ABOVE, **values)


def plane_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on channels out of the plane of a planar model, and on the option that leaves them out."""
    hidden = channels_out_of_plane(evidence.mechanism, evidence.prepared.frame)
    if channels := tuple(name for name in hidden if name in evidence.channels):
        yield Finding.of("out_of_plane", Place(channels=channels), normal=hidden[0][1], channels=tuple(hidden))


def setup_remarks(evidence: Evidence) -> Iterator[Finding]:
    """Set-up errors, and a doubt where none explains the recording."""
    for each in evidence.setup:
        yield Finding.of(each.code, each.place, **each.values)
    if evidence.trajectory is not None and evidence.trajectory.search.incredible:
        yield Finding.of("setup_unexplained", changed=bool(evidence.setup))


def stuck_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubt on channels that never change although the model predicts it."""
    if stuck := evidence.prepared.stuck:
        in_fitted = tuple(each.channel for each in stuck if each.in_fitted)
        yield Finding.of("stuck_channels", channels={each.channel: each.value for each in stuck}, in_fitted=in_fitted)


def unchecked_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remarks on checks that could not be made."""
    for each in evidence.checks.unchecked:
        yield Finding.of("unchecked", **each)
