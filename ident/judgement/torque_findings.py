"""Findings on joint torques: sign and size, friction, bodies that were not carried, and what else moves the joints.

Torques that move a joint contain the weight a G and the inertia b D of masses at the centres of the model's bodies:

    τ = a G(q) + b D(q, q̇, q̈) + friction + spring + offset

Bodies with a times the model's first moments and up to k times its masses have b ≥ a² / k; torques with another unit or
scale b ≥ a / k.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ident.estimation.noise import coefficient_unit
from ident.geometry.inertia import parameters_from_com
from ident.judgement.candidates import NEGLIGIBLE
from ident.judgement.evidence import Evidence
from ident.judgement.finding import Finding, Place
from ident.judgement.residuals import correlated_samples
from ident.judgement.torque_checks import FRICTION, SLOW, friction_columns, inner_samples, lacking_drives
from ident.judgement.wording import listed
from ident.mechanism.mechanism import Mechanism
from ident.model.axes import column_place
from ident.model.regressor import joint_torque_regressor
from ident.parameters.prior import known_covariance
from ident.setup import SETUP
from ident.tolerances import DRIVE, INTERVAL, LIKELY, SINGULAR
from ident.trajectory.fit.fitted import inverse_of_precision
from ident.trajectory.result import TrajectoryEstimate
from ident.trajectory.reversals import rubbing

DEVIATIONS = 4.0
"""Standard deviations from which weight is in a torque, and by which its inertia must be below the least."""


class Parts(NamedTuple):
    """Weight a and inertia b in a torque, over those of the model's masses.

    Attributes:
        weight: a.
        weight_std: Its standard deviation.
        inertia: b.
        inertia_std: Its standard deviation.
    """

    weight: float
    weight_std: float
    inertia: float
    inertia_std: float

    @property
    def moves(self) -> bool:
        """False if the inertia is significantly below the least that goes with the weight, the model's without any.

        Inertia far below zero is no lack of it but another error of the model.
        """
        weight = abs(self.weight) if abs(self.weight) > DEVIATIONS * self.weight_std else 1.0
        least = weight * min(weight, 1.0) / LIKELY
        return not -least <= self.inertia + DEVIATIONS * self.inertia_std < least


def cause_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on loops that were left out, on joints that something else moves, and on computed torques."""
    for loop, joints in evidence.mechanism.loops.items():
        if acting := tuple(joint for joint in joints if joint in evidence.channels):
            yield Finding.of("loop_left_out", loop=loop, joints=acting)
    checks = evidence.checks.torques
    if checks is None:
        return
    others = {joint: parts._asdict() for joint, parts in torque_parts(evidence).items() if not parts.moves}
    if others and not checks.grossly_wrong:
        yield Finding.of("motion_not_by_torques", joints=others)
    moving = {channel: evidence.ratios[channel] for channel in _torques(evidence) if channel not in evidence.idle}
    # Computed torques leave a tenth of their signal at most, and have a hundredth of it as friction.
    if moving and max(moving.values()) < 0.1:
        friction = _likely_friction(evidence)
        if max(friction[channel] for channel in moving) < 0.01:
            yield Finding.of("computed_torques", joints=tuple(moving), largest=max(moving.values()))


def torque_parts(evidence: Evidence) -> dict[str, Parts]:
    """Weight and inertia in the torques of a resting base's joints, by joint."""
    mechanism, samples = evidence.mechanism, inner_samples(evidence.prepared)
    motion, tree = samples.motion, mechanism.tree
    if motion.base is not None or mechanism.prior is None:
        return {}
    bodies = mechanism.known.reshape(-1, 10)
    masses = [parameters_from_com(phi[0], phi[1:4] / max(phi[0], 1e-300), np.zeros((3, 3))) for phi in bodies]
    at_rest = motion.q, 0 * motion.dq, 0 * motion.ddq
    torques, weight = (
        joint_torque_regressor(tree, *states, gravity=mechanism.gravity) @ np.concatenate(masses)
        for states in (motion.states, at_rest)
    )
    q, axes, out = tree.freedom_coordinates(motion.q), evidence.fit.equations.axes, dict[str, Parts]()
    for measured, k in zip(samples.measured.T[-len(_torques(evidence)) :], evidence.fit.equations.torques, strict=True):
        columns = [weight[:, k], torques[:, k] - weight[:, k], q[:, k], *friction_columns(axes, motion, k)]
        values, std = _regressed(np.stack(columns, axis=1), measured)
        out[tree.freedoms[k]] = Parts(values[0], std[0], values[1], std[1])
    return out


