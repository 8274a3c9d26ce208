"""Identification of a robot's payload beyond a wrist sensor: mass, centre of mass, inertia and sensor errors.

The robot's kinematics are known, so that joint angles determine the sensor's motion, or its pose is measured. The
sensor is the base of the bodies beyond it and reads their wrench. The trajectory estimate is used: angles may be noisy,
and no derivatives are needed.

First the payload is weighed by gravity alone, for the mounting of its sensor and a prior body of that mass:

    F = o_F - m R g        M = o_M + g × m c        in the sensor's axes, g gravity less its acceleration

R is the identity if the sensor's axes are as stated; any other rotation is estimated in closed form (Kabsch, Acta
Cryst. A32, 1976, doi:10.1107/S0567739476001873). Another direction of gravity is estimated by linear least squares.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ident.annotations import typed
from ident.arguments import checked_deviations, rpy_text
from ident.errors import ExcitationError, InputError, LogError, about
from ident.estimation.equations import COMPONENTS
from ident.estimation.preparation import Prepared, at_rest, mounted, prepared
from ident.files.table import BASE
from ident.geometry.inertia import parameter_transform, parameters_from_com
from ident.geometry.se3 import hat
from ident.identification import identified
from ident.judgement.model_fit import AWAY, AXIS, rpy_deg
from ident.judgement.residuals import BEYOND_CHANCE
from ident.mechanism.mechanism import Mechanism
from ident.parameters.prior import SMALLEST
from ident.payload import Payload, pose_of_body
from ident.recordings.recording import STATES, Recording
from ident.recordings.times import POSES, SLOW
from ident.recordings.wrench import GROUND, Sensor
from ident.setup import PRIORS
from ident.tolerances import HOLDOUT, UNEXPLAINED
from ident.trajectory.fit.iteration import Report

DENSITY = 2000.0
"""Density of the ball that replaces a body of unknown inertia, kg/m³: metal and plastics, and some air. Mean errors of
inertias of eight simulated tools with 500 are 100, 115 and 182 % of their size at three levels of noise, with this 56,
76 and 162 %, with steel's 8000 38, 68 and 170 %, and with that also .4 to 1 % more of those that the motion shows."""

TURNS_LEAST = 0.05
"""Standard deviation of gravity's direction in the sensor, over all axes, above which weight and offsets separate."""

TURNED, BETTER = np.radians(10), 0.7
"""Rotation of a sensor's axes from which it is an error, and the largest part of the forces' residual that may remain
with it."""

STEADY = 2.0
"""Mean over the changes from which forces along gravity, while the sensor turns, are in the axes of the base."""

STEPS = 4
"""Iterations between the direction of gravity and the mass that accelerates, and to a load's stated mass where scales
of torques are uncertain: the last changes that mass by 1e-9."""


@dataclass(frozen=True, eq=False)
class Weighing:
    """Mass and first moments in the sensor's frame, and its mounting.

    Attributes:
        mass: Mass, kg.
        std: Standard deviation of the mass, kg.
        moment: First moments `m c`, kg m (3,).
        rotation: Rotation of the stated axes that fits the forces best, identity unless clearly better (3, 3).
        opposite: True if the forces have the opposite sign.
        unexplained: RMS force that is left with that mass and rotation, over that of the force without its mean.
    """

    mass: float
    std: float
    moment: np.ndarray
    rotation: np.ndarray
    opposite: bool
    unexplained: float

    @property
    def angle(self) -> float:
        """Angle of the rotation, rad."""
        return float(Rotation.from_matrix(self.rotation).magnitude())


