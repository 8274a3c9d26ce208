"""All results of an estimate in JSON's types."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.display.bodies import BodyValue
from ident.geometry.inertia import PARAMETERS
from ident.judgement.summary import summary

if TYPE_CHECKING:
    from ident.estimate import Estimate


def estimate_numbers(estimate: "Estimate") -> dict[str, Any]:
    """All results of an estimate for scripts, in JSON's types."""
    held, full, verdict = estimate.held_out, estimate.consistent(), estimate.verdict()
    keys = ("residual_rms", "signal_std", "ratio", "relative_rms", "ratio_at_rest")
    at_rest = [x if np.isfinite(x) else None for x in held.ratio_at_rest(held.residual).tolist()]
    each = held.rms, held.signal, held.ratio, held.relative_rms
    numbers = zip(*(x.tolist() for x in each), at_rest, strict=True)
    bodies = zip(estimate.prepared.mechanism.bodies, full.phi.reshape(-1, 10).tolist(), strict=True)
    common = summary(
        estimate.fit, verdict, estimate.findings, condition_number=estimate.condition_number, offsets=estimate.offsets
    )
    return {
        **common,
        "std_setup": np.sqrt(np.diag(estimate.covariance_setup)).tolist(),
        "condition_numbers": {k: x if np.isfinite(x) else None for k, x in estimate.condition_numbers.items()},
        "cutoff_hz": estimate.prepared.cutoff,
        "held_out": {c: dict(zip(keys, row, strict=True)) for c, row in zip(estimate.channels, numbers, strict=True)},
        "candidates": {
            name: dict(zip(estimate.channels, x.tolist(), strict=True)) for name, x in estimate.rivals.items()
        },
        "best_candidate": verdict.best,
        "filtered_at_hz": estimate.filtered_at,
        "scales": {joint: {"value": value, "std": std} for joint, (value, std) in estimate.scales.items()},
        "bounded": {name: {"at_most": most, "std_free": std} for name, (most, std) in estimate.bounded.items()},
        "setup": [each.to_dict() for each in estimate.setup],
        "friction": estimate.friction,
        "weights": _weights(estimate),
        "halves": {"rms_z": estimate.disagreement, "widening": estimate.widening},
        "logs": {"rms_z": list(estimate.disagreements)},
        "intervals": {name: _limits(full.rows, name) for name in full.bodies},
        "bodies": {name: dict(zip(PARAMETERS, phi, strict=True)) for name, phi in bodies},
    }


def _limits(rows: Sequence[BodyValue], body: str) -> dict[str, Any]:
    """Limits of the 95 % interval of each quantity of a body, None without one, and the data's share."""
    return {
        each.quantity: {
            "lower": each.lower if np.isfinite(each.lower) else None,
            "upper": each.upper if np.isfinite(each.upper) else None,
            "share": each.share,
        }
        for each in rows
        if each.body == body
    }


def _weights(estimate: "Estimate") -> dict[str, Any] | None:
    """Noise model of the weights, and the errors of left-out pieces without and with each alternative."""
    if estimate.trajectory is None:
        return None
    tried = estimate.trajectory.errors
    errors = {name: dict(zip(("without", "with"), each.tolist(), strict=True)) for name, each in tried.items()}
    return {"correlated": estimate.trajectory.coloured, "left_out_errors": errors}
