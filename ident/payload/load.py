"""Identification of a load from recordings with and without it: from joint torques, commands or plates alone.

One fit of all recordings follows from estimates of both kinds, about their own solutions. With a load φ on a body,
whose base parameters are R φ, both share the links' base parameters ψ, drives and set-up:

    θ_without = [ψ, drives, set-up, offsets],    θ_with = [ψ + R φ, drives, set-up, other offsets]

Each estimate is Gaussian about its solution, so that the parameters z = [φ, θ_without, other offsets] of both follow
from the shares of all pieces in one step. Where torques have uncertain scales s, of which the recordings show only the
ratios, both are Gaussian in log(1 + s) and in what the torques state, w ψ with w the geometric mean of 1 + s.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from scipy import linalg, special

from ident.annotations import NotNegative, Positive, typed
from ident.errors import InputError, about
from ident.estimate import Estimate
from ident.estimation.preparation import prepared
from ident.geometry.inertia import parameters_from_com
from ident.identification import identified
from ident.judgement.finding import Finding
from ident.judgement.payload_findings import load_findings
from ident.judgement.residuals import widening
from ident.mechanism.mechanism import Mechanism
from ident.parameters.base_parameters import structural_base_parameters
from ident.parameters.body_bounds import scaled_root
from ident.parameters.consistency import HELD, ConsistentParameters, consistent_parameters
from ident.parameters.structure import Sensors
from ident.payload import Payload, SensorParameter
from ident.payload.beyond_sensor import DENSITY, STEPS
from ident.problem import check_different
from ident.recordings.recording import Recording
from ident.setup import FRICTION, OFFSET, SETUP
from ident.tolerances import HOLDOUT, ROUNDING, SIGNIFICANT
from ident.trajectory.fit.fitted import Prior, TrajectoryFit, embedded, inverse_of_precision
from ident.trajectory.fit.iteration import Report
from ident.trajectory.result import TrajectoryEstimate
from ident.trajectory.trajectory_estimate import RUBS, own_columns

LOADED = " with the load"
"""Ending of the names of parameters that recordings with the load have separately."""

LOAD = tuple(f"load({name})" for name in ("m", "mx", "my", "mz", "Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz"))
"""Names of the load's parameters."""

FAR = 1.0
"""Standard deviation of the prior of a load's centre of mass and radius of gyration about the body's frame, m."""


def joint_fit(
    without: TrajectoryEstimate, loaded: TrajectoryEstimate, columns: np.ndarray, size: np.ndarray, mean: np.ndarray
) -> TrajectoryEstimate:
    """Estimate whose first ten parameters are a load's φ, and the next those of recordings without it.

    Friction is shared unless the recordings contradict that, as gears rub more under load.

    Args:
        without: Estimate from recordings without the load, of r base parameters.
        loaded: Estimate from recordings with it, of the same.
        columns: Base parameters of a unit of each of the load's parameters (r, 10).
        size: Standard deviations of the load's prior, so wide that they matter only where data do not (10,).
        mean: Mean of the load's prior (10,).
    """
    (together, cost), (apart, less) = (
        _joined(without, loaded, columns, Prior(mean, np.diag(size**-2.0)), own) for own in ((), (FRICTION,))
    )
    more = len(apart.fit.names) - len(together.fit.names)
    return apart if more and cost - less > special.chdtri(more, SIGNIFICANT) else together


def differing(
    without: TrajectoryEstimate, loaded: TrajectoryEstimate, columns: np.ndarray, joint: TrajectoryEstimate
) -> tuple[float, int]:
    """χ² of what recordings with and without a load share, less what the load explains, and its degrees of freedom.

    Args:
        without: As for `joint_fit`; so are `loaded` and `columns`.
        loaded: Estimate from recordings with it.
        columns: Base parameters of a unit of each of the load's parameters (r, 10).
        joint: The estimate of both.
    """
    first, last = (_as_stated(each) for each in (without, loaded))
    shared = [name for name in last.names if name in first.names and name + LOADED not in joint.fit.names]
    at = np.array([(first.names.index(name), last.names.index(name)) for name in shared])
    i, k = at[first.free[at[:, 0]] & last.free[at[:, 1]]].T
    design = np.pad(columns, ((0, len(first.theta) - len(columns)), (0, 0)))
    root = scaled_root(first.covariance[np.ix_(i, i)] + last.covariance[np.ix_(k, k)])
    sides = linalg.solve_triangular(root, np.c_[last.theta[k] - first.theta[i], design[i]], lower=True)
    left, X = sides[:, 0], sides[:, 1:]
    explained, _, rank, _ = np.linalg.lstsq(X, left, rcond=ROUNDING)
    return float(np.sum((left - X @ explained) ** 2)), len(i) - int(rank)


