"""Poses of the sensor and of other bodies and sites relative to the payload."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ident.errors import InputError, LogError
from ident.files.table import BASE
from ident.geometry.se3 import inverse
from ident.mechanism.mechanism import Mechanism
from ident.recordings.recording import Recording
from ident.recordings.wrench import GROUND, Sensor


def beyond(robot: Mechanism, recordings: Sequence[Recording], body: str) -> Mechanism:
    """A body and all on it, carried by the robot's joints, or the whole mechanism if that is one body with known poses.

    Raises:
        InputError: There is no such body, or what moves it is not known.
    """
    if all(each.base is None for each in recordings) and robot.tree.joints:
        return robot.beyond(body)
    if robot.tree.joints:
        raise InputError("A payload is identified on a robot whose own base rests, but the log has a moving base.")
    if body != robot.tree.names[0] or any(each.base is None for each in recordings):
        raise InputError(
            f"No joint moves '{body}': its pose has to be that of the base, '{robot.tree.names[0]}', and the log needs "
            "it, under [base] in the columns file: position and quaternion."
        )
    return robot


def on_payload(
    robot: Mechanism, part: Mechanism, recording: Recording, body: str, sensor: str
) -> tuple[np.ndarray, Recording, list[str]]:
    """Pose of the sensor's frame in the body's, the recording with its wrench as ground wrench, and notes."""
    if sensor not in recording.wrenches:
        known = ", ".join(f"'{name}'" for name in recording.wrenches) or "none"
        raise LogError(
            f"The log needs the wrench '{sensor}', its wrenches are {known}: say in the columns file under "
            f'[wrenches.{sensor}] which columns hold its force and torque, and body = "{body}".'
        )
    stated = recording.sensors.get(sensor, Sensor())
    place = stated.pose
    if stated.body is not None:
        place = pose_of_body(robot, body, stated.body, f"the wrench '{sensor}'") @ place
    on_it = stated.body is None or stated.body in part.tree.names
    left_out = [name for name in recording.wrenches if name != sensor]
    kept = [BASE, *(f"{joint}_{kind}" for joint in part.joints for kind in ("position", "velocity", "acceleration"))]
    names = {name: name for name in kept} | {f"{sensor}_{kind}": f"{GROUND}_{kind}" for kind in ("force", "torque")}

    def renamed(channels: Mapping[str, Any]) -> dict[str, Any]:
        return {new: channels[name] for name, new in names.items() if name in channels}

    alone = replace(
        recording,
        measured=renamed(recording.measured),
        true={},
        units=renamed(recording.units),
        noise=renamed(recording.noise),
        sensors={GROUND: Sensor(None, place, stated.applied_to_link is on_it)},
        streams=renamed(recording.streams),
    )
    sentence = f"Wrenches besides '{sensor}' were left out: {', '.join(left_out)}."
    return place, alone, [sentence] if left_out else []


def place_of(robot: Mechanism, body: str, name: str) -> np.ndarray:
    """Pose of a body or site that is rigidly connected to a body, in the frame of the latter (4, 4).

    Raises:
        InputError: There is none of that name, or joints lie between.
    """
    if name not in {*robot.tree.names, *robot.sites}:
        there = "; ".join(", ".join(names) or "none" for names in (robot.tree.names, robot.sites))
        raise InputError(
            f"The frame of a payload is that of a body or site, got '{name}'; bodies and sites are {there}."
        )
    other, T = (name, np.eye(4)) if name in robot.tree.names else robot.site(name)
    return pose_of_body(robot, body, other, f"'{name}'") @ T


def pose_of_body(robot: Mechanism, body: str, other: str, what: str) -> np.ndarray:
    """Constant pose of another body in a body's frame (4, 4).

    Raises:
        InputError: A body does not exist, or the pose is not constant.
    """
    tree = robot.tree
    for name in (body, other):
        if name not in tree.names:
            raise InputError(f"There is no body '{name}' for {what}; the bodies are {', '.join(tree.names)}.")
    q = np.random.default_rng(0).uniform(-1, 1, (2, sum(each.coordinates for each in tree.bodies)))
    poses = tree.poses(q)
    T = inverse(poses[:, tree.names.index(body)]) @ poses[:, tree.names.index(other)]
    if not np.allclose(T[0], T[1], atol=1e-9):
        raise InputError(f"{what[0].upper()}{what[1:]} is on '{other}', which does not move with '{body}'.")
    return T[0]
