"""Entries of `estimate.json` that every estimate has; docs/reading_a_report.md documents all."""

from collections.abc import Mapping, Sequence
from math import isfinite
from typing import Any

from ident.judgement.finding import Finding
from ident.judgement.verdict import Verdict
from ident.regression.ordinary import Fit

VERSION = 2
"""Version of the entries; it grows when one is renamed, removed or changes its meaning."""


def summary(
    fit: Fit,
    verdict: Verdict,
    findings: Sequence[Finding],
    *,
    condition_number: float,
    offsets: Mapping[str, tuple[float, float]],
) -> dict[str, Any]:
    """Verdict, findings, coefficients with their covariance, and ratios of residuals, in JSON's types.

    Args:
        fit: The fit.
        verdict: The verdict on it.
        findings: The findings on it.
        condition_number: Condition number of the columns.
        offsets: Constant offset of each channel where it is identifiable, with its standard deviation.
    """
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
        "condition_number": condition_number if isfinite(condition_number) else None,
        "part": verdict.part,
        "held_out": {channel: {"ratio": ratio} for channel, ratio in verdict.ratios.items()},
        "offsets": {channel: {"value": value, "std": std} for channel, (value, std) in offsets.items()},
    }
