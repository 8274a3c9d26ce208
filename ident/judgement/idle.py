"""Channels in which no estimate could predict anything: a verdict does not count them."""

from collections.abc import Mapping

import numpy as np

from ident.estimation.equations import COMPONENTS
from ident.estimation.preparation import Prepared
from ident.mechanism.plane import out_of_plane
from ident.recordings.resolution import NOISE_ALONE, white_noise
from ident.regression.held_out import HeldOut
from ident.tolerances import LEFT, POOR

MOVES = 0.01
"""Range of a joint, rad or m, up to which it rests: its torque is then friction, of any size up to breakaway."""

STILL = 1e-3
"""Predicted change of a wrench's component, over the largest of its kind, up to which the model does not change it."""


def still_channels(changes: Mapping[str, float]) -> dict[str, str]:
    """The reason `still` by the wrench's components that the model does not change, from predicted changes of all."""
    largest = {kind: max((x for c, x in changes.items() if c[0] == kind), default=0.0) for kind in "FM"}
    return {c: "still" for c, x in changes.items() if x <= STILL * largest[c[0]]}


def not_predicted(idle: Mapping[str, str], ratios: Mapping[str, float]) -> dict[str, str]:
    """Reasons of the channels that are predicted poorly or not at all, without those that show a grosser error."""
    return {channel: idle[channel] for channel, ratio in ratios.items() if channel in idle and POOR < ratio <= LEFT}


def idle_channels(held: HeldOut, prepared: Prepared) -> dict[str, str]:
    """Reason, as a key of `verdict.IDLE`, by the channels that are not predicted and in which nothing could be."""
    equations, mechanism, motion = held.fit.equations, prepared.mechanism, held.samples.motion
    tree = mechanism.tree
    changes = (held.samples.measured - held.residual).std(axis=0).tolist()
    idle = still_channels({c: x for c, x in zip(equations.channels, changes, strict=True) if c in COMPONENTS})
    hidden = out_of_plane(mechanism, prepared.frame, free=motion.base is not None)
    idle |= {COMPONENTS[k]: "plane" for k in hidden}
    ranges = np.ptp(tree.freedom_coordinates(motion.q), axis=0)
    balls = {name for body in tree.bodies if body.is_ball for name in body.freedom_names}
    first = len(equations.channels) - len(equations.torques)
    for channel, k in zip(equations.channels[first:], equations.torques, strict=True):
        if ranges[k] < MOVES and tree.freedoms[k] not in balls:
            idle[channel] = "rest"
    parts = np.split(held.residual, held.starts[1:])
    # Of poses in any order everything is as rough as noise.
    for c, channel in enumerate(() if prepared.recording.still else equations.channels):
        if held.rms[c] < NOISE_ALONE * white_noise(*(part[:, c] for part in parts), robust=True):
            idle.setdefault(channel, "noise")
    return not_predicted(idle, dict(zip(equations.channels, held.ratio.tolist(), strict=True)))
