"""What the joint torques of a recording look like: their sign and size, friction, bodies that were not there."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

import numpy as np

from ident.judgement.finding import Finding, Place
from ident.judgement.torque_checks import SLOW, lacking_drive
from ident.mechanism.mechanism import Mechanism
from ident.tolerances import DRIVE
from ident.trajectory.reversals import rubbing

if TYPE_CHECKING:
    from ident.estimate import Estimate

FOLLOWS, WORTH_IT = 0.2, 0.02
"""Share of a residual's variance that friction takes away from which it is likely, if the residual is more than so much
of the signal."""


SMOOTH = 0.02
"""Slip from which friction does not pass for a jump, rad/s or m/s."""

UNITS = {"Ia": ("kg m²", "kg"), "Fv": ("N m s", "N s/m"), "Fc": ("N m", "N"), "Fs": ("N m", "N")}
"""Units of drives by their columns, of joints that turn and of those that slide."""


def bound_findings(result: "Estimate") -> Iterator[Finding]:
    """A remark on drives that ended at their bound of zero, with the upper limits of their one-sided intervals."""
    if not result.bounded:
        return
    limits = ", ".join(
        f"{most:.2g} {_unit(result.prepared.mechanism, name)}" for name, (most, _) in result.bounded.items()
    )
    one = len(result.bounded) == 1
    yield Finding(
        f"{', '.join(result.bounded)} {'is at its' if one else 'are at their'} bound of zero: at most {limits} (95 %). "
        "What trades with it has the interval that it has with the drive free.",
        False,
        Place(joints=tuple(dict.fromkeys(_joint(name) for name in result.bounded))),
    )


def reversal_findings(result: "Estimate") -> Iterator[Finding]:
    """A remark on the velocities below which torques say little, and over which friction changes its sign."""
    joint = result.trajectory
    if joint is None or joint.reversals is None:
        return
    reversals, freedoms = joint.reversals, joint.measurement.tree.freedoms
    rubs = {freedoms[freedom]: channel for channel, freedom in rubbing(joint.measurement).items()}
    open_ = {name: reversals.velocity[c] for name, c in rubs.items() if reversals.size[c] > joint.fit.noise.channels[c]}
    smooth = {name: reversals.slip[c] for name, c in rubs.items() if reversals.slip[c] > SMOOTH}
    if open_:
        listed = ", ".join(f"{name} {x:.2g}" for name, x in open_.items())
        ratios = {name: result.moving_ratio[rubs[name]] for name in open_}
        moving = ", ".join(f"{name} {x:.2g}" for name, x in ratios.items() if np.isfinite(x)) or "there are no others"
        yield Finding(
            "Friction at rest is anything up to breakaway: torques count less the slower a joint is, in rad/s (m/s) "
            f"below about {listed}. Held-out residual over signal without these samples: {moving}.",
            False,
            Place(joints=tuple(open_)),
        )
    if smooth:
        listed = ", ".join(f"{name} {x:.2g}" for name, x in smooth.items())
        yield Finding(
            f"Coulomb friction does not jump but changes its sign over a velocity, in rad/s (m/s): {listed}; it is "
            "fitted and predicted as Fc tanh(q̇ / that).",
            False,
            Place(joints=tuple(smooth)),
        )


def _joint(drive: str) -> str:
    """Name of the joint that a drive is of."""
    return drive.partition("(")[2].rstrip(")")


def _unit(mechanism: Mechanism, drive: str) -> str:
    """Unit of a drive."""
    slides = {
        body.joint for body in mechanism.tree.bodies if not body.is_ball and body.moves and not body.twist[3:].any()
    }
    turns, along = UNITS[drive.partition("(")[0]]
    return along if _joint(drive) in slides else turns


def torque_findings(result: "Estimate") -> Iterator[Finding]:
    """Torques that are not what the model predicts, against which the fit is no check."""
    checks = result.checks.torques
    if checks is None:
        return
    if flipped := [check.joint for check in checks.joints if check.flipped]:
        yield Finding(
            f"The torques of {', '.join(flipped)} look as if they had the opposite sign: with it they are far nearer "
            "to the model's own prediction.",
            True,
            Place(joints=tuple(flipped)),
        )
    if scaled := {each.joint: each.gain for each in checks.joints if each.scaled and not each.flipped}:
        listed = ", ".join(f"{joint} ({gain:.3g})" for joint, gain in scaled.items())
        yield Finding(
            f"Torques are the model's own but for a factor, in brackets: {listed}; a unit, a gear ratio or "
            "a motor's constant may be missing.",
            True,
            Place(joints=tuple(scaled)),
        )
    absent = checks.absent
    if absent is not None and absent.suspicious and not checks.grossly_wrong:
        yield Finding(
            f"The torques look as if '{absent.body}' was not carried: without it {absent.explained:.0%} of the squared "
            "difference from the model's own prediction vanishes. Take it out of the model, or out of the updated one.",
            True,
            Place(bodies=(absent.body,)),
        )


def friction_findings(result: "Estimate") -> Iterator[Finding]:
    """Residuals that follow the velocity, where friction is not fitted."""
    drives = result.fit.equations.drives
    ratios = dict(zip(result.channels, result.held_out.ratio.tolist(), strict=True))
    kinds = {joint: lacking_drive(drives, joint) for joint in result.friction}
    # A low-pass over a reversal looks like friction that is more at low velocity.
    kinds = {joint: own for joint, own in kinds.items() if own and (result.trajectory is not None or own != [SLOW])}
    shares = {joint: result.friction[joint] for joint in kinds if ratios[joint] > WORTH_IT}
    shares = {joint: share for joint, share in shares.items() if share > FOLLOWS}
    if shares:
        lacking = {kind for joint in shares for kind in kinds[joint]}
        fitted = {kind for kind, column in DRIVE.items() if any(name.startswith(f"{column}(") for name in drives)}
        drive = " ".join(kind for kind in DRIVE if kind in lacking | fitted)
        listed = ", ".join(f"{joint} ({share:.0%})" for joint, share in shares.items())
        yield Finding(
            f"Residuals follow the velocity or its sign, the share of their variance that friction would take away in "
            f"brackets: {listed}. It is likely and was not fitted: --drive {drive}.",
            lacking != {SLOW},
            Place(channels=tuple(shares)),
        )
