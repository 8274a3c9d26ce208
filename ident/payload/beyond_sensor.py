"""Identification of a robot's payload beyond a wrist sensor: mass, centre of mass, inertia and sensor errors.

The robot's kinematics are known, so that joint angles determine the sensor's motion, or its pose is measured. The
sensor is the base of the bodies beyond it and reads their wrench. The trajectory estimate is used: angles may be noisy,
and no derivatives are needed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ident.annotations import typed
from ident.arguments import check_type, checked_deviations
from ident.errors import InputError, LogError
from ident.estimation.preparation import at_rest, mounted, prepared
from ident.files.table import BASE
from ident.identification import identified
from ident.mechanism.mechanism import Mechanism
from ident.payload.identified_payload import Payload, pose_of_body
from ident.payload.weight import known, likely, weighing
from ident.recordings.recording import Recording
from ident.recordings.times import POSES, SLOW
from ident.recordings.wrench import GROUND, Sensor
from ident.setup import PRIORS
from ident.tolerances import HOLDOUT
from ident.trajectory.fit.iteration import Report


@typed("recording", "setup")
def identify_payload(
    robot: Mechanism,
    recording: Recording | Sequence[Recording],
    *,
    body: str,
    sensor: str,
    offsets: bool = True,
    holdout: float = HOLDOUT,
    setup: Mapping[str, float] | None = None,
    report: Report | None = None,
) -> Payload:
    """Mass, centre of mass and inertia of a robot's payload beyond a wrench sensor.

    Args:
        robot: The whole robot; masses before the sensor have no effect. Or the payload alone, whose pose is that of
            a moving base, such as `Mechanism.lone_body()`.
        recording: Joint angles, or poses, and readings of the sensor; one recording or several.
        body: Name of the body that, with all bodies on it, is the sensor's load.
        sensor: Name of the wrench. It is measured on that body, on one that is welded to it, or on its parent.
        offsets: True to fit a constant offset of every channel.
        holdout: Fraction of each recording, at its end, that is not fitted but predicted; poses at rest are all fitted.
        setup: Standard deviations of set-up errors, as for `identify`, unused for poses at rest; the sensor's origin is
            taken as stated, because the centre of mass is estimated relative to it.
        report: Called with every iteration of the estimate.

    Raises:
        InputError: Something is missing or does not fit, or the sensor is mounted in another way than was stated.
        ExcitationError: The motion does not separate the payload from the sensor's offsets.
    """
    check_type("recording", recording, Recording | Sequence, "a Recording, as of mc.read_log, or a list of them")
    recordings = [recording] if isinstance(recording, Recording) else list(recording)
    if not recordings:
        raise InputError("A payload needs at least one recording, got none.")
    for k, each in enumerate(recordings):
        check_type(f"recording[{k}]", each, Recording, "a Recording, as of mc.read_log")
    robot, recordings = at_rest(robot.following(recordings[0].followers), recordings)
    robot = mounted(robot, recordings[0])
    part = beyond(robot, recordings, body)
    logged = {joint for joint in part.tree.joints if any(f"{joint}_position" in each.measured for each in recordings)}
    part = part.closed([joint for joint in part.tree.joints if joint not in logged])
    if part.tree.joints:
        raise InputError(
            f"A payload is rigid, but {', '.join(part.tree.joints)} are beyond the sensor; hold them where they stand "
            "(--fix)."
        )
    places, notes = [], list[str]()
    for number, each in enumerate(recordings):
        place, renamed, more = on_payload(robot, part, each, body, sensor)
        places.append(place)
        recordings[number], notes = renamed, notes + [note for note in more if note not in notes]
    if len({each.still for each in recordings}) > 1:
        raise InputError("Logs of poses at rest and logs of motions are identified apart; take one kind.")
    if slow := [each for each in recordings if 1 / each.rate >= SLOW and not each.still]:
        raise InputError(f"A motion with a sample every {1 / slow[0].rate:g} s shows no payload.{POSES}")
    massless = replace(part, prior=np.zeros(10 * len(part.bodies)))
    ready = [prepared(massless, each, filters=False) for each in recordings]
    weighed = weighing(ready[0], sensor, recordings[0].sensors[GROUND])
    part = replace(part, prior=likely(part, weighed, places[0]))
    ready = [prepared(part, each, filters=False) for each in recordings]
    fitting: dict[str, Any] = {"offsets": offsets, "holdout": holdout, "report": report}
    deviations = {"origin": 0.0, **recordings[0].setup, **checked_deviations("setup", setup or {}, PRIORS)}
    if recordings[0].still:
        # Of 40 simulations of 10 poses, 94 % of the intervals held, with .4 of the poses held out 77 %.
        fitting |= {"estimator": "weighted", "holdout": 0.0}
        notes.append(
            "Poses at rest: all are fitted and judged by; the sensor's place, axes and gains are taken as stated."
        )
    else:
        fitting |= {"setup": deviations, "known": known(part)}
    estimate = identified(ready, **fitting)
    # The prior is the weighed body instead of the model, so that the model is no rival.
    estimate = replace(estimate, held_out=replace(estimate.held_out, rivals={}))
    return Payload(robot, body, sensor, places[0], estimate, tuple(notes))


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
