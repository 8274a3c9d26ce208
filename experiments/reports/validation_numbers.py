"""Key numbers of the validation for scripts, from which its tables and figures can be made again."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from experiments.data.validation import WORSE, Study, Validation, inside

DIGITS = 6
"""Significant digits."""


def numbers(study: Study) -> dict[str, Any]:
    """Key numbers in JSON types."""
    ratio, z = study.against_best, study.trial_z
    return {
        "channels": len(ratio),
        "best": int((ratio <= 1).sum()),
        "worse": int((ratio > WORSE).sum()),
        "trials_inside_95": None if not len(z) else rounded(inside(z)),
        "recordings": {name: rounded(_recording(each)) for name, each in study.validations.items()},
        "not_run": dict(study.refused),
    }


def _recording(validation: Validation) -> dict[str, Any]:
    """Numbers of a recording."""
    names = ("rivals", "channels", "units", "ratios", "at_rest", "halves", "widening", "outcome", "verdict", "doubts")
    return {
        "values": vars(validation.values),
        "trials": {name: vars(each) for name, each in validation.trials.items()},
        **{name: getattr(validation, name) for name in (*names, "samples", "cutoff", "seconds", "unchecked")},
        "published_z": {each.name: validation.published_z(each) for each in validation.entry.published},
    }


def rounded(value: Any) -> Any:
    """Numbers of any structure in JSON types with `DIGITS` significant digits; infinite ones and NaN become None."""
    if isinstance(value, Mapping):
        return {name: rounded(each) for name, each in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [rounded(each) for each in value]
    if isinstance(value, float):
        return float(f"{value:.{DIGITS}g}") if np.isfinite(value) else None
    return value
