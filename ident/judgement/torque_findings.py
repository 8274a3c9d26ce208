"""Findings on joint torques: their sign and size, friction, and bodies that were not carried or that fix the scale."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ident.estimation.noise import coefficient_unit
from ident.judgement.candidates import NEGLIGIBLE
from ident.judgement.evidence import Evidence
from ident.judgement.finding import FINDINGS, Finding, Place, Row, bracketed, listed, percent
from ident.judgement.torque_checks import SLOW, lacking_drives
from ident.mechanism.mechanism import Mechanism
from ident.model.axes import column_place
from ident.parameters.prior import known_covariance
from ident.setup import SETUP
from ident.tolerances import DRIVE
from ident.trajectory.fit.precision import inverse_of_precision
from ident.trajectory.result import TrajectoryEstimate
from ident.trajectory.reversals import rubbing

FOLLOWS = 0.2
"""Share of a residual's variance that friction explains from which it is likely, if the residual is not negligible."""

SMOOTH = 0.02
"""Slip above which friction does not change its sign in a jump, rad/s or m/s."""

HALF = np.sqrt(2)
"""Factor on the standard deviation of a scale from which a body fixes it: it brings half of the information."""


def bound_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on drives at their bound of zero, with the upper limits of their one-sided intervals."""
    if not evidence.bounded:
        return
    yield Finding.of(
        "drive_at_bound",
        _place(evidence, (_joint(name) for name in evidence.bounded)),
        at_most={name: most for name, (most, _) in evidence.bounded.items()},
        units={name: coefficient_unit(name, evidence.mechanism.tree) for name in evidence.bounded},
    )


def reversal_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on the velocities below which torques are not judged, and over which friction changes its sign."""
    joint = evidence.trajectory
    if joint is None or joint.reversals is None:
        return
    reversals, equations = joint.reversals, joint.measurement.equations
    axes, rubs = equations.axes, rubbing(equations)
    open_ = {axes.names[a]: float(reversals.velocity[a]) for a in rubs if reversals.size[a] > 0}
    smooth = {
        axes.names[a]: float(reversals.slip[a]) for a in rubs if reversals.slip[a] > SMOOTH * float(axes.gears[a])
    }
    if open_:
        moved = dict.fromkeys(name for axis in open_ for name in axes.joints_of(axis))
        at_rest = {name: evidence.at_rest[name] for name in moved if np.isfinite(evidence.at_rest.get(name, np.nan))}
        yield Finding.of("breakaway_friction", _place(evidence, open_), velocities=open_, at_rest=at_rest)
    if smooth:
        yield Finding.of("smooth_coulomb_friction", _place(evidence, smooth), velocities=smooth)


def _place(evidence: Evidence, names: Iterable[str]) -> Place:
    """The joints of drives' axes, by name."""
    axes = evidence.fit.equations.axes
    return Place(joints=tuple(dict.fromkeys(joint for name in names for joint in axes.joints_of(name))))


def _joint(drive: str) -> str:
    """Name of a drive's joint or motor."""
    return drive.partition("(")[2].rpartition(")")[0]


def torque_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubts on torques of another sign or unit than the model's, and a remark on a body that was not carried."""
    checks = evidence.checks.torques
    if checks is None:
        return
    if flipped := tuple(check.joint for check in checks.joints if check.flipped):
        yield Finding.of("torque_sign", Place(joints=flipped), joints=flipped)
    if gains := checks.gains:
        load = checks.load.body if checks.load is not None and checks.load.possible else None
        yield Finding.of("torque_scale", Place(joints=tuple(gains)), gains=gains, load=load)
    absent = checks.absent
    if absent is not None and absent.suspicious and not checks.grossly_wrong:
        place = Place(bodies=(absent.body,))
        yield Finding.of("body_not_carried", place, body=absent.body, explained=absent.explained)


