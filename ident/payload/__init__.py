"""An identified payload: a rigid body in any frame, the sensor's errors, findings and a verdict."""

from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from scipy import linalg

from ident.display.brief import Brief, listed, rounded
from ident.errors import InputError
from ident.estimate import Estimate
from ident.estimation.setup_parameters import SetupParameter
from ident.geometry.inertia import com_from_parameters, entries, parameter_transform, pseudo_inertia
from ident.geometry.se3 import inverse
from ident.judgement.finding import Finding
from ident.judgement.payload_findings import PayloadVerdict, payload_findings
from ident.judgement.verdict import PRECISIONS
from ident.mechanism.mechanism import Mechanism
from ident.parameters.base_parameters import BaseParameters, structural_base_parameters
from ident.parameters.consistency import ConsistentParameters, consistent_parameters
from ident.parameters.prior import SMALLEST
from ident.parameters.structure import Sensors
from ident.recordings.wrench import GROUND
from ident.tolerances import INTERVAL

QUANTITIES = ("mass", "x", "y", "z", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
"""Quantities of a rigid body: mass in kg, centre of mass in m, inertia about the centre of mass in kg m²."""

UNITS = ("kg", *3 * ["m"], *6 * ["kg m²"])
"""Their units."""

GUESSED = 1.0
"""Width of the prior body, a guess with the mass and centre of the same data: it moves values within their intervals,
which are about the estimate without it; intervals about values whose prior had a width from the same data had 71 % of
Izz."""


class RigidBody(NamedTuple):
    """A rigid body in some frame.

    Attributes:
        values: Mass, centre of mass, and inertia about it in the axes of the frame, as `QUANTITIES` (10,).
        std: Standard deviations from the noise (10,).
        std_setup: Standard deviations including those of set-up errors (10,).
        identifiable: True for identifiable values (10,).
        intervals: 95 % intervals about the estimate without a prior, less what no body can have (10, 2).
    """

    values: np.ndarray
    std: np.ndarray
    std_setup: np.ndarray
    identifiable: np.ndarray
    intervals: np.ndarray


class SensorParameter(NamedTuple):
    """A set-up error of the sensor, zero if the sensor is as stated.

    Attributes:
        name: Its name, such as `offset(Fx)` or `delay(wrist)`.
        value: Its estimate, or for one that was not fitted the estimate if it were, in SI units and radians.
        std: Its standard deviation.
        taken_out: True if it was fitted, so that the estimate is corrected for it.
        setup: The set-up parameter, None for an offset.
    """

    name: str
    value: float
    std: float
    taken_out: bool
    setup: SetupParameter | None = None

    def to_dict(self) -> dict[str, Any]:
        """For scripts, in JSON's types."""
        return {"name": self.name, "value": self.value, "std": self.std, "taken_out": self.taken_out}


@dataclass(frozen=True, eq=False, repr=False)
class Payload(Brief):
    """An identified payload.

    Attributes:
        robot: The whole robot.
        body: Name of the body that, with all bodies on it, is the sensor's load.
        sensor: Name of the wrench.
        place: Pose of the sensor's frame in the body's (4, 4).
        estimate: The estimate of that part of the robot.
        notes: Sentences on wrenches that were left out.
    """

    robot: Mechanism
    body: str
    sensor: str
    place: np.ndarray
    estimate: Estimate
    notes: tuple[str, ...]

    @property
    def _in_short(self) -> dict[str, object]:
        values, _, std, identifiable, _ = self.in_frame()
        rows = list(zip(QUANTITIES, values.tolist(), std.tolist(), identifiable.tolist(), strict=True))
        return {
            "of": self.title,
            "values": listed(f"{name} {' ± '.join(rounded(x, s))}" for name, x, s, seen in rows if seen),
            "not identifiable": listed(name for name, *_, seen in rows if not seen),
            "verdict": str(self.verdict()),
        }

    @property
    def title(self) -> str:
        """The payload in words."""
        return f"What '{self.sensor}' carries"

    @property
    def carried(self) -> str:
        """Sentence on what is carried, and by what."""
        mechanism = self.estimate.prepared.mechanism
        joints, place = ", ".join(mechanism.joints), ", ".join(f"{x:.6g}" for x in self.place[:3, 3].round(6) + 0)
        by = f"by joints {joints}" if joints else "at the recorded poses"
        return f"Carried: {', '.join(mechanism.bodies)}, {by}; sensor at [{place}] m in the frame of '{self.body}'."

    def in_frame(self, T: np.ndarray | None = None) -> RigidBody:
        """The payload as one rigid, physically consistent body.

        A prior chooses among bodies that the data allow. Intervals do not depend on it, so that they hold as often as
        those of ψ; mass and moments of inertia are positive in them.

        Args:
            T: Pose of the frame in which it is expressed, in the frame of the body (4, 4); by default that frame.
        """
        X, psi = parameter_transform(np.eye(4) if T is None else inverse(T)), self._phi
        values, J = described(X @ psi), np.zeros((10, 10))
        for k, step in enumerate(1e-6 * psi[0] * np.repeat([1, SMALLEST, SMALLEST**2], [1, 3, 6])):
            ahead = step * X[:, k]
            J[:, k] = (described(X @ psi + ahead) - described(X @ psi - ahead)) / (2 * step)
        std, wider = (np.sqrt(np.maximum(np.diag(J @ C @ J.T), 0)) for C in self._covariances)
        size = np.repeat([values[0], SMALLEST, values[4:7].mean()], [1, 3, 6])
        low, high = values + J @ self._beside + INTERVAL * np.outer([-1, 1], wider)
        low[[0, 4, 5, 6]] = np.maximum(low[[0, 4, 5, 6]], 0)
        ends = np.c_[np.minimum(low, values), np.maximum(high, values)]
        return RigidBody(values, std, wider, wider < PRECISIONS[-1] * size, ends)

    @property
    def _phi(self) -> np.ndarray:
        """φ of the payload as one body, in the body's frame (10,)."""
        return self._whole.regroup(self.physical.phi)

    @property
    def _seen(self) -> np.ndarray:
        """Matrix from what the poses show of φ to φ, zero for the rest (10, r)."""
        return np.eye(10)[:, [self._whole.kept.index(k) for k in self.estimate.base.kept]]

    @property
    def _beside(self) -> np.ndarray:
        """φ by the data alone, less that of the physical body (10,)."""
        return np.asarray(self._seen @ (self.estimate.psi - self.physical.psi))

    @property
    def _covariances(self) -> tuple[np.ndarray, np.ndarray]:
        """Covariances of φ of the payload as one body, from the noise and with that of the set-up (10, 10)."""
        S, rank = self._seen, self.estimate.base.rank
        unknown = (self._phi[0] * SMALLEST**2) ** 2 * np.diag(1 - S.sum(axis=1))
        noise, wider = self.estimate.covariance, self.estimate.covariance_setup[:rank, :rank]
        return unknown + S @ noise @ S.T, unknown + S @ wider @ S.T

    @cached_property
    def _whole(self) -> BaseParameters:
        """Regrouping of all ten parameters of one rigid body, of which poses at rest show four."""
        return structural_base_parameters(self.estimate.prepared.mechanism, sensors=Sensors(moving_base=True))

    @cached_property
    def physical(self) -> ConsistentParameters:
        """Physically consistent bodies with the estimated ψ; their prior is only a guess from the same wrenches."""
        estimate, part = self.estimate, self.estimate.prepared.mechanism
        covariance, base = estimate.covariance, estimate.base
        return consistent_parameters(estimate.psi, covariance, base, part.known, bodies=part.bodies, width=GUESSED)

    @property
    def model(self) -> np.ndarray | None:
        """The payload in the robot's model, as `RigidBody.values` in the body's frame; None if it has no mass there."""
        part = self.robot.beyond(self.body) if self.robot.tree.joints else self.robot
        total = np.zeros(10) if part.prior is None else self._whole.regroup(part.prior)
        return described(total) if total[0] else None

    @cached_property
    def sensor_parameters(self) -> list[SensorParameter]:
        """Offsets of the sensor, and its set-up errors, fitted or not."""
        joint, fit, std = self.estimate.trajectory, self.estimate.fit, np.sqrt(np.diag(self.estimate.covariance_setup))
        rows = list(zip(fit.names, fit.values.tolist(), std.tolist(), strict=True))
        out = [SensorParameter(*row, True) for row in rows[self.estimate.base.rank :]]
        if joint is None:
            return out
        at = np.flatnonzero(joint.is_setup)
        free, (moves, open_) = joint.fit.free[at], joint.fit.scores(np.eye(len(joint.is_setup))[at])
        values = np.where(free, joint.fit.theta[at], moves).tolist()
        stds = np.where(free, joint.std_setup[at], open_).tolist()
        for k, value, s, taken in zip(at.tolist(), values, stds, free.tolist(), strict=True):
            each = replace(joint.setup[k], of=self.sensor) if joint.setup[k].of == GROUND else joint.setup[k]
            out.append(SensorParameter(each.name, value, s, taken, each))
        return out

    @cached_property
    def findings(self) -> list[Finding]:
        """Findings on the payload, the doubts first."""
        body, robot = self.in_frame(), None if self.robot.prior is None else self.robot.mass
        least = self._least_moment() if body.identifiable[4:].any() else None
        return payload_findings(self.estimate, float(body.values[0]), robot, body.identifiable, self.sensor, least)

    def _least_moment(self) -> tuple[np.ndarray, float, float]:
        """Axis of the smallest central moment of inertia, its relative standard deviation and the prior's share.

        The share is the part of a change of the data by which the value moves less.
        """
        own = pseudo_inertia(self.physical.phi.reshape(-1, 10))
        M = np.linalg.solve(own[:, None], pseudo_inertia(np.eye(10)))
        # Near these bodies their prior is one of precision tr(J⁻¹ dJ J⁻¹ dJ).
        R = self._whole.regroup(np.eye(10 * len(own)))
        P = GUESSED**2 * R.T @ linalg.block_diag(*np.linalg.inv(np.einsum("baij,bcji->bac", M, M))) @ R
        _, centre, inertia = com_from_parameters(self._phi)
        moments, axes = np.linalg.eigh(inertia)
        n, (C, wider) = axes[:, 0], self._covariances
        off = centre - n * (n @ centre)
        gradient = np.r_[off @ off, -2 * off, entries(np.outer(n, n)) * np.repeat([1, 2], 3)]
        noise = C @ gradient
        share = noise @ np.linalg.solve(C + P, noise) / (gradient @ noise)
        return n, float(np.sqrt(gradient @ wider @ gradient) / moments[0]), float(share)

    def verdict(self) -> PayloadVerdict:
        """Verdict on the payload with its standard deviations; a sentence when printed."""
        values, _, std, identifiable, _ = self.in_frame()
        return PayloadVerdict.of_body(self.estimate, self.findings, values, std, identifiable)

    def phi_of_robot(self) -> np.ndarray:
        """φ of the whole robot, with the identified values for the sensor's load (10 b,).

        Raises:
            ModelError: The robot's model has no masses.
        """
        phi = self.robot.known.reshape(-1, 10).copy()
        bodies = self.estimate.prepared.mechanism.bodies
        phi[[self.robot.bodies.index(name) for name in bodies]] = self.physical.phi.reshape(-1, 10)
        return phi.ravel()

    def place_of(self, name: str) -> np.ndarray:
        """Pose of a body or site on the payload, in the frame of the payload's body (4, 4); as `place_of`."""
        return place_of(self.robot, self.body, name)


def described(phi: np.ndarray) -> np.ndarray:
    """φ of one body (10,) as `QUANTITIES` (10,)."""
    mass, com, inertia = com_from_parameters(phi)
    return np.array([mass, *com, *entries(inertia)])


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
    poses = tree.poses(np.random.default_rng(0).uniform(-1, 1, (2, tree.size)))
    T = inverse(poses[:, tree.names.index(body)]) @ poses[:, tree.names.index(other)]
    if not np.allclose(T[0], T[1], atol=1e-9):
        raise InputError(f"{what[0].upper()}{what[1:]} is on '{other}', which does not move with '{body}'.")
    return T[0]
