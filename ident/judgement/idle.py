"""Channels in which no estimate could predict anything: a verdict does not count them."""

import numpy as np

from ident.estimation.equations import channels_out_of_plane
from ident.estimation.preparation import Prepared
from ident.recordings.resolution import NOISE_ALONE, white_noise
from ident.regression.held_out import HeldOut
from ident.tolerances import POOR

MOVES = 0.01
"""Range of a joint, rad or m, up to which it rests: its torque is then friction, of any size up to breakaway."""


def idle_channels(held: HeldOut, prepared: Prepared) -> dict[str, str]:
    """Reason by the channels that are not predicted and out of the plane, of a joint at rest, or noise.

    Reasons are keys of `verdict.IDLE`.
    """
    equations, tree = held.fit.equations, prepared.mechanism.tree
    idle = dict.fromkeys(channels_out_of_plane(prepared.mechanism, prepared.frame), "plane")
    ranges = np.ptp(tree.freedom_coordinates(held.samples.motion.q), axis=0)
    balls = {name for body in tree.bodies if body.is_ball for name in body.freedom_names}
    first = len(equations.channels) - len(equations.torques)
    for channel, k in zip(equations.channels[first:], equations.torques, strict=True):
        if ranges[k] < MOVES and tree.freedoms[k] not in balls:
            idle[channel] = "rest"
    parts = np.split(held.residual, held.starts[1:])
    for c, channel in enumerate(equations.channels):
        if held.rms[c] < NOISE_ALONE * white_noise(*(part[:, c] for part in parts), robust=True):
            idle.setdefault(channel, "noise")
    ratios = zip(equations.channels, held.ratio.tolist(), strict=True)
    return {channel: idle[channel] for channel, ratio in ratios if channel in idle and ratio > POOR}