def _joined(
    without: TrajectoryEstimate, loaded: TrajectoryEstimate, columns: np.ndarray, load: Prior, apart: tuple[str, ...]
) -> tuple[TrajectoryEstimate, float]:
    """The joint estimate, with offsets and some other kinds of columns separate, and its cost but for a constant."""
    A, B, names = _maps(without, loaded, columns, apart)
    first, last = fits = [_as_stated(each) for each in (without, loaded)]
    end, scales = 10 + len(first.theta), np.flatnonzero(_scales(without) @ A)
    # What both share has its prior once.
    alone = np.flatnonzero(B[:, end:].any(axis=1))
    own = np.zeros((10, 10)), first.prior.precision, last.prior.precision[np.ix_(alone, alone)]
    mean = np.r_[np.zeros(10), first.prior.mean, last.prior.mean[alone]]
    prior = Prior(mean, linalg.block_diag(*own), first.prior.weight)
    maps = list(zip(fits, (A, B), strict=True))
    # Its prior alone determines what no torque shows of a load, such as its mass beside an axis through its body.
    free = np.any([np.arange(len(names)) < 10, *(fit.free @ np.abs(T) > 0 for fit, T in maps)], axis=0)
    fit = replace(
        first,
        names=names,
        theta=np.zeros(len(names)),
        free=free,
        bounded=np.any([fit.bound @ np.abs(T) > 0 for fit, T in maps], axis=0) & ~free,
        # About z = 0.
        shares=[(T.T @ P @ T, T.T @ (g + P @ fit.theta)) for fit, T in maps for P, g in fit.shares],
        scatters=[T.T @ M @ T for fit, T in maps for M in fit.scatter_shares],
    )
    solved = fit
    for _ in range(STEPS if load.mean.any() and len(scales) else 1):
        fit = replace(fit, prior=_with_load(prior, load, scales, solved.theta))
        theta = embedded(inverse_of_precision(fit.precision[np.ix_(free, free)], names), free) @ fit.gradient
        solved = replace(fit, theta=theta, shares=[(P, g - P @ theta) for P, g in fit.shares])
    places = {name: k for k, name in enumerate(names)}
    setup = {places[each.name]: each for each in without.setup.values()}
    setup |= {places[name]: each for each in loaded.setup.values() if (name := each.name + LOADED) in places}
    joint = replace(without.with_fit(solved), setup=setup)
    scaled = np.r_[np.ones(10, bool), _stated(without), np.zeros(len(names) - end, bool)]
    return joint.with_fit(_as_stated(joint, back=scaled)), -float(fit.gradient @ solved.theta)


def _maps(
    without: TrajectoryEstimate, loaded: TrajectoryEstimate, columns: np.ndarray, own: tuple[str, ...]
) -> tuple[np.ndarray, np.ndarray, tuple[str, ...]]:
    """Matrices from all parameters to those of either estimate, (p, q) and (p', q), and the names of all (q,)."""
    first, measurement = without.fit.names, loaded.measurement
    apart = own_columns(measurement, (*own, OFFSET))
    last = [
        name + LOADED if k in apart or k >= len(measurement.names) or name not in first else name
        for k, name in enumerate(loaded.fit.names)
    ]
    names = (*LOAD, *first, *(name for name in last if name not in first))
    A, B = np.eye(len(first), len(names), 10), np.zeros((len(last), len(names)))
    B[range(len(last)), [10 + names[10:].index(name) for name in last]] = 1
    B[: len(columns), :10] = columns
    return A, B, names


