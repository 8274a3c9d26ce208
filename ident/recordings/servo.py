"""Servos of position-controlled joints: the torque that a command makes, by gains of the log's mapping or the model."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from ident.errors import LogError
from ident.files.table import short
from ident.mechanism.drives import NO_DRIVE
from ident.mechanism.mechanism import Mechanism
from ident.tolerances import HUGE

GAINS = ("kp", "kv")
"""Keys of a joint's entry in a mapping that state the gains of its servo."""

SCALES = {"kp_std": "command", "torque_std": "torque"}
"""Keys that state how uncertain the scale of a joint's torque is, and the channel that each is about."""


MOST_UNCERTAIN = 1.0
"""Largest relative standard deviation of a scale: a scale is positive."""


@dataclass(frozen=True)
class Servo:
    """Law of a position-controlled joint, `τ = kp (u - q) - kv q̇`, with the recorded command u.

    A command is held until the next one, so that it acts half a sample later than it is logged on average.

    Attributes:
        kp: Stiffness, N m/rad or N/m.
        kv: Damping, N m s/rad or N s/m.
    """

    kp: float
    kv: float = 0.0


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
    for key, value in given.items():
        least = "above 0" if key == "kp" else "of at least 0"
        if type(value) not in (int, float) or not 0 <= value < HUGE or (key == "kp" and not value):
            raise LogError(f"joints.{joint}.{key} needs a number {least}, got {short(value)}.")
    if given and "kp" not in given:
        raise LogError(f"joints.{joint} states {', '.join(given)}; a servo needs its kp as well.")
    return {joint: Servo(**{key: float(value) for key, value in given.items()})} if given else {}


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
        out |= {joint: _deviation(f"joints.{joint}.{key}", entry[key])}
    return out


def scales_of(entries: Mapping[str, Any]) -> dict[str, float]:
    """Relative standard deviations of the scales of torques from the metadata of a saved recording, by joint.

    Raises:
        LogError: An entry is none.
    """
    return {joint: _deviation(f"the scale of joint '{short(joint)}'", value) for joint, value in entries.items()}


def _deviation(where: str, value: Any) -> float:
    if type(value) not in (int, float) or not 0 < value <= MOST_UNCERTAIN:
        raise LogError(f"{where} needs a number above 0 and at most {MOST_UNCERTAIN:g}, got {short(value)}.")
    return float(value)


def servos_of(entries: Mapping[str, Any]) -> dict[str, Servo]:
    """Servos from the metadata of a saved recording, by joint.

    Raises:
        LogError: An entry is none.
    """
    out = dict[str, Servo]()
    for joint, entry in entries.items():
        if not isinstance(entry, Mapping) or not set(entry) <= set(GAINS):
            raise LogError(f"the servo of joint '{short(joint)}' needs {', '.join(GAINS)}, got {short(entry)}.")
        out |= servo_of(joint, {"command": True, **entry})
    return out


def model_servo(mechanism: Mechanism, joint: str) -> Servo | None:
    """Servo of a joint by the model's position actuator; None without one, or if it acts through a gear."""
    actuators = [each for each in mechanism.drives.get(joint, NO_DRIVE).actuators if each.kind == "position"]
    if len(actuators) != 1 or actuators[0].gear != 1:
        return None
    return Servo(actuators[0].kp, actuators[0].kv)
