"""Units of channels and coefficients; the scale of each channel in weights and ratios, and a lower bound of its noise.

The scale is the spread of the signal, or that of its kind where it is flat.

A flat channel has no scale of its own: its weight would be infinite. Where a whole kind is flat, the largest spread of
all channels replaces it, and 1 where all are flat. With less noise than the bound a channel, however well it is fitted,
would outweigh all others:

floor_c = max(LEAST · scale_c, step_c / √12)
"""

from collections.abc import Sequence

import numpy as np

from ident.estimation.equations import COMPONENTS
from ident.geometry.inertia import body_index
from ident.mechanism.tree import Tree
from ident.recordings.resolution import UNIFORM, quanta
from ident.tolerances import DRIVE_UNITS

FLAT, FLAT_TORQUE = 1e-3, 1e-6
"""Spread relative to the largest of its kind up to which a channel is flat: a force or a moment, which share a sensor,
and a joint torque, of which a finger's is a thousandth of a hip's."""

LEAST = 1e-3
"""Smallest noise of a channel over its scale; few sensors are as good as that."""

LEAST_OF_POSES = 1e-5
"""The same of tracked poses: laser trackers resolve some micrometres in a room."""


def channel_scales(parts: Sequence[np.ndarray], channels: Sequence[str]) -> np.ndarray:
    """Scale of each channel of a signal, positive (C,).

    Args:
        parts: Measured channels, in one piece or several, NaN where a sample is missing (N, C).
        channels: Names of the channels; further ones are of tracked poses.
    """
    every = np.concatenate(parts)
    spread = np.zeros(every.shape[1])
    there = np.isfinite(every).any(axis=0)
    spread[there] = np.nanstd(every[:, there], axis=0)
    own, poses = np.split(spread, [len(channels)])
    return np.append(beside_others(own, channels), np.maximum(poses, LEAST * poses.max(initial=0.0) or 1.0))


def beside_others(spread: np.ndarray, channels: Sequence[str]) -> np.ndarray:
    """Spreads (C,), those of flat channels replaced by the largest of their kind: forces, moments, joint torques."""
    kinds = np.array([name[0] if name in COMPONENTS else "" for name in channels])
    of_all = float(spread.max(initial=0.0)) or 1.0
    largest = np.array([spread[kinds == kind].max() or of_all for kind in kinds])
    return np.where(spread <= np.where(kinds == "", FLAT_TORQUE, FLAT) * largest, largest, spread)


def least_noise(parts: Sequence[np.ndarray], channels: Sequence[str]) -> np.ndarray:
    """Lower bound of the standard deviation of each channel's noise (C,).

    Args:
        parts: Measured channels, in one piece or several, NaN where a sample is missing (N, C).
        channels: Names of the channels.
    """
    scales = channel_scales(parts, channels)
    least = np.where(np.arange(len(scales)) < len(channels), LEAST, LEAST_OF_POSES)
    return np.maximum(least * scales, rounding(parts))


def rounding(parts: Sequence[np.ndarray]) -> np.ndarray:
    """Standard deviation of each stream's rounding error, from its smallest step (s,).

    Args:
        parts: The streams, in one piece or several, NaN where a sample is missing (N, s).
    """
    steps = np.array([quanta(part.T) for part in parts])
    smallest = np.where(steps > 0, steps, np.inf).min(axis=0)
    return np.where(np.isfinite(smallest), UNIFORM * smallest, 0.0)


def unit_of(parameter: str) -> str | None:
    """Unit of a parameter of φ, such as `m2rz2`; None for other names."""
    if body_index(parameter) is None:
        return None
    return "kg m²" if parameter.startswith("I") else "kg m" if "r" in parameter else "kg"


def offset_unit(name: str) -> str:
    """Unit of a component of a wrench, or of its offset: N for `Fx` and `offset(Fx)`, N m for moments."""
    return "N" if name.removeprefix("offset(").startswith("F") else "N m"


def channel_unit(channel: str, tree: Tree) -> str:
    """Unit of a channel: a component of a wrench, or a joint's torque or force."""
    if channel in COMPONENTS:
        return offset_unit(channel)
    motion = np.hstack([body.motions for body in tree.bodies if body.freedoms])[:, tree.freedoms.index(channel)]
    return "N m" if motion[3:].any() else "N"


def coefficient_unit(name: str, tree: Tree) -> str:
    """Unit of a coefficient by its name, such as `m2rz2`, `Fv(knee)` or `offset(Fx)`."""
    if (own := unit_of(name)) is not None:
        return own
    kind, _, of = name.removesuffix(")").partition("(")
    if kind in DRIVE_UNITS:
        # Motors, which are no freedoms, turn.
        return DRIVE_UNITS[kind][of in tree.freedoms and channel_unit(of, tree) == "N"]
    return channel_unit(of, tree)