def weighed(wrench: np.ndarray, gravity: np.ndarray) -> Weighing:
    """Estimates mass, first moments and mounting from the wrench on a sensor's load.

    Args:
        wrench: Measured wrench of the sensor on its load, N and N m (N, 6).
        gravity: Acceleration of gravity less that of the sensor, in its axes, m/s² (N, 3).

    Raises:
        ExcitationError: Gravity hardly changes its direction in the sensor, so that weight and offset do not separate.
    """
    force, moment = wrench[:, :3], wrench[:, 3:]
    g, f = gravity - gravity.mean(axis=0), force - force.mean(axis=0)
    size = np.linalg.norm(gravity, axis=1).mean()
    if not size or np.sqrt((g**2).sum(axis=1).mean()) < TURNS_LEAST * size:
        raise ExcitationError(
            "The sensor keeps its direction to gravity, so that what it carries cannot be told from its offsets; turn "
            "it further, about more than one axis."
        )
    total = (g**2).sum()
    mass = -float((f * g).sum() / total)
    left = f + mass * g
    std = float(np.sqrt((left**2).mean() / total))
    across = hat(gravity)
    design = np.concatenate([across, np.broadcast_to(np.eye(3), across.shape)], axis=2).reshape(-1, 6)
    first = np.linalg.lstsq(design, moment.ravel(), rcond=1e-9)[0]
    rotation, opposite, squares = _turned(f, g, left)
    return Weighing(mass, std, first[:3], rotation, opposite, float(np.sqrt(squares) / np.linalg.norm(f)))


def _turned(f: np.ndarray, g: np.ndarray, left: np.ndarray) -> tuple[np.ndarray, bool, float]:
    """Rotation, and True for the opposite sign, with which forces fit gravity clearly better; else the identity.

    Returns:
        They, and the squared residual with them.
    """
    usual = float((left**2).sum())
    best, out = BETTER**2 * usual, (np.eye(3), bool((f * g).sum() > 0), usual)
    for opposite in (False, True):
        R = Rotation.align_vectors(f if opposite else -f, g)[0].as_matrix()
        along = g @ R.T
        mass = (f * along).sum() / (along**2).sum()
        squares = ((f - mass * along) ** 2).sum()
        if squares < best:
            best, out = squares, (R, opposite, float(squares))
    return out


def other_gravity(
    force: np.ndarray, R: np.ndarray, acceleration: np.ndarray, stated: np.ndarray, unexplained: float
) -> np.ndarray | None:
    """Direction of gravity (3,) that explains forces far better than the stated one; None for none.

    Args:
        force: Force of the sensor on its load, N (N, 3).
        R: Axes of the sensor, in those in which gravity is stated (N, 3, 3).
        acceleration: Acceleration of the sensor in its axes, m/s² (N, 3).
        stated: Gravity, m/s² (3,).
        unexplained: As of `Weighing`, with the stated gravity.
    """
    f, a = force - force.mean(axis=0), acceleration - acceleration.mean(axis=0)
    U, g = np.swapaxes(R - R.mean(axis=0), 1, 2).reshape(-1, 3), float(np.linalg.norm(stated))
    best, out = (BETTER * unexplained) ** 2 * (f**2).sum(), None
    for sign in (1, -1):
        weight = np.zeros(3)
        for _ in range(STEPS):
            rest = (f - sign * np.linalg.norm(weight) / g * a).ravel()
            weight = np.linalg.lstsq(-U, rest, rcond=1e-9)[0]
        squares = ((rest + U @ weight) ** 2).sum()
        direction = sign * weight / max(float(np.linalg.norm(weight)), 1e-300)
        # What is alike with the sign as stated is likelier that.
        if squares < best and direction @ stated < AWAY * g:
            best, out = BETTER**2 * squares, direction
    return out if out is None or np.abs(out).max() < AXIS else np.round(out)


