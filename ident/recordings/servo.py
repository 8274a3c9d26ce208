"""Servos of position-controlled joints: the torque that a command makes, by gains of the log's mapping or the model."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated, Any

from ident.annotations import Needs, NotNegative, Positive
from ident.errors import LogError
from ident.files.schema import made, value_of
from ident.mechanism.drives import NO_DRIVE
from ident.mechanism.mechanism import Mechanism

GAINS = ("kp", "kv")
"""Keys of a joint's entry in a mapping that state the gains of its servo."""

SCALES = {"kp_std": "command", "torque_std": "torque"}
"""Keys that state how uncertain the scale of a joint's torque is, and the channel that each is about."""

Scale = Annotated[float, Needs("a number above 0 and at most 1", lambda x: 0 < x <= 1)]
"""Relative standard deviation of a scale, which is positive."""


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
