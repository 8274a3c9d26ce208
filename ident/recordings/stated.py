"""Servos of commanded joints and frames of tracked bodies, which a recording states beside its samples."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any, TypeVar

import numpy as np

from ident.annotations import Needs, NotNegative, Positive, typed
from ident.errors import LogError
from ident.files.schema import made, value_of
from ident.mechanism.body import is_rigid
from ident.mechanism.drives import NO_DRIVE
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree

GAINS = ("kp", "kv")
"""Keys of a joint's entry in a mapping that state the gains of its servo."""

SCALES = {"kp_std": "command", "torque_std": "torque"}
"""Keys that state how uncertain the scale of a joint's torque is, and the channel that each is about."""

Scale = Annotated[float, Needs("a number above 0 and at most 1", lambda x: 0 < x <= 1)]
"""Relative standard deviation of a scale, which is positive."""

TRACKED = "tracked."
"""Start of the keys of poses in a mapping. Samples of them may always be missing: markers are hidden now and then."""


@dataclass(frozen=True)
class Servo:
    """Law of a position-controlled joint, `τ = kp (u - q) - kv q̇`, with the recorded command u.

    A command is held until the next one, so that it acts half a sample later than it is logged on average.

    Attributes:
        kp: Stiffness, N m/rad or N/m.
        kv: Damping, N m s/rad or N s/m.
    """

    kp: Positive
    kv: NotNegative = 0.0


def servo_of(joint: str, entry: Mapping[str, Any]) -> dict[str, Servo]:
    """Servo that a joint's entry in a mapping states, by the joint's name; empty if it states none.

    Raises:
        LogError: A gain is not a number in its range, there is no command, or the torque is mapped as well.
    """
    given = {key: entry[key] for key in GAINS if key in entry}
    if "command" in entry and "torque" in entry:
        raise LogError(f"joints.{joint} maps a torque and a command, from which the torque would follow; map one.")
    if given and "command" not in entry:
        raise LogError(f"joints.{joint} states {', '.join(given)} of a servo; that needs its command as well.")
    return {joint: made(Servo, f"joints.{joint}", given)} if given else {}


def scale_of(joint: str, entry: Mapping[str, Any]) -> dict[str, float]:
    """Relative standard deviation of the scale of a joint's torque that its entry states; empty if it states none.

    Raises:
        LogError: It is no number above 0, or its channel is not mapped.
    """
    out = dict[str, float]()
    for key, channel in SCALES.items():
        if key not in entry:
            continue
        if channel not in entry:
            raise LogError(f"joints.{joint} states {key}; that needs its {channel} as well.")
        out |= {joint: value_of(f"joints.{joint}.{key}", entry[key], Scale)}
    return out


def model_servo(mechanism: Mechanism, joint: str) -> Servo | None:
    """Servo of a joint by the model's position actuator; None without one, or if it acts through a gear."""
    actuators = [each for each in mechanism.drives.get(joint, NO_DRIVE).actuators if each.kind == "position"]
    if len(actuators) != 1 or actuators[0].gear != 1:
        return None
    return Servo(actuators[0].kp, actuators[0].kv)


Stream = TypeVar("Stream")


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
