"""Commands of position-controlled joints in a recording: which of them give torques, and by which gains."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ident.errors import LogError
from ident.mechanism.mechanism import Mechanism
from ident.recordings.recording import Recording
from ident.recordings.sampled import Sampled
from ident.recordings.servo import Servo, model_servo

FAR = 20.0
"""Range of commands over that of the positions from which their units differ."""


def with_servos(recording: Recording, servos: Mapping[str, Servo], mechanism: Mechanism, notes: list[str]) -> Recording:
    """Recording with the servos of its commanded joints, and without commands that give no torque.

    Args:
        recording: The recording, with channels `JOINT_command`.
        servos: Servos that the log's mapping states, by joint; others are those of the model's position actuators.
        mechanism: The mechanism.
        notes: Sentences on what was detected; more are appended.

    Raises:
        LogError: Commands and positions are in different units, or nothing but commands without gains is measured.
    """
    commanded = [joint for joint in mechanism.tree.joints if f"{joint}_command" in recording.measured]
    used, unused = dict[str, Servo](), list[str]()
    for joint in commanded:
        servo = servos.get(joint) or model_servo(mechanism, joint)
        if servo is None or f"{joint}_torque" in recording.measured:
            unused.append(joint)
        else:
            _check_unit(recording, joint)
            used[joint] = servo
    if without := [joint for joint in unused if f"{joint}_torque" not in recording.measured]:
        note = (
            f"Commands of {', '.join(without)} are not used: the model has no position actuator with a gear of 1 for "
            "them, and no kp is stated under [joints.NAME]."
        )
        if not (used or recording.wrenches or recording.torques(mechanism.tree.joints) is not None):
            raise LogError(f"nothing is left to fit. {note}")
        notes.append(note)
    recording = recording.without([f"{joint}_command" for joint in unused])
    measured, streams = dict(recording.measured), dict(recording.streams)
    for body in (body for body in mechanism.tree.bodies if body.joint in used and body.turns):
        command = f"{body.joint}_command"
        # A command that is unwrapped may be whole turns away from its position.
        turns = 2 * np.pi * np.round(np.median(measured[command] - measured[f"{body.joint}_position"]) / (2 * np.pi))
        if turns:
            measured[command] = measured[command] - turns
            if command in streams:
                streams[command] = Sampled(streams[command].time, streams[command].values - turns)
    scales = {joint: std for joint, std in recording.scales.items() if joint not in without}
    return replace(recording, measured=measured, streams=streams, servos=used, scales=scales)


def _check_unit(recording: Recording, joint: str) -> None:
    command, position = recording[f"{joint}_command"], recording[f"{joint}_position"]
    size, usual = (float(np.abs(x).max()) for x in (command, position))
    if size > FAR * usual > 0 and np.ptp(command) > FAR * np.ptp(position):
        raise LogError(
            f"the commands of joint '{joint}' reach {size:.3g}, its positions {usual:.3g}; both need one unit: map the "
            f'command with its own, as in command = {{ column = ..., unit = "deg" }} under [joints.{joint}].'
        )
