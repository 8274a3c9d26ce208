"""Entries of `estimate.json` that every estimate has; docs/reading_a_report.md documents all."""

from collections.abc import Sequence
from math import isfinite
from typing import Any

from ident.judgement.evidence import Evidence
from ident.judgement.finding import Finding
from ident.judgement.verdict import Verdict

VERSION = 2
"""Version of the entries; it grows when one is renamed, removed or changes its meaning."""


def summary(evidence: Evidence, verdict: Verdict, findings: Sequence[Finding]) -> dict[str, Any]:
    """Verdict, findings, coefficients with their covariance, and ratios of residuals, in JSON's types.

    Args:
        evidence: The evidence on a fit.
        verdict: The verdict on it.
        findings: The findings on it.
    """
    fit, number = evidence.fit, evidence.condition_number
    names, expressions = fit.parameters.names, fit.parameters.expressions(12)
    return {
        "version": VERSION,
        **verdict.to_dict(),
        "findings": [finding.to_dict() for finding in findings],
        "columns": list(fit.names),
        "values": fit.values.tolist(),
        "std": fit.std.tolist(),
        "covariance": fit.covariance.tolist(),
        "regrouping": dict(zip(names, expressions, strict=True)),
        "condition_number": number if isfinite(number) else None,
        "part": verdict.part,
        "held_out": {channel: {"ratio": ratio} for channel, ratio in verdict.ratios.items()},
        "offsets": {channel: {"value": value, "std": std} for channel, (value, std) in evidence.offsets.items()},
    }
