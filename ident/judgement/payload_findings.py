"""Whether to believe what a wrist sensor says of a payload."""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ident.judgement.body_findings import consistency_finding
from ident.judgement.finding import Finding
from ident.judgement.fit_findings import (
    course_findings,
    halves_findings,
    model_error_findings,
    quality_findings,
    setup_remarks,
    stuck_findings,
)
from ident.judgement.sensor_findings import clipped_findings, resolution_findings
from ident.recordings.wrench import GROUND

if TYPE_CHECKING:
    from ident.estimate import Estimate

INERTIAS = ("Ixx", "Iyy", "Izz", "Ixy", "Ixz", "Iyz")
"""Moments and products of inertia, as they stand behind mass and centre of mass."""

INTERVAL = 1.96
"""Standard deviations of a 95 % interval."""


def payload_findings(result: "Estimate", told: np.ndarray, sensor: str) -> list[Finding]:
    """What speaks against it, and what else its reader should know, the doubts first.

    Args:
        result: The estimate of what the sensor carries.
        told: Whether the data tell mass, centre of mass and inertias (10,).
        sensor: Name of the wrench.
    """
    ratios = dict(zip(result.channels, result.held_out.ratio.tolist(), strict=True))
    on_fit = [
        *quality_findings(ratios, "held-out"),
        *setup_remarks(result),
        *course_findings(result),
        *halves_findings(result),
        *model_error_findings(result),
        *stuck_findings(result),
        *clipped_findings(result),
        *resolution_findings(result),
    ]
    if (physical := consistency_finding(result.consistent(), result.prepared.mechanism.bodies)).doubt:
        on_fit.append(physical)
    on_fit = [_of_sensor(finding, sensor) for finding in on_fit]
    if not told[0] or not told[1:4].all():
        on_fit.append(Finding("The motion does not tell mass and centre of mass; turn the sensor further.", True))
    if untold := _untold(told):
        on_fit.append(
            Finding(
                f"The motion does not tell {', '.join(untold)}: likely values stand in, of the model's body or of a "
                "ball as heavy; they need faster turns of the sensor.",
                False,
            )
        )
    return sorted(on_fit, key=lambda finding: not finding.doubt)


def payload_verdict(findings: Sequence[Finding], values: np.ndarray, std: np.ndarray, told: np.ndarray) -> str:
    """Whether to believe it, and how well it is known.

    Args:
        findings: What was found.
        values: Mass, centre of mass and inertias (10,).
        std: Their standard deviations, with what is left open of the set-up (10,).
        told: Which of them the data tell (10,).
    """
    if doubts := sum(finding.doubt for finding in findings):
        count = "one finding below speaks" if doubts == 1 else f"{doubts} findings below speak"
        return f"Do not use it as it is: {count} against it."
    inertia = "inertias are not known" if _untold(told) else f"inertias to {INTERVAL * std[4:].max():.1g} kg m²"
    return (
        f"Usable: {values[0]:.4g} ± {INTERVAL * std[0]:.2g} kg, the centre of mass to "
        f"{1e3 * INTERVAL * std[1:4].max():.2g} mm, {inertia} (95 %)."
    )


def _of_sensor(finding: Finding, sensor: str) -> Finding:
    """A finding that calls the wrench at the base by the sensor's name."""
    wrenches = tuple(sensor if name == GROUND else name for name in finding.place.wrenches)
    text = finding.text.replace(f"'{GROUND}'", f"'{sensor}'")
    return replace(finding, text=text, place=replace(finding.place, wrenches=wrenches))


def _untold(told: np.ndarray) -> list[str]:
    return [name for name, known in zip(INERTIAS, told[4:], strict=True) if not known]