def weighing(log: Prepared, sensor: str, stated: Sensor) -> Weighing:
    """Fit of the forces to gravity alone.

    Raises:
        LogError: A component of the wrench is missing.
        InputError: Gravity, or the sensor's frame or sign, cannot be as stated.
        ExcitationError: The mass is not significant.
    """
    base = log.samples.motion.base
    if base is None or not np.isfinite(log.wrench).all():
        raise LogError(f"A payload needs all six components of the wrench '{sensor}', none of them constant.")
    acceleration = base.dV[:, :3] + np.cross(base.V[:, 3:], base.V[:, :3])
    # Readings are not filtered, so that their noise stays white.
    force = log.recording.wrench(GROUND).on_mechanism
    R, g = base.T[:, :3, :3] @ stated.pose[:3, :3], log.mechanism.gravity
    out = weighed(force, g @ R - acceleration @ stated.pose[:3, :3])
    down = other_gravity(force[:, :3], R, acceleration @ stated.pose[:3, :3], g, out.unexplained)
    if down is not None:
        of = "base is" if log.recording.base is None else "axes of the recorded poses are"
        angles = rpy_deg(log.mechanism, down)
        raise InputError(
            f"Gravity has another direction than stated by the forces of '{sensor}': the {of} turned to roll, pitch "
            f"and yaw {rpy_text(angles)}°. Write rpy_deg = {rpy_text(angles)} under [base] in the columns file. Then "
            "check the sign of the wrench."
        )
    if out.angle > TURNED:
        frame = Rotation.from_matrix(stated.pose[:3, :3] @ out.rotation.T)
        quaternion = ", ".join(f"{x:.4f}" for x in frame.as_quat(scalar_first=True, canonical=True))
        raise InputError(
            f"The forces of '{sensor}' follow gravity far better in axes turned by {np.degrees(out.angle):.0f}° from "
            f"where they were stated{' and with the opposite sign' if out.opposite else ''}: its frame in that of the "
            f"payload's body looks like quaternion = [{quaternion}]."
        )
    mean = force[:, :3].mean(axis=0)
    along, size = float(mean @ g / np.linalg.norm(g)), float(np.linalg.norm(mean))
    if out.unexplained > UNEXPLAINED and size > STEADY * force[:, :3].std(axis=0).max() and abs(along) > AWAY * size:
        raise InputError(
            f"The forces of '{sensor}' keep their direction, {size:.3g} N along gravity, while the sensor turns: they "
            "are in the axes of the base, as a controller's TCP force. Turn them into the sensor's axes."
        )
    if out.opposite and out.mass < -BEYOND_CHANCE * out.std and out.unexplained < UNEXPLAINED:
        raise InputError(
            f"The forces of '{sensor}' weigh {out.mass:.3f} kg: they have the opposite sign; under [wrenches.{sensor}] "
            f"applied_to_link says whether they act on the body that is named there (true) or are what it exerts "
            "(false). Or gravity is upside down in the axes of base or poses: rpy_deg = [180, 0, 0] under [base]."
        )
    if out.mass < BEYOND_CHANCE * out.std:
        raise ExcitationError(
            f"The forces of '{sensor}' weigh {out.mass:.2g} ± {out.std:.1g} kg: they show no payload."
        )
    return out


def likely(part: Mechanism, fit: Weighing, place: np.ndarray) -> np.ndarray:
    """φ of bodies with the weighed mass: those of the model, scaled, or else a ball (10 b,)."""
    if part.prior is not None and part.prior[::10].sum() > 0:
        return part.prior * (fit.mass / part.prior[::10].sum())
    radius = (3 * fit.mass / (4 * np.pi * DENSITY)) ** (1 / 3)
    own = parameters_from_com(fit.mass, fit.moment / fit.mass, 0.4 * fit.mass * radius**2 * np.eye(3))
    return np.concatenate([parameter_transform(place) @ own, np.zeros(10 * (len(part.bodies) - 1))])


def known(part: Mechanism) -> dict[str, float]:
    """Standard deviations of such bodies as a prior, which are wide."""
    mass, inertia = part.known[::10], part.known.reshape(-1, 10)[:, 4:7]
    least = inertia[mass > 0].min(axis=1) / mass[mass > 0]
    return {"mass": 1.0, "center": SMALLEST, "inertia": float(max(1.0, SMALLEST**2 / max(least.max(), 1e-8)))}