def _with_load(prior: Prior, load: Prior, scales: np.ndarray, theta: np.ndarray) -> Prior:
    """Prior with that of the load φ, of which torques state w φ, about some parameters."""
    logs = theta[scales].mean() if len(scales) else 0.0
    stated = np.exp(logs) * load.mean
    units, mean = np.eye(10, len(theta)), np.zeros(len(theta))
    units[:, scales] = -stated[:, None] / max(len(scales), 1)
    added = units.T @ load.precision
    precision = prior.precision + added @ units
    right = prior.precision @ prior.mean + added @ (stated * (1 - logs))
    seen = np.flatnonzero(precision.any(axis=0))
    mean[seen] = np.linalg.lstsq(precision[np.ix_(seen, seen)], right[seen], rcond=None)[0]
    return Prior(mean, precision, prior.weight)


def _scales(estimate: TrajectoryEstimate) -> np.ndarray:
    """Mask of the scales of torques that are estimated (p,)."""
    at = [k for k, each in estimate.setup.items() if SETUP[each.kind].stated and estimate.fit.free[k]]
    return np.isin(np.arange(len(estimate.fit.names)), at)


def _stated(estimate: TrajectoryEstimate) -> np.ndarray:
    """Mask of the base parameters and drives, which torques state times their scale (p,)."""
    equations = estimate.measurement.equations
    return np.arange(len(estimate.fit.names)) < equations.parameters.rank + len(equations.drives)


def _as_stated(estimate: TrajectoryEstimate, *, back: np.ndarray | None = None) -> TrajectoryFit:
    """The fit in what torques state of some parameters and in logarithms of the scales, or back from it.

    Args:
        estimate: The estimate.
        back: Mask of these parameters for an estimate in what torques state; None for one that is not (p,).
    """
    fit, scales = estimate.fit, _scales(estimate)
    if not scales.any():
        return fit
    logs = np.log1p(fit.theta[scales]) if back is None else fit.theta[scales]
    whole, own, theta = np.exp(logs.mean()), np.exp(logs), fit.theta.copy()
    if back is None:
        scaled, factor, inverse, slopes, cross = _stated(estimate), whole, 1 / whole, own, -np.ones(len(own))
    else:
        scaled, factor, inverse, slopes, cross = back, 1 / whole, whole, 1 / own, 1 / own
    theta[scaled] *= factor
    theta[scales] = logs if back is None else np.expm1(logs)
    # Derivative of the fit's parameters by the others.
    T = np.diag(np.where(scaled, inverse, 1.0))
    T[scales, scales] = slopes
    T[np.ix_(scaled, scales)] = np.outer(fit.theta[scaled], cross) / len(own)
    mean = theta + np.linalg.solve(T, fit.prior.mean - fit.theta)
    return replace(
        fit,
        theta=theta,
        prior=Prior(mean, T.T @ fit.prior.precision @ T, fit.prior.weight),
        shares=[(T.T @ P @ T, T.T @ g) for P, g in fit.shares],
        scatters=[T.T @ M @ T for M in fit.scatter_shares],
    )


