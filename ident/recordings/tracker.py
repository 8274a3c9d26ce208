"""Tracked poses of bodies, as of motion capture, of a tracker at a flange or of a fit of markers."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TypeVar

import numpy as np

from ident.annotations import typed
from ident.errors import LogError
from ident.mechanism.body import is_rigid
from ident.mechanism.tree import Tree

Stream = TypeVar("Stream")

TRACKED = "tracked."
"""Start of the keys of poses in a mapping. Samples of them may always be missing: markers are hidden now and then."""


@typed()
@dataclass(frozen=True, eq=False)
class Tracker:
    """Frames of a tracked body, whose poses a recording has as `NAME_position` and `NAME_orientation`.

    Attributes:
        body: Name of the body.
        markers: Pose of the tracked frame in the body's frame (4, 4); None if it is unknown.
        frame: Pose of the tracker's frame in the base frame, of a moving base in the frame of its poses (4, 4); None if
            it is unknown. All trackers of unknown frames share one.
    """

    body: str
    markers: np.ndarray | None = None
    frame: np.ndarray | None = None

    def __post_init__(self) -> None:
        for name, T in (("markers", self.markers), ("frame", self.frame)):
            if T is not None and not (np.shape(T) == (4, 4) and is_rigid(T)):
                raise LogError(f"The tracker of '{self.body}' needs a rigid pose (4, 4) as {name}, got {np.shape(T)}.")


def untracked(streams: Mapping[str, Stream]) -> dict[str, Stream]:
    """Streams without those of tracked poses: these do not limit the common times."""
    return {key: stream for key, stream in streams.items() if not key.startswith(TRACKED)}


def tracked_bodies(tree: Tree) -> list[str]:
    """Names of the bodies that joints move."""
    return [body.name for i, body in enumerate(tree.bodies) if any(tree.bodies[k].moves for k in tree.chain(i))]
