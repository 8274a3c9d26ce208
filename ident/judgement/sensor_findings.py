"""Findings on sensors: ranges that ended, and steps that are coarse beside the noise."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ident.estimation.equations import COMPONENTS
from ident.estimation.preparation import Prepared
from ident.judgement.finding import Finding, Place
from ident.recordings.resolution import UNIFORM

if TYPE_CHECKING:
    from ident.estimate import Estimate

MOST = 0.5
"""Share of a signal's noise, in its variance, that steps have to make up to be worth a remark."""


def clipped_findings(result: "Estimate") -> Iterator[Finding]:
    """Channels that a sensor's range has cut off."""
    for k, (log, _) in enumerate(result.logs):
        for each in log.clipped:
            unit = unit_of(log, each.channel.rpartition(" ")[2])
            limits = " and ".join(f"{value:.4g}{unit}" for value in each.limits)
            done = "these samples are left out" if each.kept else "so much that the channel is left out"
            where = f" in log {k + 1}" if len(result.logs) > 1 else ""
            yield Finding(
                f"{each.channel} is clipped at {limits}{where}, which {each.share:.0%} of its samples read while the "
                f"motion goes on; {done}. A sensor with a larger range, or a slower motion, would show the rest.",
                False,
                _place(each.channel, k),
            )


def _place(channel: str, log: int) -> Place:
    """Place of a clipped channel: that of a contact belongs to its wrench."""
    contact, _, _ = channel.rpartition(" ")
    return Place(wrenches=(contact,), log=log) if contact else Place(channels=(channel,), log=log)


def resolution_findings(result: "Estimate") -> Iterator[Finding]:
    """Channels and coordinates whose noise is mostly that of rounding."""
    log, joint = result.prepared, result.trajectory
    noise = dict(zip(result.channels, result.scale.tolist(), strict=True))
    if joint is not None:
        noise = dict(zip(result.channels, joint.fit.noise.channels.tolist(), strict=True))
        names = [f"{joint_}_position" for joint_ in log.mechanism.joints for _ in range(_coordinates(log, joint_))]
        own = joint.fit.noise.states[0][-len(names) :] if names else np.zeros(0)
        noise |= dict(zip(names, own.tolist(), strict=True))
    least = {name: UNIFORM * step / np.sqrt(MOST) for name, step in log.steps.items()}
    coarse = {name: log.steps[name] for name, x in least.items() if x > noise.get(name, np.inf)}
    if coarse:
        listed = ", ".join(f"{_called(name)} {_size(log, name, step)}" for name, step in coarse.items())
        yield Finding(
            f"Recorded in steps that are most of the noise: {listed}. A finer range, or more digits in the log, would "
            "tell more.",
            False,
            Place(channels=tuple(name for name in coarse if name in result.channels)),
        )


def _coordinates(log: Prepared, joint: str) -> int:
    values = log.recording[f"{joint}_position"]
    return 1 if values.ndim == 1 else values.shape[1]


def _called(name: str) -> str:
    joint = name.removesuffix("_position")
    return name if joint == name else f"joint '{joint}'"


def _size(log: Prepared, name: str, step: float) -> str:
    """A step with its unit, of a hinge's angle in degrees."""
    joint = name.removesuffix("_position")
    if joint == name:
        return f"{step:.2g}{unit_of(log, name)}"
    return f"{np.degrees(step):.2g}°" if _is_hinge(log, joint) else f"{1e3 * step:.2g} mm"


def unit_of(log: Prepared, channel: str) -> str:
    """Unit of a channel, a space before it."""
    if channel in COMPONENTS:
        return " N" if channel[0] == "F" else " N m"
    return " N m" if _is_hinge(log, channel.partition(".")[0]) else " N"


def _is_hinge(log: Prepared, joint: str) -> bool:
    """True for a joint that turns."""
    trees = [log.mechanism.tree, *([log.mechanism.carrier.tree] if log.mechanism.carrier else [])]
    return next((body.turns for tree in trees for body in tree.bodies if body.joint == joint), True)
