"""Report on one pass over recordings: base parameters, numbers for scripts, verdict and findings."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from experiments.data.outcomes import Streamed
from experiments.document import tabular
from experiments.document.document import Card, Document, Headline
from experiments.document.tabular import Regrouped
from experiments.document.terminal import wrapped
from ident.estimation.equations import COMPONENTS
from ident.estimation.units import offset_unit, unit_of
from ident.judgement.evidence import Evidence
from ident.judgement.judges import summary
from ident.regression.ordinary import Fit


def table(estimate: Fit) -> tabular.Table:
    """Base parameters, and offsets in N and N m, with their standard deviations."""
    return tabular.Table(
        f"Base parameters from {estimate.samples} samples, SI units; s.d. of wrench noise, {estimate.noise}",
        *tabular.columns(
            parameter=estimate.names,
            estimated=estimate.values,
            std=estimate.std,
            regrouping=[*estimate.parameters.expressions(digits=4), *[""] * len(estimate.equations.offsets)],
        ),
        deviations={"estimated": "std"},
        regrouped=Regrouped({"": estimate.parameters.expressions(digits=4)}),
        bodies=estimate.equations.mechanism.bodies,
        units=tuple(unit_of(name) or offset_unit(name) for name in estimate.names),
    )


def numbers(result: Streamed) -> dict[str, Any]:
    """All numbers of the estimate for scripts, as `Estimate.to_dict` has them."""
    estimate = result.estimate
    number, offsets = estimate.condition_number, estimate.offsets
    common = summary(estimate, result.verdict, result.findings, condition_number=number, offsets=offsets)
    return {
        **common,
        "singular_values": estimate.singular_values.tolist(),
        "residual_norms": estimate.residual_norms.tolist(),
        "samples": estimate.samples,
        "rows": estimate.rows,
        "method": estimate.method,
        "noise": estimate.noise,
    }


def _lines(estimate: Fit, evidence: Evidence) -> list[str]:
    """Sentences with the main numbers."""
    rms = estimate.residual_norms / np.sqrt(estimate.samples)
    residuals = ", ".join(f"{name} {x:.3g}" for name, x in zip(COMPONENTS, rms, strict=True))
    ratios = ", ".join(f"{name} {x:.2g}" for name, x in evidence.ratios.items())
    return [
        f"RMS residuals in N and N m: {residuals}",
        f"RMS residuals of {evidence.part} samples over the channels' standard deviations: {ratios}",
        f"Condition number {estimate.condition_number:.1f}; {estimate.method}",
        *filter(None, [estimate.parameters.remark]),
    ]


def document(result: Streamed, model: Path, recordings: Sequence[Path], provenance: dict[str, Any]) -> Document:
    """Document with the base parameters, their numbers, verdict and findings."""
    verdict, shown, lines = str(result.verdict), table(result.estimate), _lines(result.estimate, result.evidence)
    reasons = [finding.line for finding in result.findings]
    return Document(
        f"{model.name}, identified from {', '.join(file.name for file in recordings)} in pieces",
        headline=Headline.of(result.verdict),
        verdict=verdict,
        findings=[*map(Card.of, result.findings)],
        lines=[*lines, *result.notes],
        tables={"base_parameters": shown},
        numbers={
            "estimate": numbers(result),
            "provenance": provenance,
        },
        screen=wrapped("\n".join([shown.text(), *lines, f"Verdict: {verdict}", *reasons, *result.notes])),
    )