@typed("setup")
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
    recordings = [recording] if isinstance(recording, Recording) else list(recording)
    if not recordings:
        raise InputError("A payload needs at least one recording, got none.")
    robot, recordings = at_rest(robot.following(recordings[0].followers), recordings)
    robot = mounted(robot, recordings[0])
    part = beyond(robot, recordings, body)
    logged = set().union(*(each.measured for each in recordings))
    part = part.closed([joint for joint in part.tree.joints if f"{joint}_position" not in logged])
    if part.tree.joints:
        raise InputError(
            "A payload is rigid, but there are joints beyond the sensor; hold them where they stand "
            f"({' '.join(f'--fix {joint}' for joint in part.tree.joints)})."
        )
    for number, each in enumerate(recordings, start=1):
        with about(f"Recording {number}"):
            check_wrench(each, sensor, body)
    places, recordings, more = zip(*(on_payload(robot, part, each, body, sensor) for each in recordings), strict=True)
    notes = [note for note in dict.fromkeys(more) if note]
    if len({each.still for each in recordings}) > 1:
        raise InputError("Logs of poses at rest and logs of motions are identified apart; take one kind.")
    if slow := [each for each in recordings if 1 / each.rate >= SLOW and not each.still]:
        raise InputError(f"A motion with a sample every {1 / slow[0].rate:g} s shows no payload.{POSES}")
    massless = replace(part, prior=np.zeros(10 * len(part.bodies)))
    first = prepared(massless, recordings[0], filters=False)
    part = replace(part, prior=likely(part, weighing(first, sensor, recordings[0].sensors[GROUND]), places[0]))
    # With sign, axes and gravity as stated the forces weigh something.
    ready = [replace(prepared(part, each, filters=False), guessed=True) for each in recordings]
    fitting: dict[str, Any] = {"offsets": offsets, "holdout": holdout, "report": report, "known": known(part)}
    fitting["setup"] = {"origin": 0.0, **recordings[0].setup, **checked_deviations("setup", setup or {}, PRIORS)}
    if recordings[0].still:
        # Of 40 simulations of 10 poses, 94 % of the intervals held, with .4 of the poses held out 77 %.
        fitting |= {"estimator": "weighted", "holdout": 0.0, "known": None, "setup": None}
        notes += [
            "Poses at rest: all are fitted and judged by; the sensor's place, axes and gains are taken as stated."
        ]
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


def check_wrench(recording: Recording, sensor: str, body: str) -> None:
    """Refuses a recording without the whole wrench of a sensor on a body.

    Raises:
        LogError: The wrench or some of its components are missing, or never change.
    """
    if sensor not in recording.wrenches:
        known = ", ".join(f"'{name}'" for name in recording.wrenches) or "none"
        raise LogError(
            f"The log needs the wrench '{sensor}', its wrenches are {known}: say in the columns file under "
            f'[wrenches.{sensor}] which columns hold its force and torque, and body = "{body}".'
        )
    values = np.hstack([recording[f"{sensor}_{kind}"] for kind in ("force", "torque")])
    changing = (np.nan_to_num(values) != np.nan_to_num(values[0])).any(axis=0)
    if lacking := [name for name, changes in zip(COMPONENTS, changing, strict=True) if not changes]:
        raise LogError(
            f"A payload needs all six components of the wrench '{sensor}', none of them constant; missing or "
            f"constant: {', '.join(lacking)}."
        )


def on_payload(
    robot: Mechanism, part: Mechanism, recording: Recording, body: str, sensor: str
) -> tuple[np.ndarray, Recording, str]:
    """Pose of the sensor's frame in the body's, the recording with its wrench as ground wrench, and a note, if any."""
    stated = recording.sensors.get(sensor, Sensor())
    place = stated.pose
    if stated.body is not None:
        place = pose_of_body(robot, body, stated.body, f"the wrench '{sensor}'") @ place
    on_it = stated.body is None or stated.body in part.tree.names
    left_out = ", ".join(name for name in recording.wrenches if name != sensor)
    names = {f"{sensor}_{kind}": f"{GROUND}_{kind}" for kind in ("force", "torque")} | {BASE: BASE}
    names |= {name: name for joint in part.joints for kind in STATES if (name := f"{joint}_{kind}")}
    own: dict[str, Any] = {
        kind: {names[name]: x for name, x in getattr(recording, kind).items() if name in names}
        for kind in ("measured", "units", "noise", "streams")
    }
    sensors = {GROUND: Sensor(None, place, stated.applied_to_link is on_it)}
    note = f"Wrenches besides '{sensor}' were left out: {left_out}." if left_out else ""
    return place, replace(recording, **own, true={}, sensors=sensors), note