def scale_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on the torques whose scale was estimated, and on what fixes it."""
    equations, joint = evidence.fit.equations, evidence.trajectory
    scaled = tuple(name for each in evidence.setup if SETUP[each.kind].stated for name in each.place.channels)
    if not scaled or joint is None:
        return
    torques = equations.channels[len(equations.channels) - len(equations.torques) :]
    exact = [name for name in torques if name not in scaled]
    fixed_by = ["the measured wrench"] if equations.wrench is not None else []
    fixed_by += [f"the torques of {', '.join(exact)}"] if exact else []
    bodies = _fixing_bodies(joint, evidence.mechanism, evidence.known) if joint.known else ()
    fixed_by += [f"what is stated of {', '.join(bodies)}"] if bodies else []
    others = "other bodies" if bodies else "bodies"
    fixed_by += [f"the model's {others}, as far as they are known"] if joint.known else []
    yield Finding.of("torque_scale_estimated", Place(channels=scaled), joints=scaled, fixed_by=tuple(fixed_by))


def low_velocity_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on Stribeck friction that was fitted because the recordings ask for it."""
    fitted = dict(zip(evidence.fit.names, evidence.fit.values.tolist(), strict=True))
    values = {_joint(name): x for name, x in fitted.items() if name.startswith(f"{DRIVE[SLOW]}(")}
    if values and _searched(evidence):
        yield Finding.of("low_velocity_friction", _place(evidence, values), values=values)


def _searched(evidence: Evidence) -> bool:
    """True if Stribeck friction was searched for."""
    return evidence.trajectory is not None and any(part.log.searches_stribeck for part in evidence.logs)