def _regressed(X: np.ndarray, y: np.ndarray) -> tuple[list[float], list[float]]:
    """Coefficients of columns (N, m) in a signal (N,), with deviations for residuals that are alike for some samples.

    Those of columns that are zero or dependent are large.
    """
    norms = np.linalg.norm(X, axis=0)
    norms = np.where(norms > 0, norms, 1)
    U, s, Vt = np.linalg.svd(X / norms, full_matrices=False)
    inverse = 1 / np.maximum(s, SINGULAR * s[0])
    values = Vt.T @ (np.where(s > SINGULAR * s[0], inverse, 0) * (U.T @ y))
    left = y - X / norms @ values
    variance = float(left @ left) / len(y) * correlated_samples(left, 0.999)
    std = np.sqrt(variance * (Vt.T**2 @ inverse**2))
    return (values / norms).tolist(), (std / norms).tolist()


def _torques(evidence: Evidence) -> tuple[str, ...]:
    """Names of the channels that are torques."""
    return evidence.channels[len(evidence.channels) - len(evidence.fit.equations.torques) :]


def _likely_friction(evidence: Evidence) -> dict[str, float]:
    """Largest likely friction in each torque over its signal, or what is left of it if it was not fitted."""
    fit, samples = evidence.fit, evidence.prepared.samples
    axes, torques = fit.equations.axes, list(fit.equations.torques)
    speed = np.sqrt((axes.moved(samples.motion.dq) ** 2).mean(axis=0))
    rubs = np.zeros(len(speed))
    for name, value, std in zip(fit.names, fit.values.tolist(), fit.std.tolist(), strict=True):
        if name in fit.equations.drives and (place := column_place(name))[0] in (*FRICTION, SLOW):
            most, axis = evidence.bounded.get(name, (abs(value) + INTERVAL * std,))[0], axes.names.index(place[1])
            rubs[axis] += most * (speed[axis] if place[0] == FRICTION[0] else 1)
    signal = np.maximum(samples.measured.T[-len(torques) :].std(axis=1), 1e-300)
    shares = dict(zip(_torques(evidence), (np.abs(axes.matrix[:, torques]).T @ rubs / signal).tolist(), strict=True))
    left = {c: np.sqrt(evidence.friction.get(c, 0.0)) * evidence.ratios[c] for c in shares}
    return {channel: max(share, left[channel]) for channel, share in shares.items()}


def drive_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remarks on drives at their bound of zero, with upper limits, and on friction that was fitted at low velocity.

    Torques are not judged below some velocity, and Coulomb friction may change its sign over another one.
    """
    tree, joint = evidence.mechanism.tree, evidence.trajectory
    if evidence.bounded:
        yield Finding.of(
            "drive_at_bound",
            # A drive of a log of its own is named `Fc(hip) of log 2`.
            _place(evidence, (name.partition("(")[2].rpartition(")")[0] for name in evidence.bounded)),
            at_most={name: most for name, (most, _) in evidence.bounded.items()},
            units={name: coefficient_unit(name, tree) for name in evidence.bounded},
        )
    if joint is None:
        return
    if joint.reversals is not None:
        axes, rubs = joint.measurement.equations.axes, rubbing(joint.measurement.equations)
        size, slip, velocity = joint.reversals.size, joint.reversals.slip, joint.reversals.velocity
        open_ = {axes.names[a]: float(velocity[a]) for a in rubs if size[a] > 0}
        # Friction that changes its sign over more than 0.02 rad/s or m/s does not jump.
        smooth = {axes.names[a]: float(slip[a]) for a in rubs if slip[a] > 0.02 * float(axes.gears[a])}
        if open_:
            moved, at_rest = dict.fromkeys(name for axis in open_ for name in axes.joints_of(axis)), evidence.at_rest
            known = {name: at_rest[name] for name in moved if np.isfinite(at_rest.get(name, np.nan))}
            yield Finding.of("breakaway_friction", _place(evidence, open_), velocities=open_, at_rest=known)
        if smooth:
            yield Finding.of("smooth_coulomb_friction", _place(evidence, smooth), velocities=smooth)
    if _searched(evidence):
        fitted = zip(evidence.fit.names, evidence.fit.values.tolist(), strict=True)
        if values := {column_place(name)[1]: x for name, x in fitted if name.startswith(f"{DRIVE[SLOW]}(")}:
            yield Finding.of("low_velocity_friction", _place(evidence, values), values=values)


def _place(evidence: Evidence, names: Iterable[str]) -> Place:
    """The joints of drives' axes, by name."""
    axes = evidence.fit.equations.axes
    return Place(joints=tuple(dict.fromkeys(joint for name in names for joint in axes.joints_of(name))))


