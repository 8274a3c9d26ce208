"""What the joint torques of a recording look like: their sign and size, friction, bodies that were not there."""

from collections.abc import Iterator
from typing import TYPE_CHECKING

from ident.judgement.finding import Finding, Place
from ident.judgement.torque_checks import SLOW, lacking_drive
from ident.tolerances import DRIVE

if TYPE_CHECKING:
    from ident.estimate import Estimate

FOLLOWS, WORTH_IT = 0.2, 0.02
"""Share of a residual's variance that friction takes away from which it is likely, if the residual is more than so much
of the signal."""


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
    kinds = {joint: own for joint, own in kinds.items() if own and (result.joint is not None or own != [SLOW])}
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
