"""Findings on joint torques: their sign and size, friction, and bodies that were not carried."""

from collections.abc import Iterator

import numpy as np

from ident.judgement.evidence import Evidence
from ident.judgement.finding import Finding
from ident.judgement.place import Place
from ident.judgement.torque_checks import SLOW, lacking_drive
from ident.mechanism.mechanism import Mechanism
from ident.setup import SETUP
from ident.tolerances import DRIVE, DRIVE_UNITS
from ident.trajectory.reversals import rubbing

FOLLOWS, WORTH_IT = 0.2, 0.02
"""Share of a residual's variance that friction explains from which it is likely, and the least residual over signal for
that."""


SMOOTH = 0.02
"""Slip above which friction does not change its sign in a jump, rad/s or m/s."""


def bound_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on drives at their bound of zero, with the upper limits of their one-sided intervals."""
    if not evidence.bounded:
        return
    yield Finding.of(
        "drive_at_bound",
        Place(joints=tuple(dict.fromkeys(_joint(name) for name in evidence.bounded))),
        at_most={name: most for name, (most, _) in evidence.bounded.items()},
        units={name: _unit(evidence.mechanism, name) for name in evidence.bounded},
    )


def reversal_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on the velocities below which torques are down-weighted, and over which friction changes its sign."""
    joint = evidence.trajectory
    if joint is None or joint.reversals is None or evidence.moving_ratio is None:
        return
    reversals, freedoms = joint.reversals, joint.measurement.tree.freedoms
    rubs = {freedoms[freedom]: channel for channel, freedom in rubbing(joint.measurement).items()}
    open_ = {
        name: float(reversals.velocity[c])
        for name, c in rubs.items()
        if reversals.size[c] > joint.fit.noise.channels[c]
    }
    smooth = {name: float(reversals.slip[c]) for name, c in rubs.items() if reversals.slip[c] > SMOOTH}
    if open_:
        ratios = {name: float(evidence.moving_ratio[rubs[name]]) for name in open_}
        moving = {name: ratio for name, ratio in ratios.items() if np.isfinite(ratio)}
        yield Finding.of("breakaway_friction", Place(joints=tuple(open_)), velocities=open_, ratios=moving)
    if smooth:
        yield Finding.of("smooth_coulomb_friction", Place(joints=tuple(smooth)), velocities=smooth)


def _joint(drive: str) -> str:
    """Name of a drive's joint."""
    return drive.partition("(")[2].rstrip(")")


def _unit(mechanism: Mechanism, drive: str) -> str:
    """Unit of a drive."""
    slides = {
        body.joint for body in mechanism.tree.bodies if not body.is_ball and body.moves and not body.twist[3:].any()
    }
    turns, along = DRIVE_UNITS[drive.partition("(")[0]]
    return along if _joint(drive) in slides else turns


def torque_findings(evidence: Evidence) -> Iterator[Finding]:
    """Doubts on torques of another sign or unit than the model's, and on a body that was not carried."""
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
    fixed_by += ["the model's bodies, as far as they are known"] if joint.known else []
    yield Finding.of("torque_scale_estimated", Place(channels=scaled), joints=scaled, fixed_by=tuple(fixed_by))


def low_velocity_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on Stribeck friction that was fitted because the recordings ask for it."""
    fitted = dict(zip(evidence.fit.names, evidence.fit.values.tolist(), strict=True))
    values = {_joint(name): x for name, x in fitted.items() if name.startswith(f"{DRIVE[SLOW]}(")}
    if values and _searched(evidence):
        yield Finding.of("low_velocity_friction", Place(joints=tuple(values)), values=values)


def _searched(evidence: Evidence) -> bool:
    """True if Stribeck friction was searched for."""
    return evidence.trajectory is not None and any(log.searches_stribeck for log in evidence.logs)


def friction_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on friction that is not fitted and would explain the residual torque."""
    drives, searched = evidence.fit.equations.drives, _searched(evidence)
    kinds = {joint: lacking_drive(drives, joint) for joint in evidence.friction}
    # A low-pass over a reversal looks like friction that is more at low velocity.
    hidden = searched or evidence.trajectory is None
    kinds = {joint: own for joint, own in kinds.items() if own and not (hidden and own == [SLOW])}
    shares = {joint: evidence.friction[joint] for joint in kinds if evidence.ratios[joint] > WORTH_IT}
    shares = {joint: share for joint, share in shares.items() if share > FOLLOWS}
    if shares:
        lacking = {kind for joint in shares for kind in kinds[joint]}
        fitted = {kind for kind, column in DRIVE.items() if any(name.startswith(f"{column}(") for name in drives)}
        wanted = tuple(kind for kind in DRIVE if kind in lacking | fitted)
        place = Place(channels=tuple(shares))
        yield Finding.of("friction_not_fitted", place, doubt=lacking != {SLOW}, shares=shares, drives=wanted)