def torque_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubts on torques of another sign or unit than the model's, and a remark on a body that was not carried."""
    checks = evidence.checks.torques
    if checks is None:
        return
    if flipped := tuple(check.joint for check in checks.joints if check.flipped):
        yield Finding.of("torque_sign", joints=flipped)
    if gains := checks.gains:
        load = checks.load.body if checks.load is not None and checks.load.possible else None
        yield Finding.of("torque_scale", gains=gains, load=load)
    if checks.absent is not None and not checks.grossly_wrong:
        yield Finding.of("body_not_carried", **checks.absent._asdict())


def scale_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on the torques whose scale was estimated, and on what fixes it."""
    equations, joint = evidence.fit.equations, evidence.trajectory
    scaled = tuple(name for each in evidence.setup if SETUP[each.kind].stated for name in each.place.channels)
    if not scaled or joint is None:
        return
    exact = [name for name in _torques(evidence) if name not in scaled]
    bodies = _fixing_bodies(joint, evidence.mechanism, evidence.known) if joint.known else ()
    reasons = {
        "the measured wrench": equations.wrench is not None,
        f"the torques of {listed(exact)}": exact,
        f"what is stated of {listed(bodies)}": bodies,
        f"the model's {'other ' if bodies else ''}bodies, as far as they are known": joint.known,
    }
    fixed_by = tuple(reason for reason, holds in reasons.items() if holds)
    yield Finding.of("torque_scale_estimated", joints=scaled, fixed_by=fixed_by)


def _searched(evidence: Evidence) -> bool:
    """True if Stribeck friction was searched for."""
    return evidence.trajectory is not None and any(part.log.searches_stribeck for part in evidence.logs)


def friction_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on friction that is not fitted and would explain a fifth of the residual torque, if not negligible."""
    equations, searched = evidence.fit.equations, _searched(evidence)
    lacking_of = {joint: lacking_drives(equations, joint) for joint in evidence.friction}
    kinds = {joint: list(dict.fromkeys(column_place(name)[0] for name in own)) for joint, own in lacking_of.items()}
    # A low-pass over a reversal looks like friction that is more at low velocity.
    hidden = searched or evidence.trajectory is None
    kinds = {joint: own for joint, own in kinds.items() if own and not (hidden and own == [SLOW])}
    shares = {joint: evidence.friction[joint] for joint in kinds if evidence.ratios[joint] > NEGLIGIBLE}
    shares = {joint: share for joint, share in shares.items() if share > 0.2}
    if shares:
        lacking = {kind for joint in shares for kind in kinds[joint]}
        fitted = {column_place(name)[0] for name in equations.drives}
        wanted = tuple(kind for kind in DRIVE if kind in lacking | fitted)
        yield Finding.of("friction_not_fitted", doubt=lacking != {SLOW}, shares=shares, drives=wanted)


def _fixing_bodies(estimate: TrajectoryEstimate, mechanism: Mechanism, known: Mapping[str, float]) -> tuple[str, ...]:
    """Names of the bodies whose own deviations fix the scales of torques, such as a payload that was weighed.

    A body counts if the standard deviation of a scale grows notably once the body is only known as the others are.

    Args:
        estimate: The trajectory estimate, with a prior.
        mechanism: The mechanism, with the deviations of these bodies.
        known: Standard deviations of the other bodies.
    """
    own = mechanism.prior_known
    better = [name for name, each in own.items() if each.get("mass", known["mass"]) < known["mass"]]
    with_all = _scale_deviations(estimate, mechanism, known) if better else np.zeros(0)
    less = {name: {other: each for other, each in own.items() if other != name} for name in better}
    deviations = {name: _scale_deviations(estimate, replace(mechanism, prior_known=less[name]), known) for name in less}
    # A body that brings half of the information widens a deviation by √2.
    return tuple(name for name, without in deviations.items() if (without > np.sqrt(2) * with_all).any())


def _scale_deviations(estimate: TrajectoryEstimate, mechanism: Mechanism, known: Mapping[str, float]) -> np.ndarray:
    """Standard deviations of the scales of torques with a prior of the bodies (k,)."""
    fit, parameters = estimate.fit, estimate.measurement.equations.parameters
    rank, precision = parameters.rank, fit.precision.copy()
    prior = inverse_of_precision(known_covariance(mechanism, parameters, known))
    precision[:rank, :rank] += fit.prior.weight * prior - fit.prior.precision[:rank, :rank]
    free = np.flatnonzero(fit.free)
    variances = np.diag(inverse_of_precision(precision[np.ix_(free, free)]))
    return np.sqrt(variances[[k in estimate.setup and estimate.setup[k].row.stated for k in free.tolist()]])