@dataclass(frozen=True, eq=False, repr=False)
class Load(Payload):
    """An identified load.

    Attributes:
        without: The estimate from recordings without it.
        joint: One fit of all recordings, whose first ten parameters are the load's φ in the body's frame.
        differing: χ² of the recordings with it from those without it, less what the load explains, and its degrees of
            freedom: standard deviations from the noise are widened by `residuals.widening`.
        weighed: Its mass by a scale and the standard deviation of that, kg; None if it was not stated.
        unweighed: The joint fit without that mass; None if it was not stated.
    """

    without: Estimate
    joint: TrajectoryEstimate
    differing: tuple[float, int]
    weighed: tuple[float, float] | None = None
    unweighed: TrajectoryEstimate | None = None

    @property
    def title(self) -> str:
        """The load in words."""
        return "The load"

    @property
    def carried(self) -> str:
        """Sentence on what is carried, and by what."""
        logs = f"{len(self.without.logs)} log{'s' * (len(self.without.logs) > 1)}"
        return f"Carried by '{self.body}'; links, drives and set-up are also those of {logs} without it."

    @property
    def _phi(self) -> np.ndarray:
        return self.physical.phi

    @property
    def _beside(self) -> np.ndarray:
        return self.joint.fit.theta[:10] - self._phi

    @cached_property
    def _covariances(self) -> tuple[np.ndarray, np.ndarray]:
        return self._covariances_of(self.joint)

    def _covariances_of(self, joint: TrajectoryEstimate) -> tuple[np.ndarray, np.ndarray]:
        """Covariances of the load's φ in a joint fit, from the noise and with the set-up (10, 10)."""
        chi2, freedom = self.differing
        apart = widening(float(np.sqrt(chi2 / freedom)) if freedom else None)
        wider = max(self.estimate.widening, self.without.widening, apart)
        noise = wider**2 * joint.fit.covariance[:10, :10]
        return noise, noise + joint.covariance_of_setup[:10, :10]

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
        fit, setup = self.joint.fit, self.joint.setup
        rows = zip(fit.names, fit.theta.tolist(), np.sqrt(np.diag(fit.covariance)).tolist(), strict=True)
        return [SensorParameter(*row, True, setup[k]) for k, row in enumerate(rows) if k in setup and fit.free[k]]

    @cached_property
    def findings(self) -> list[Finding]:
        """Findings on the load and on both estimates, the doubts first."""
        body, others = self.in_frame(), (*self.without.findings, *self.estimate.findings)
        rubs = any(name.startswith(RUBS) and name.endswith(LOADED) for name in self.joint.fit.names)
        shown = self.unweighed or self.joint
        mass, std = float(shown.fit.theta[0]), float(np.sqrt(self._covariances_of(shown)[1][0, 0]))
        return load_findings(
            others, mass, std, self.weighed, self.robot.mass, body.identifiable, rubs=rubs, differing=self.differing
        )

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
    mass: Positive | None = None,
    mass_std: NotNegative = 0.0,
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
    if mass is None and mass_std:
        raise InputError(f"mass_std is the standard deviation of mass, which is not given; got {mass_std:g}.")
    several = [[each] if isinstance(each, Recording) else list(each) for each in (without, loaded)]
    bodies = sorted({body, *(each.loaded for logs in several for each in logs)} - {""})
    if not several[1]:
        several = [[each for each in several[0] if bool(each.loaded) is full] for full in (False, True)]
    if len(bodies) > 1:
        raise InputError(
            f"One load is identified at a time, but body and recordings state one on {' and '.join(bodies)}."
        )
    body = "".join(bodies)
    if body not in robot.bodies:
        raise InputError(
            f"A load needs a body with mass that carries it, got '{body}'; there are {', '.join(robot.bodies)}."
        )
    if not all(several):
        raise InputError("A load needs recordings without it and with it, got none of one kind.")
    several = [[replace(each, loaded="") for each in logs] for logs in several]
    fitting: dict[str, Any] = {"offsets": offsets, "holdout": holdout, "setup": setup, "report": report}
    # The model's bodies are a prior of the robot alone: with the load, its body may be any.
    first = 10 * robot.bodies.index(body)
    heavier = robot.mass / robot.known[first]
    open_ = {"mass": heavier, "center": FAR, "inertia": heavier}
    carrier = replace(robot, prior_known={**robot.prior_known, body: open_})
    bare, carrying = (
        [prepared(each, log, filters=False, drive=None, name=f"A recording {whose} the load") for log in logs]
        for each, logs, whose in zip((robot, carrier), several, ("without", "with"), strict=True)
    )
    check_different([*bare, *carrying])
    with about("Recordings without the load"):
        empty = identified(bare, **fitting)
    with about("Recordings with the load"):
        full = identified(carrying, known=empty.trajectory is not None and empty.trajectory.known, **fitting)
    if empty.channels != full.channels:
        raise InputError(
            f"Recordings with the load need the channels {', '.join(empty.channels)}; they have "
            f"{', '.join(full.channels)}."
        )
    assert empty.trajectory is not None and full.trajectory is not None
    columns = empty.base.regroup(np.eye(10 * len(robot.bodies))[first : first + 10]).T
    size, mean = robot.mass * np.repeat([1, FAR, FAR**2], [1, 3, 6]), np.zeros(10)
    joint, weighed, unweighed = joint_fit(empty.trajectory, full.trajectory, columns, size, mean), None, None
    if mass is not None:
        weighed, unweighed = (mass, max(mass_std, HELD * mass)), joint
        size[0], mean[0] = weighed[1], mass
        joint = joint_fit(empty.trajectory, full.trajectory, columns, size, mean)
    beside = differing(empty.trajectory, full.trajectory, columns, joint)
    return Load(robot, body, "", np.eye(4), full, (), empty, joint, beside, weighed, unweighed)
