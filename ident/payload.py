"""What a robot carries beyond a wrist sensor: mass, centre of mass and inertia, and what the sensor adds.

The robot's kinematics are known, so that joint angles tell how the sensor moves; what it reads is the wrench of the
bodies beyond it, whose base it is. All of the joint estimate applies: angles are noisy, nothing is differentiated.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ident.errors import ExcitationError, InputError, LogError
from ident.estimate import Estimate
from ident.estimation.joint import Report
from ident.estimation.preparation import Prepared, prepared
from ident.estimation.weighing import TURNED, Weighing, weighed
from ident.geometry.inertia import com_from_parameters, parameter_transform, parameters_from_com
from ident.geometry.se3 import inverse
from ident.identification import identified
from ident.judgement.finding import Finding
from ident.judgement.payload_findings import payload_findings, payload_verdict
from ident.mechanism.mechanism import Mechanism
from ident.recordings.recording import Recording
from ident.recordings.wrench import GROUND, Sensor
from ident.tolerances import HOLDOUT

QUANTITIES = ("mass", "x", "y", "z", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
"""What rigid bodies are described by: kg, m of the centre of mass, kg m² about the centre of mass."""

SIZE = 0.1
"""Radius of gyration, m, and distance of the centre of mass from where it is weighed, that are taken for likely."""

DENSITY = 500.0
"""Density of the ball that stands for a body whose inertia nobody knows, kg/m³: tools are mostly air."""

OPEN = 0.5
"""A quantity is told by the data where its standard deviation is less than this part of its size: of the mass, of
`SIZE` for the centre of mass, of the mean moment of inertia for inertias."""

SEEN = 4.0
"""Standard deviations from which a weighed mass is there."""


class RigidBody(NamedTuple):
    """A rigid body in some frame.

    Attributes:
        values: Mass, centre of mass, and inertia about it in the axes of the frame, as `QUANTITIES` (10,).
        std: Standard deviations from the noise (10,).
        std_setup: The same with what is left open of the set-up (10,).
        told: Which of the values the data tell (10,).
    """

    values: np.ndarray
    std: np.ndarray
    std_setup: np.ndarray
    told: np.ndarray


class SensorParameter(NamedTuple):
    """Something of the sensor that is zero where it is as stated.

    Attributes:
        name: Its name, as `offset(Fx)` or `delay(wrist)`.
        value: What it is, or would be if it were fitted besides, in SI units and radians.
        std: Its standard deviation.
        taken_out: Whether the estimate takes it for this.
    """

    name: str
    value: float
    std: float
    taken_out: bool


@dataclass(frozen=True, eq=False)
class Payload:
    """What is carried.

    Attributes:
        robot: The whole robot.
        body: Name of the body that has, with all on it, what the sensor carries.
        sensor: Name of the wrench.
        place: Pose of the sensor's frame in the body's (4, 4).
        estimate: The estimate of that part of the robot.
        notes: What was left out.
    """

    robot: Mechanism
    body: str
    sensor: str
    place: np.ndarray
    estimate: Estimate
    notes: tuple[str, ...]

    def in_frame(self, T: np.ndarray | None = None) -> RigidBody:
        """All that is carried as one rigid, physical body.

        Args:
            T: Pose of the frame to write it in, in the frame of the body (4, 4); by default the latter itself.
        """
        X, psi = parameter_transform(np.eye(4) if T is None else inverse(T)), self.estimate.consistent().psi
        values, J = described(X @ psi), np.zeros((10, 10))
        for k, step in enumerate(1e-6 * psi[0] * np.repeat([1, SIZE, SIZE**2], [1, 3, 6])):
            ahead = step * X[:, k]
            J[:, k] = (described(X @ psi + ahead) - described(X @ psi - ahead)) / (2 * step)
        covariances = self.estimate.covariance, self.estimate.covariance_setup[:10, :10]
        std, wider = (np.sqrt(np.maximum(np.diag(J @ C @ J.T), 0)) for C in covariances)
        size = np.repeat([values[0], SIZE, values[4:7].mean()], [1, 3, 6])
        return RigidBody(values, std, wider, wider < OPEN * size)

    @property
    def model(self) -> np.ndarray | None:
        """What the robot's model says of it, as `RigidBody.values` in the body's frame; None where it has no mass."""
        part = self.robot.beyond(self.body)
        total = np.zeros(10) if part.prior is None else self.estimate.base.regroup(part.prior)
        return described(total) if total[0] else None

    @cached_property
    def sensor_parameters(self) -> list[SensorParameter]:
        """Offsets of the sensor, and what of its set-up is not as stated or might not be."""
        joint, names = self.estimate.joint, self.estimate.names
        std = np.sqrt(np.diag(self.estimate.covariance_setup))
        first = self.estimate.base.rank
        rows = zip(names[first:], self.estimate.fit.values[first:].tolist(), std[first:].tolist(), strict=True)
        out = [SensorParameter(name, value, s, True) for name, value, s in rows]
        if joint is None:
            return out
        at = np.flatnonzero(joint.is_setup)
        moves, open_ = joint.fit.scores(np.eye(len(joint.is_setup))[at])
        for k, move, left in zip(at.tolist(), moves.tolist(), open_.tolist(), strict=True):
            name, free = str(joint.fit.names[k]), bool(joint.fit.free[k])
            value, s = (float(joint.fit.theta[k]), float(joint.fit.covariance[k, k] ** 0.5)) if free else (move, left)
            out.append(SensorParameter(name.replace(f"({GROUND})", f"({self.sensor})"), value, s, free))
        return out

    @cached_property
    def findings(self) -> list[Finding]:
        """What speaks against it, and what else its reader should know, the doubts first."""
        return payload_findings(self.estimate, self.in_frame().told, self.sensor)

    def verdict(self) -> str:
        """Whether to believe it, and how well it is known."""
        values, _, std, told = self.in_frame()
        return payload_verdict(self.findings, values, std, told)

    def phi_of_robot(self) -> np.ndarray:
        """φ of the whole robot, with the bodies that the sensor carries as they were found (10 b,).

        Raises:
            ModelError: The robot's model has no masses.
        """
        phi = self.robot.known.reshape(-1, 10).copy()
        part = self.estimate.prepared.mechanism
        for name, own in zip(part.bodies, self.estimate.consistent().phi.reshape(-1, 10), strict=True):
            phi[self.robot.bodies.index(name)] = own
        return phi.ravel()

    def place_of(self, name: str) -> np.ndarray:
        """Pose of a body or site that moves with the payload, in the frame of its body (4, 4).

        Raises:
            InputError: There is none of that name, or joints lie between.
        """
        body, T = (name, np.eye(4)) if name in self.robot.tree.names else self.robot.site(name)
        return _rigid(self.robot, self.body, body, f"'{name}'") @ T


def described(phi: np.ndarray) -> np.ndarray:
    """φ of one body (10,) as `QUANTITIES` (10,)."""
    mass, com, inertia = com_from_parameters(phi)
    return np.array([mass, *com, *inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]])


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
    """Mass, centre of mass and inertia of what a robot carries beyond a wrench sensor.

    Args:
        robot: The whole robot; of its masses those before the sensor do not matter.
        recording: Its joint angles, and what the sensor reads; one recording or several.
        body: Name of the body that has, with all on it, what the sensor carries.
        sensor: Name of the wrench. Where it is measured is on that body, on one that is welded to it, or on the body
            that carries it.
        offsets: Whether to fit a constant offset of every channel.
        holdout: Fraction of each recording, its end, that is not fitted but predicted.
        setup: What is known of the set-up, as for `identify`; the sensor's origin is taken as stated, as the centre of
            mass is where the moments say it is from there.
        report: Called with every round of the estimate.

    Raises:
        InputError: Something is missing or does not fit, or the sensor is mounted in another way than was stated.
        ExcitationError: The motion does not tell the payload from the sensor's offsets.
    """
    recordings = [recording] if isinstance(recording, Recording) else list(recording)
    if not recordings:
        raise InputError("A payload needs at least one recording, got none.")
    part = robot.beyond(body)
    if part.tree.joints:
        raise InputError(
            f"A payload is rigid, but {', '.join(part.tree.joints)} are beyond the sensor; hold them where they stand "
            "(--fix)."
        )
    places, notes = [], list[str]()
    for number, each in enumerate(recordings):
        place, renamed, more = _on_payload(robot, part, each, body, sensor)
        places.append(place)
        recordings[number], notes = renamed, notes + [note for note in more if note not in notes]
    massless = replace(part, prior=np.zeros(10 * len(part.bodies)))
    ready = [prepared(massless, each) for each in recordings]
    weighing = _weighing(ready[0], sensor, recordings[0].sensors[GROUND])
    part = replace(part, prior=_likely(part, weighing, places[0]))
    ready = [prepared(part, each) for each in recordings]
    told = {"origin": 0.0, **recordings[0].setup, **(setup or {})}
    estimate = identified(ready, offsets=offsets, holdout=holdout, setup=told, known=_known(part), report=report)
    # The body that was weighed stands for the model, which therefore is no rival.
    return Payload(robot, body, sensor, places[0], replace(estimate, rivals={}), tuple(notes))


def _on_payload(
    robot: Mechanism, part: Mechanism, recording: Recording, body: str, sensor: str
) -> tuple[np.ndarray, Recording, list[str]]:
    """Pose of the sensor's frame in the body's, the recording with its wrench for that of the ground, and notes."""
    if recording.base is not None:
        raise InputError("A payload is identified on a robot whose own base rests, but the log has a moving base.")
    if sensor not in recording.wrenches:
        known = ", ".join(f"'{name}'" for name in recording.wrenches) or "none"
        raise LogError(
            f"The log needs the wrench '{sensor}', its wrenches are {known}: say in the columns file under "
            f'[wrenches.{sensor}] which columns hold its force and torque, and body = "{body}".'
        )
    stated = recording.sensors.get(sensor, Sensor())
    place = (
        stated.pose if stated.body is None else _rigid(robot, body, stated.body, f"the wrench '{sensor}'") @ stated.pose
    )
    on_it = stated.body is None or stated.body in part.tree.names
    left_out = [name for name in recording.wrenches if name != sensor]
    kept = [f"{joint}_{kind}" for joint in part.joints for kind in ("position", "velocity", "acceleration")]
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


def _rigid(robot: Mechanism, body: str, other: str, what: str) -> np.ndarray:
    """Pose of another body in a body's frame, in which it rests (4, 4).

    Raises:
        InputError: It does not.
    """
    tree = robot.tree
    if other not in tree.names:
        raise InputError(f"There is no body '{other}' for {what}; the bodies are {', '.join(tree.names)}.")
    q = np.random.default_rng(0).uniform(-1, 1, (2, sum(each.coordinates for each in tree.bodies)))
    poses = tree.poses(q)
    T = inverse(poses[:, tree.names.index(body)]) @ poses[:, tree.names.index(other)]
    if not np.allclose(T[0], T[1], atol=1e-9):
        raise InputError(f"{what[0].upper()}{what[1:]} is on '{other}', which does not move with '{body}'.")
    return T[0]


def _weighing(log: Prepared, sensor: str, stated: Sensor) -> Weighing:
    """What gravity alone says, refused where the sensor's frame or sign cannot be as stated."""
    base = log.samples.motion.base
    if base is None or not np.isfinite(log.wrench).all():
        raise LogError(f"A payload needs all six components of the wrench '{sensor}', none of them constant.")
    acceleration = base.dV[:, :3] + np.cross(base.V[:, 3:], base.V[:, :3])
    gravity = log.mechanism.gravity @ base.T[:, :3, :3] - acceleration
    # Readings are not filtered, so that their noise is what it seems.
    out = weighed(log.recording.wrench(GROUND).on_mechanism, gravity @ stated.pose[:3, :3])
    if out.angle > TURNED:
        frame = Rotation.from_matrix(stated.pose[:3, :3] @ out.rotation.T)
        quaternion = ", ".join(f"{x:.4f}" for x in frame.as_quat(scalar_first=True, canonical=True))
        raise InputError(
            f"The forces of '{sensor}' follow gravity far better in axes turned by {np.degrees(out.angle):.0f}° from "
            f"where they were stated{' and with the opposite sign' if out.opposite else ''}: its frame in that of the "
            f"payload's body looks like quaternion = [{quaternion}]."
        )
    if out.opposite and out.mass < -SEEN * out.std:
        raise InputError(
            f"The forces of '{sensor}' weigh {out.mass:.3f} kg: they have the opposite sign; under [wrenches.{sensor}] "
            f"applied_to_link says whether they act on the body that is named there (true) or are what it exerts "
            "(false)."
        )
    if out.mass < SEEN * out.std:
        raise ExcitationError(
            f"The forces of '{sensor}' weigh {out.mass:.2g} ± {out.std:.1g} kg: there is no payload to be seen."
        )
    return out


def _likely(part: Mechanism, weighing: Weighing, place: np.ndarray) -> np.ndarray:
    """φ of bodies that weigh what was weighed: those of the model, scaled, or else a ball (10 b,)."""
    if part.prior is not None and part.prior[::10].sum() > 0:
        return part.prior * (weighing.mass / part.prior[::10].sum())
    radius = (3 * weighing.mass / (4 * np.pi * DENSITY)) ** (1 / 3)
    ball = 0.4 * weighing.mass * radius**2 * np.eye(3)
    own = parameters_from_com(weighing.mass, weighing.moment / weighing.mass, ball)
    return np.concatenate([parameter_transform(place) @ own, np.zeros(10 * (len(part.bodies) - 1))])


def _known(part: Mechanism) -> dict[str, float]:
    """How well such bodies are known, which is hardly."""
    mass, inertia = part.known[::10], part.known.reshape(-1, 10)[:, 4:7]
    least = inertia[mass > 0].min(axis=1) / mass[mass > 0]
    return {"mass": 1.0, "center": SIZE, "inertia": float(max(1.0, SIZE**2 / max(least.max(), 1e-8)))}