def friction_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on friction that is not fitted and would explain the residual torque."""
    equations, searched = evidence.fit.equations, _searched(evidence)
    lacking_of = {joint: lacking_drives(equations, joint) for joint in evidence.friction}
    kinds = {joint: list(dict.fromkeys(column_place(name)[0] for name in own)) for joint, own in lacking_of.items()}
    # A low-pass over a reversal looks like friction that is more at low velocity.
    hidden = searched or evidence.trajectory is None
    kinds = {joint: own for joint, own in kinds.items() if own and not (hidden and own == [SLOW])}
    shares = {joint: evidence.friction[joint] for joint in kinds if evidence.ratios[joint] > NEGLIGIBLE}
    shares = {joint: share for joint, share in shares.items() if share > FOLLOWS}
    if shares:
        lacking = {kind for joint in shares for kind in kinds[joint]}
        fitted = {column_place(name)[0] for name in equations.drives}
        wanted = tuple(kind for kind in DRIVE if kind in lacking | fitted)
        place = Place(channels=tuple(shares))
        yield Finding.of("friction_not_fitted", place, doubt=lacking != {SLOW}, shares=shares, drives=wanted)


def _fixing_bodies(estimate: TrajectoryEstimate, mechanism: Mechanism, known: Mapping[str, float]) -> tuple[str, ...]:
    """Names of the bodies whose own deviations fix the scales of torques, such as a payload that was weighed.

    A body counts if the standard deviation of a scale grows notably once the body is only known as the others are.

    Args:
        estimate: The trajectory estimate, with a prior.
        mechanism: The mechanism, with the deviations of these bodies.
        known: Standard deviations of the other bodies.
    """
    better = [name for name, own in mechanism.prior_known.items() if own.get("mass", known["mass"]) < known["mass"]]
    if not better:
        return ()
    with_all = _scale_deviations(estimate, mechanism, known)
    out = []
    for name in better:
        own = {other: each for other, each in mechanism.prior_known.items() if other != name}
        without = _scale_deviations(estimate, replace(mechanism, prior_known=own), known)
        if (without > HALF * with_all).any():
            out.append(name)
    return tuple(out)


def _scale_deviations(estimate: TrajectoryEstimate, mechanism: Mechanism, known: Mapping[str, float]) -> np.ndarray:
    """Standard deviations of the scales of torques with a prior of the bodies (k,)."""
    fit, parameters = estimate.fit, estimate.measurement.equations.parameters
    rank, precision = parameters.rank, fit.precision.copy()
    prior = inverse_of_precision(known_covariance(mechanism, parameters, known))
    precision[:rank, :rank] += fit.prior.weight * prior - fit.prior.precision[:rank, :rank]
    free = np.flatnonzero(fit.free)
    variances = np.diag(inverse_of_precision(precision[np.ix_(free, free)]))
    return np.sqrt(variances[np.isin(free, _scales(estimate, free))])


def _scales(estimate: TrajectoryEstimate, free: np.ndarray) -> Sequence[int]:
    """Those of some parameters that are scales of torques, by index."""
    return [k for k in free.tolist() if k in estimate.setup and estimate.setup[k].row.stated]


def _scaled(gains: Mapping[str, float], load: str | None = None) -> str:
    or_load = "" if load is None else f" Or '{load}' carries a heavy load that the model lacks."
    return (
        f"Torques equal the model's prediction but for a factor, in brackets: {bracketed(gains, 'joints')}. Check "
        f"their unit, gear ratio and motor constant.{or_load}"
    )


def _friction(shares: Mapping[str, float], drives: Sequence[str]) -> str:
    each = listed((f"{joint} {percent(share)}" for joint, share in shares.items()), "joints")
    return (
        f"Friction is likely and was not fitted. It would explain these shares of the residuals' variance: {each}. "
        f"Fit it: --drive {' '.join(drives)}."
    )


def _bound(at_most: Mapping[str, float], units: Mapping[str, str]) -> str:
    each = listed((f"{name} (at most {most:.2g} {units[name]})" for name, most in at_most.items()), "drives")
    return (
        f"At {'its' if len(at_most) == 1 else 'their'} bound of zero, 95 % limits in brackets: {each}. Intervals of "
        "other parameters are those with the drive free."
    )


def _near_reversals(velocities: Mapping[str, float], at_rest: Mapping[str, float]) -> str:
    return (
        f"Torques count less at low velocity, where friction may be anything up to breakaway. They are not judged "
        f"below, in rad/s (m/s): {bracketed(velocities, 'joints', '.2g')}. Residual over signal there: "
        f"{bracketed(at_rest, 'joints', '.2g') if at_rest else 'there are no such samples'}."
    )


def _smooth_coulomb(velocities: Mapping[str, float]) -> str:
    return (
        f"Coulomb friction changes its sign over a velocity v, in rad/s (m/s): "
        f"{bracketed(velocities, 'joints', '.2g')}. It is fitted and predicted as Fc tanh(q̇ / v)."
    )


def _basis(joints: Sequence[str], fixed_by: Sequence[str]) -> str:
    fixed = " and ".join(fixed_by)
    return (
        f"The scale of the torques of {listed(joints, 'joints')} was estimated. It is fixed by "
        f"{fixed or 'the stated one alone: masses, friction and rotors are as uncertain as that'}."
    )


def _low_velocity(values: Mapping[str, float]) -> str:
    return (
        f"Friction is higher at low velocity, in N m (N): {bracketed(values, 'joints', '.2g')}. It was fitted as "
        "Stribeck friction, Fs."
    )


def _not_carried(body: str, explained: float) -> str:
    return (
        f"Body '{body}' was probably not carried: without it {percent(explained)} of the torques' squared difference "
        "from the model vanishes. Base parameters are not affected; take it out of the updated model."
    )


FINDINGS.update(
    torque_sign=Row(
        "The torques of {joints} seem to have the opposite sign: with it they are far nearer to the model's "
        "prediction. Turn the sign of their columns.",
        doubt=True,
    ),
    torque_scale=Row(_scaled, doubt=True),
    torque_scale_estimated=Row(_basis, doubt=False),
    body_not_carried=Row(_not_carried, doubt=False),
    friction_not_fitted=Row(_friction, doubt=None),
    drive_at_bound=Row(_bound, doubt=False),
    breakaway_friction=Row(_near_reversals, doubt=False),
    low_velocity_friction=Row(_low_velocity, doubt=False),
    smooth_coulomb_friction=Row(_smooth_coulomb, doubt=False),
)
