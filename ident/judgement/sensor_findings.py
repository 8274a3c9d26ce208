"""Findings on sensors: clipped ranges, and steps that are coarse relative to the noise."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from ident.estimation.equations import COMPONENTS
from ident.estimation.preparation import Prepared
from ident.judgement.evidence import Evidence
from ident.judgement.finding import Finding
from ident.judgement.place import Place
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
