"""All judges of an estimate, in their order."""

from collections.abc import Callable, Iterator, Sequence

from ident.judgement import fit_findings as fit
from ident.judgement import residual_findings as residuals
from ident.judgement import sensor_findings as sensors
from ident.judgement import setup_findings as setup
from ident.judgement import torque_findings as torques
from ident.judgement import weighing
from ident.judgement import wrench_findings as wrenches
from ident.judgement.body_findings import consistency_findings, mass_findings
from ident.judgement.candidates import candidate_findings
from ident.judgement.evidence import Evidence
from ident.judgement.finding import Finding, doubts_first
from ident.judgement.torque_causes import cause_findings
from ident.judgement.unmodelled import unmodelled_findings

ON_FIT: Sequence[Callable[[Evidence], Iterator[Finding]]] = (
    *(setup.gravity_findings, setup.delay_findings, candidate_findings),
    *(wrenches.frame_findings, wrenches.base_findings, wrenches.contact_findings, wrenches.unmeasured_findings),
    *(sensors.clipped_findings, sensors.resolution_findings, sensors.tracked_findings),
    *(weighing.weight_findings, weighing.mass_by_setup_findings, weighing.common_gain_findings),
    *(weighing.offset_findings, torques.torque_findings, cause_findings),
    *(torques.scale_findings, torques.friction_findings, torques.bound_findings),
    *(torques.reversal_findings, torques.low_velocity_findings, wrenches.plane_findings),
    *(residuals.quality_findings, setup.setup_remarks, fit.course_findings, fit.halves_findings, fit.own_findings),
    *(fit.prior_findings, residuals.model_error_findings, unmodelled_findings, residuals.slow_residual_findings),
    *(fit.posture_findings, weighing.inseparable_findings, sensors.stuck_findings, sensors.unchecked_findings),
    *(setup.exact_setup_findings, fit.caveats),
)
"""Judges of the fit, in the order of their findings."""

ON_BODIES: Sequence[Callable[[Evidence], Iterator[Finding]]] = (mass_findings, consistency_findings)
"""Judges of the updated model."""


def findings(evidence: Evidence) -> list[Finding]:
    """All findings on the fit, the doubts first, and then those on the updated model."""
    on_fit, on_bodies = ([each for judge in judges for each in judge(evidence)] for judges in (ON_FIT, ON_BODIES))
    return [*doubts_first(on_fit), *on_bodies]
