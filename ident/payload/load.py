"""Identification of a load from recordings with and without it: from joint torques, commands or plates alone."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np

from ident.annotations import typed
from ident.errors import InputError
from ident.estimate import Estimate
from ident.estimation.preparation import prepared
from ident.geometry.inertia import parameters_from_com
from ident.identification import identified
from ident.judgement.finding import Finding
from ident.judgement.payload_findings import PayloadVerdict, load_findings
from ident.mechanism.mechanism import Mechanism
from ident.parameters.base_parameters import structural_base_parameters
from ident.parameters.consistency import ConsistentParameters, consistent_parameters
from ident.parameters.structure import Sensors
from ident.payload.identified_payload import Payload, SensorParameter
from ident.payload.joint_fit import LOADED, differing, joint_fit
from ident.payload.weight import DENSITY
from ident.recordings.recording import Recording
from ident.tolerances import HOLDOUT
from ident.trajectory.fit.iteration import Report
from ident.trajectory.result import TrajectoryEstimate

EXACT = 1e-4
"""Relative standard deviation of a mass that is stated without one: what scales resolve."""

FAR = 1.0
"""Standard deviation of the prior of a load's centre of mass and radius of gyration about the body's frame, m."""


@dataclass(frozen=True, eq=False, repr=False)
class Load(Payload):
    """An identified load.

    Attributes:
        without: The estimate from recordings without it.
        joint: One fit of all recordings, whose first ten parameters are the load's φ in the body's frame.
        differing: χ² of the recordings with it from those without it, less what the load explains, and its degrees of
            freedom: standard deviations from the noise are widened by Birge's ratio, as for `agreement.widening`.
        weighed: Its mass by a scale, kg; None if it was not stated.
    """

    without: Estimate
    joint: TrajectoryEstimate
    differing: tuple[float, int]
    weighed: tuple[float, float] | None = None

    @property
    def title(self) -> str:
        """The load in words."""
        return "The load"

    @property
    def carried(self) -> str:
        """Sentence on what is carried, and by what."""
        number = len(self.without.logs)
        return (
            f"Carried by '{self.body}'; links, drives and set-up are also those of {number} "
            f"log{'s' * (number > 1)} without it."
        )

    @property
    def _phi(self) -> np.ndarray:
        return self.physical.phi

    @cached_property
    def _covariances(self) -> tuple[np.ndarray, np.ndarray]:
        wider = max(
            self.estimate.widening, self.without.widening, float(np.sqrt(self.differing[0] / self.differing[1]))
        )
        noise = wider**2 * self.joint.fit.covariance[:10, :10]
        return noise, noise + self.joint.covariance_of_setup[:10, :10]

    @cached_property
    def physical(self) -> ConsistentParameters:
        """Physically consistent body near φ; its prior is a ball of the same mass and centre, as wide as `FAR`."""
        phi, alone = self.joint.fit.theta[:10], Mechanism.lone_body("load")
        mass = max(float(phi[0]), 1e-3 * self.robot.mass)
        gyration = np.sqrt(0.2) * (3 * mass / (4 * np.pi * DENSITY)) ** (1 / 3)
        prior = parameters_from_com(mass, np.clip(phi[1:4] / mass, -FAR, FAR), 2 * mass * gyration**2 * np.eye(3))
        base, width = structural_base_parameters(alone, sensors=Sensors(moving_base=True)), FAR / gyration
        return consistent_parameters(phi, self._covariances[0], base, prior, bodies=alone.bodies, width=width)

    @property
    def model(self) -> None:
        """None: the model is of the robot without the load."""

    @cached_property
    def sensor_parameters(self) -> list[SensorParameter]:
        """Set-up errors that were estimated, of all recordings or of those with the load."""
        fit, std = self.joint.fit, np.sqrt(np.diag(self.joint.fit.covariance))
        free = [(k, each) for k, each in self.joint.setup.items() if fit.free[k]]
        return [SensorParameter(fit.names[k], float(fit.theta[k]), float(std[k]), True, each) for k, each in free]

    @cached_property
    def findings(self) -> list[Finding]:
        """Findings on the load and on both estimates, the doubts first."""
        body = self.in_frame()
        rubs = tuple(name for name in self.joint.fit.names if name.startswith(("Fc", "Fv")) and name.endswith(LOADED))
        return load_findings(
            (*self.without.findings, *self.estimate.findings),
            float(self.joint.fit.theta[0]),
            float(body.std_setup[0]),
            self.weighed,
            self.robot.mass,
            body.identifiable,
            rubs=bool(rubs),
            differing=self.differing,
        )

    def verdict(self) -> PayloadVerdict:
        """Verdict on the load with its standard deviations; a sentence when printed."""
        values, _, std, identifiable = self.in_frame()
        return PayloadVerdict.of_body(self.estimate.evidence, self.findings, values, std, identifiable)

    def phi_of_robot(self) -> np.ndarray:
        """φ of the model with the load on its body (10 b,)."""
        phi = self.robot.known.reshape(-1, 10).copy()
        phi[self.robot.bodies.index(self.body)] += self._phi
        return phi.ravel()


@typed()
def identify_load(
    robot: Mechanism,
    without: Recording | Sequence[Recording],
    loaded: Recording | Sequence[Recording] = (),
    *,
    body: str = "",
    mass: float | None = None,
    mass_std: float = 0.0,
    offsets: bool = True,
    holdout: float = HOLDOUT,
    setup: Mapping[str, float] | None = None,
    report: Report | None = None,
) -> Load:
    """Mass, centre of mass and inertia of a load, from recordings without it and with it, in one fit.

    Links, drives and set-up are shared; friction is not where the recordings contradict that.

    Args:
        robot: The whole robot, or a person, without the load.
        without: Joint angles with torques, commands or wrenches, without the load; one recording or several. Those
            that state a load (`[load]` of a columns file, or `Recording.loaded`) have it.
        loaded: The same channels with the load.
        body: Name of the body that carries the load rigidly; by default the one that recordings state.
        mass: Mass of the load by a scale, kg: it fixes the scale of torques that is stated to be uncertain.
        mass_std: Its standard deviation, kg.
        offsets: As for `identify`; so are `holdout` and `setup`.
        report: Called with every iteration of the estimates.

    Raises:
        InputError: Something is missing or does not fit.
        ExcitationError: The motion does not separate the base parameters.
    """
    several = [[each] if isinstance(each, Recording) else list(each) for each in (without, loaded)]
    stated = [each for logs in several for each in logs if each.loaded]
    if not several[1]:
        several = [[each for each in several[0] if not each.loaded], stated]
    bodies = sorted({body, *(each.loaded for each in stated)} - {""})
    if len(bodies) > 1:
        raise InputError(
            f"One load is identified at a time, but body and recordings state one on {' and '.join(bodies)}."
        )
    body = next(iter(bodies), "")
    if body not in robot.bodies:
        raise InputError(
            f"A load needs a body with mass that carries it, got '{body}'; there are {', '.join(robot.bodies)}."
        )
    if (mass is not None and not mass > 0) or mass_std < 0:
        raise InputError(f"mass needs kilograms above zero, and mass_std zero or more; got {mass} and {mass_std}.")
    if not all(several):
        raise InputError("A load needs recordings without it and with it, got none of one kind.")
    several = [[replace(each, loaded="") for each in logs] for logs in several]
    fitting: dict[str, Any] = {"offsets": offsets, "holdout": holdout, "setup": setup, "report": report}
    # The model's bodies are a prior of the robot alone: with the load, its body may be any.
    first = 10 * robot.bodies.index(body)
    heavier = robot.mass / robot.known[first]
    open_ = {"mass": heavier, "center": FAR, "inertia": heavier}
    carrier = replace(robot, prior_known={**robot.prior_known, body: open_})
    ready = [
        [prepared(each, log, filters=False, drive=None) for log in logs]
        for each, logs in zip((robot, carrier), several, strict=True)
    ]
    empty = identified(ready[0], **fitting)
    full = identified(ready[1], known=empty.trajectory is not None and empty.trajectory.known, **fitting)
    if empty.channels != full.channels:
        raise InputError(
            f"Recordings with the load need the channels {', '.join(empty.channels)}; they have "
            f"{', '.join(full.channels)}."
        )
    assert empty.trajectory is not None and full.trajectory is not None
    columns = empty.base.regroup(np.eye(10 * len(robot.bodies))[first : first + 10]).T
    prior = robot.mass * np.repeat([1, FAR, FAR**2], [1, 3, 6]), np.zeros(10)
    if mass is not None:
        prior[0][0], prior[1][0] = max(mass_std, EXACT * mass), mass
    joint = joint_fit(empty.trajectory, full.trajectory, columns, *prior)
    beside = differing(empty.trajectory, full.trajectory, columns, joint)
    weighed = None if mass is None else (mass, mass_std)
    return Load(robot, body, "", np.eye(4), full, (), empty, joint, beside, weighed)
