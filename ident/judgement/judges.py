"""All judges of an estimate, in their order."""

from collections.abc import Callable, Iterator, Sequence

from ident.judgement.body_findings import consistency_findings, mass_findings
from ident.judgement.candidates import candidate_findings
from ident.judgement.evidence import Evidence
from ident.judgement.finding import Finding, doubts_first
from ident.judgement.fit_findings import (
    caveats,
    course_findings,
    delay_findings,
    exact_setup_findings,
    gravity_findings,
    halves_findings,
    inseparable_findings,
    model_error_findings,
    own_findings,
    posture_findings,
    prior_findings,
    quality_findings,
    setup_remarks,
    slow_residual_findings,
    stuck_findings,
)
from ident.judgement.plane_findings import plane_findings
from ident.judgement.sensor_findings import clipped_findings, resolution_findings, unchecked_findings
from ident.judgement.torque_causes import cause_findings
from ident.judgement.torque_findings import (
    bound_findings,
    friction_findings,
    low_velocity_findings,
    reversal_findings,
    scale_findings,
    torque_findings,
)
from ident.judgement.unmodelled import unmodelled_findings
from ident.judgement.weighing import common_gain_findings, mass_by_setup_findings
from ident.judgement.wrench_findings import (
    base_findings,
    contact_findings,
    frame_findings,
    offset_findings,
    unmeasured_findings,
    weight_findings,
)

ON_FIT: Sequence[Callable[[Evidence], Iterator[Finding]]] = (
    gravity_findings,
    delay_findings,
    candidate_findings,
    frame_findings,
    base_findings,
    contact_findings,
    unmeasured_findings,
    clipped_findings,
    resolution_findings,
    weight_findings,
    mass_by_setup_findings,
    common_gain_findings,
    offset_findings,
    torque_findings,
    cause_findings,
    scale_findings,
    friction_findings,
    bound_findings,
    reversal_findings,
    low_velocity_findings,
    plane_findings,
    quality_findings,
    setup_remarks,
    course_findings,
    halves_findings,
    own_findings,
    prior_findings,
    model_error_findings,
    unmodelled_findings,
    slow_residual_findings,
    posture_findings,
    inseparable_findings,
    stuck_findings,
    unchecked_findings,
    exact_setup_findings,
    caveats,
)
"""Judges of the fit, in the order of their findings."""

ON_BODIES: Sequence[Callable[[Evidence], Iterator[Finding]]] = (mass_findings, consistency_findings)
"""Judges of the updated model."""


def findings(evidence: Evidence) -> list[Finding]:
    """All findings on the fit, the doubts first, and then those on the updated model."""
    on_fit, on_bodies = ([each for judge in judges for each in judge(evidence)] for judges in (ON_FIT, ON_BODIES))
    return [*doubts_first(on_fit), *on_bodies]
