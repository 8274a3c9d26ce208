"""Key numbers of a simulated study."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from experiments.data.simulated import SimulatedStudy
from ident.mechanism.recovered_axes import angle

CHANNELS = ("Fx", "Fy", "Fz", "τx", "τy", "τz")
"""The wrench's components in the paper's names."""

STILL = 1e-9
"""Standard deviation, N or N m, below which a channel has only rounding errors."""


def summary(study: SimulatedStudy) -> dict[str, Any]:
    """Key numbers for scripts; those of a model end with its name."""
    file, numbers = study.file, dict[str, Any]()
    for name in file.models:
        fit, suffix = study.fit(name), file.suffix(name)
        numbers |= {
            f"condition_number{suffix}": fit.estimate.condition_number,
            f"rank{suffix}": fit.base.rank,
            f"rows{suffix}": fit.estimate.rows,
            f"epsilon{suffix}": fit.estimate.epsilon,
            f"largest_error{suffix}": float(np.abs(fit.error).max()),
        }
    published = file.published.get("condition_number", {})
    numbers |= {f"paper_condition_number{file.suffix(name)}": number for name, number in published.items()}
    for entry in file.tables.values():
        if entry["kind"] == "wrench errors":
            numbers["wrench_errors"] = wrench_errors(study, entry["models"])
    numbers |= axes(study) if study.recovers else {}
    numbers |= touches(study) if study.touching else {}
    recording = study.recording
    return numbers | {
        "tracking_error_rad": recording.provenance["tracking_error_rad"],
        "noise": dict(recording.noise),
    }


def axes(study: SimulatedStudy) -> dict[str, float]:
    """Key numbers of the recovered axes."""
    recovered, tree = study.recovered, study.known.tree
    first = tree.moving[0]
    drawn = tree.poses(np.zeros(len(tree.moving)))[first, :3, :3] @ tree.bodies[first].twist[3:]
    alone = [axis.vector for axis in recovered.separate]
    return {
        "tilt_recovered_deg": float(np.degrees(angle(recovered.axes[0].vector, drawn))),
        "axis_error_deg": float(np.degrees(study.axis_error.max())),
        "axis_std_deg": float(np.degrees(max(axis.std for axis in recovered.axes))),
        "axis_difference_alone_deg": float(np.degrees(max([0.0, *(angle(alone[0], other) for other in alone[1:])]))),
        "rank_axes_apart": study.rank_apart,
        "axes_parallel_p_value": float(np.nanmin(recovered.p_values)) if len(alone) > 1 else 1.0,
    }


def trajectory_summary(study: SimulatedStudy) -> dict[str, float | None]:
    """Key numbers of the trajectory estimates, which take longer than all others."""
    numbers: dict[str, float | None] = {}
    for name, model in study.file.models.items():
        if "trajectory" in model.estimators:
            fitted, suffix = study.trajectory(name), study.file.suffix(name)
            numbers |= {f"largest_error{suffix}": fitted.largest_error, f"rms_z{suffix}": fitted.rms_z}
    return numbers


def wrench_errors(study: SimulatedStudy, models: Sequence[str]) -> dict[str, dict[str, float | None]]:
    """RMS errors of the recovered wrenches by channel, and their ratio to the channel's standard deviation."""
    std = study.true.values.std(axis=0)
    rms = {model: np.sqrt((wrench_error(study, model) ** 2).mean(axis=0)) for model in models}
    errors: dict[str, dict[str, float | None]] = {}
    for k, channel in enumerate(CHANNELS):
        errors[channel] = {"true_std": float(std[k])}
        errors[channel] |= {f"rms_{model}": float(x[k]) for model, x in rms.items()}
        ratios = {f"ratio_{model}": float(x[k] / std[k]) if std[k] > STILL else None for model, x in rms.items()}
        errors[channel] |= ratios
    return errors


def wrench_error(study: SimulatedStudy, model: str) -> np.ndarray:
    """Recovered less true, noise-free total wrench (N, 6)."""
    return study.fit(model).predicted - study.true.values


def touches(study: SimulatedStudy) -> dict[str, float]:
    """Fraction and episodes of each contact and its peak force; fractions in which all and none touch."""
    number = np.sum(list(study.touching.values()), axis=0)
    numbers: dict[str, float] = {}
    for name, touching in study.touching.items():
        site = study.file.scene.contacts[name]
        numbers |= {
            f"{site}_fraction": float(touching.mean()),
            f"{site}_fraction_alone": float(np.mean(touching & (number == 1))),
            f"{site}_episodes": int(touching[0] + np.sum(~touching[:-1] & touching[1:])),
            f"{site}_peak_force_N": float(np.linalg.norm(study.recording.true[f"{site}_force"], axis=1).max()),
        }
    return numbers | {
        "contact_peak_force_N": max(x for key, x in numbers.items() if key.endswith("_peak_force_N")),
        "fraction_all_touch": float(np.mean(number == len(study.touching))),
        "fraction_none_touches": float(np.mean(number == 0)),
    }
