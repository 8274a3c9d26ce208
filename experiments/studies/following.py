"""Simulation of the model as it came and of the updated one with the commands of the held-out part."""

from dataclasses import replace

import numpy as np

from experiments.data.following import Following
from ident.errors import InputError, ModelError
from ident.estimate import Estimate
from ident.recordings.recording import Recording
from sim.simulation.commanded import rolled_out

LONGEST = 30.0
"""Longest simulated time, s: beyond, errors of joints without a restoring force only add up."""


def following(result: Estimate) -> Following | None:
    """Errors of simulated coordinates on what was held out of the first recording, else on its end.

    The model as it came takes the commands as they are logged; the updated one with the estimated lag. None unless
    every joint of the model has a command.
    """
    log, mechanism = result.prepared, result.prepared.mechanism
    if set(log.recording.servos) != set(mechanism.tree.joints):
        return None
    held = _held_out(result)
    recording, rates = _part(log.recording, held), log.samples.motion.dq[held.start]
    lag = next((each.value for each in result.setup if each.name == "lag"), 0.0)
    phi, drives = result.consistent().phi, result.drives_updated
    try:
        before = rolled_out(mechanism, recording, rates=rates)
        after = rolled_out(
            mechanism, replace(recording, servos=result.servos), rates=rates, phi=phi, drives=drives, lag=lag
        )
    except (InputError, ModelError):
        return None
    measured = recording.of_joints(mechanism.tree.joints, "position")
    turns = {body.joint: body.turns for body in mechanism.tree.bodies if body.joint}
    return Following(
        joints=mechanism.tree.joints,
        units=tuple("rad" if turns[joint] else "m" for joint in mechanism.tree.joints),
        before=np.sqrt(((before - measured) ** 2).mean(axis=0)),
        after=np.sqrt(((after - measured) ** 2).mean(axis=0)),
        seconds=float(np.ptp(recording.time)),
    )


def _held_out(result: Estimate) -> slice:
    """Samples of the first recording after the fitted ones, else all; at most `LONGEST` s of them."""
    samples, rate = len(result.prepared.samples), result.prepared.recording.rate
    first = result.part.stop if samples - result.part.stop > 1 else 0
    return slice(first, min(samples, first + round(LONGEST * rate)))


def _part(recording: Recording, part: slice) -> Recording:
    """Part of a recording at its common times."""
    measured = {name: x[part] for name, x in recording.measured.items()}
    base = None if recording.base is None else recording.base[part]
    return replace(recording, time=recording.time[part], measured=measured, true={}, streams={}, base=base)
