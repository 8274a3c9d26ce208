"""Whether to believe an identification, with reasons in plain words."""

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ident.geometry.inertia import with_bodies
from ident.judgement.body_findings import consistency_finding, mass_findings
from ident.judgement.candidates import candidate_findings, comparisons
from ident.judgement.finding import Finding, Place
from ident.judgement.fit_findings import (
    caveats,
    course_findings,
    halves_findings,
    inseparable_findings,
    model_error_findings,
    posture_findings,
    prior_findings,
    quality_findings,
    setup_remarks,
    slow_residual_findings,
    stuck_findings,
)
from ident.judgement.plane_findings import plane_findings
from ident.judgement.sensor_findings import clipped_findings, resolution_findings
from ident.judgement.torque_findings import bound_findings, friction_findings, reversal_findings, torque_findings
from ident.judgement.weighing import common_gain_findings, mass_by_setup_findings
from ident.judgement.wrench_findings import (
    base_findings,
    contact_findings,
    fitted_offset_findings,
    frame_findings,
    weight_findings,
)
from ident.tolerances import POOR

if TYPE_CHECKING:
    from ident.estimate import Estimate

PRECISIONS = 0.1, 0.2, 0.5
"""Standard deviations, of the values, up to which parameters are counted as known."""

WIDER = 2.0
"""How many times the deviation from the noise is to be that with the set-up to be worth a word."""


def verdict(result: "Estimate", findings: list[Finding]) -> str:
    """Whether to believe it, how the candidates compare, and what for; first, whether another one predicts better."""
    first = [each.text for each in candidate_findings(result)]
    said = [*first, sentence(_ratios(result), findings, "held-out"), *comparisons(result)]
    return " ".join([*said, *uses(result)] if _usable(_ratios(result), findings) else said)


def uses(result: "Estimate") -> Iterator[str]:
    """What the numbers are good for: how many parameters they tell, and to which precision."""
    std = result.std_setup
    known = [int((std <= share * np.abs(result.psi)).sum()) for share in PRECISIONS]
    counts = ", ".join(f"{n} within {share:.0%}" for n, share in zip(known, PRECISIONS, strict=True))
    yield f"Of {len(std)} base parameters it knows {counts}."
    wider = [name for name, a, b in zip(result.base.names, result.std, std, strict=True) if b > WIDER * a]
    if wider:
        listed = _listed(wider, result.prepared.mechanism.bodies)
        yield f"What is not known of the set-up more than doubles the deviations of {listed}."


def _listed(names: Sequence[str], bodies: Sequence[str]) -> str:
    return with_bodies(names[:8], bodies) + (f" and {len(names) - 8} more" if len(names) > 8 else "")


def _ratios(result: "Estimate") -> dict[str, float]:
    return dict(zip(result.channels, result.held_out.ratio.tolist(), strict=True))


def _usable(ratios: Mapping[str, float], findings: Sequence[Finding]) -> bool:
    """Whether a channel is predicted, and nothing speaks against the estimate."""
    return min(ratios.values()) <= POOR and not any(finding.doubt for finding in findings)


def sentence(ratios: Mapping[str, float], findings: Sequence[Finding], part: str) -> str:
    """The verdict on channels whose residuals on some part have these ratios to their signals."""
    explained = {channel: ratio for channel, ratio in ratios.items() if ratio <= POOR}
    if not explained:
        return f"Do not use it: the model predicts none of the channels on the {part} part."
    doubts = [finding for finding in findings if finding.doubt]
    if doubts:
        count = "one finding below speaks" if len(doubts) == 1 else f"{len(doubts)} findings below speak"
        return f"Do not use it as it is: {count} against it."
    names = ", ".join(explained)
    return f"Usable: {part} residuals are at most {max(explained.values()):.2f} of the signal in {names}."


def unmeasured_findings(result: "Estimate") -> Iterator[Finding]:
    """Samples that were left out, with the number of their log where there are several."""
    for k, (log, _) in enumerate(result.logs):
        for each in log.left_out:
            place = Place(bodies=(each.body,) if each.body else (), span=(each.start, each.end), log=k)
            yield Finding(f"Log {k + 1}: {each.why}" if len(result.logs) > 1 else each.why, False, place)


def findings(result: "Estimate") -> list[Finding]:
    """All findings on the fit, the doubts first, and then those on the updated model."""
    on_fit = [
        *candidate_findings(result),
        *frame_findings(result),
        *base_findings(result),
        *contact_findings(result),
        *unmeasured_findings(result),
        *clipped_findings(result),
        *resolution_findings(result),
        *weight_findings(result.checks.weight),
        *mass_by_setup_findings(result),
        *common_gain_findings(result),
        *fitted_offset_findings(result),
        *torque_findings(result),
        *friction_findings(result),
        *bound_findings(result),
        *reversal_findings(result),
        *plane_findings(result),
        *quality_findings(_ratios(result), "held-out"),
        *setup_remarks(result),
        *course_findings(result),
        *halves_findings(result),
        *prior_findings(result),
        *model_error_findings(result),
        *slow_residual_findings(result),
        *posture_findings(result),
        *inseparable_findings(result.inseparable),
        *stuck_findings(result),
        *(Finding(sentence, False) for sentence in result.checks.unchecked),
        *caveats(result),
    ]
    on_fit.sort(key=lambda finding: not finding.doubt)
    return [*on_fit, *mass_findings(result), consistency_finding(result.consistent(), result.prepared.mechanism.bodies)]
