"""All results of an estimate in JSON's types."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from ident.display.bodies import BodyValue
from ident.geometry.inertia import PARAMETERS
from ident.judgement.evidence import Evidence
from ident.judgement.finding import Finding
from ident.judgement.verdict import Verdict
from ident.trajectory.result import TrajectoryEstimate

VERSION = 2
"""Version of the entries; it grows when one is renamed, removed or changes its meaning."""


def estimate_numbers(evidence: Evidence, findings: Sequence[Finding], verdict: Verdict) -> dict[str, Any]:
    """All results of an estimate for scripts, in JSON's types, but for what it alone has."""
    fit, held, full, condition = evidence.fit, evidence.held_out, evidence.consistent(), evidence.condition_number
    at_rest = [x if np.isfinite(x) else None for x in held.ratio_at_rest(held.residual).tolist()]
    keys = ("residual_rms", "signal_std", "ratio", "relative_rms", "ratio_at_rest")
    each = *(x.tolist() for x in (held.rms, held.signal, held.ratio, held.relative_rms)), at_rest
    bodies = zip(evidence.mechanism.bodies, full.phi.reshape(-1, 10).tolist(), strict=True)
    return {
        "version": VERSION,
        **verdict.to_dict(),
        "findings": [finding.to_dict() for finding in findings],
        "columns": list(fit.names),
        "values": fit.values.tolist(),
        "std": fit.std.tolist(),
        "covariance": fit.covariance.tolist(),
        "regrouping": dict(zip(fit.parameters.names, fit.parameters.expressions(12), strict=True)),
        "condition_number": condition if np.isfinite(condition) else None,
        "part": held.part,
        "offsets": {channel: {"value": value, "std": std} for channel, (value, std) in evidence.offsets.items()},
        "cutoff_hz": evidence.prepared.cutoff,
        "held_out": {c: dict(zip(keys, row, strict=True)) for c, *row in zip(evidence.channels, *each, strict=True)},
        "candidates": {
            name: dict(zip(evidence.channels, x.tolist(), strict=True)) for name, x in evidence.rivals.items()
        },
        "best_candidate": verdict.best,
        "filtered_at_hz": evidence.filtered_at,
        "bounded": {name: {"at_most": most, "std_free": std} for name, (most, std) in evidence.bounded.items()},
        "setup": [each.to_dict() for each in evidence.setup],
        "friction": evidence.friction,
        "weights": _weights(evidence.trajectory),
        "halves": {"rms_z": evidence.disagreement, "widening": evidence.widening, "widened": evidence.widened},
        "logs": {"rms_z": list(evidence.disagreements)},
        "intervals": {name: _limits(full.rows, name) for name in full.bodies},
        "bodies": {name: dict(zip(PARAMETERS, phi, strict=True)) for name, phi in bodies},
    }


def _limits(rows: Sequence[BodyValue], body: str) -> dict[str, Any]:
    """Limits of the 95 % interval of each quantity of a body, None without one, and the data's share."""
    out = {}
    for each in (row for row in rows if row.body == body):
        lower, upper = (x if np.isfinite(x) else None for x in (each.lower, each.upper))
        out[each.quantity] = {"lower": lower, "upper": upper, "share": each.share}
    return out


def _weights(trajectory: TrajectoryEstimate | None) -> dict[str, Any] | None:
    """Noise model of the weights, and the errors of left-out pieces without and with each alternative."""
    if trajectory is None:
        return None
    tried = trajectory.errors
    errors = {name: dict(zip(("without", "with"), each.tolist(), strict=True)) for name, each in tried.items()}
    return {"correlated": trajectory.coloured, "left_out_errors": errors}
