"""Signs in a log that a unit is not what it is taken for: degrees for radians, kilonewtons for newtons."""

from collections.abc import Mapping, Sequence

import numpy as np

from ident.errors import LogError
from ident.recordings.mapping import GROUND, ColumnMapping

TURNS = 20.0
"""Range of a hinge's angles, rad, beyond which they are suspected to be degrees."""

KILONEWTONS = 500.0
"""How many times a force falls short of the weight if it is suspected to be in kilonewtons."""


def check_angles(mapping: ColumnMapping, q: np.ndarray, joints: Sequence[str], slides: Sequence[str]) -> None:
    """Refuses positions of hinges that look like degrees, unless their unit is stated."""
    for joint, extent in zip(joints, np.ptp(q, axis=0), strict=True):
        columns = mapping.columns[f"joints.{joint}.position"]
        if extent > TURNS and joint not in slides and not columns.unit_stated:
            raise LogError(
                f"column '{columns.names[0]}', the position of joint '{joint}', ranges over {extent:.3g} rad, which "
                f'looks like degrees; map it, as in position = {{ column = "{columns.names[0]}", unit = "deg" }} '
                f'under [joints.{joint}], or state its unit "rad".'
            )


def check_rates(
    time: np.ndarray, states: Mapping[str, np.ndarray | None], joints: Sequence[str], slides: Sequence[str]
) -> None:
    """Refuses rates of hinges that are in degrees where what they are the rates of is in radians, or the reverse."""
    for kind, rate in (("position", "velocity"), ("velocity", "acceleration")):
        x, dx = states[kind], states[rate]
        if x is None or dx is None:
            continue
        for k, joint in enumerate(joints):
            factor = _rate_factor(time, x[:, k], dx[:, k])
            for suspected in (180 / np.pi, np.pi / 180):
                if 0.8 < abs(factor) / suspected < 1.25 and joint not in slides:
                    raise LogError(
                        f"the {rate} of joint '{joint}' is {factor:.3g} times the derivative of its {kind}, so one of "
                        f"them is in degrees; map it with its unit under [joints.{joint}]."
                    )


def _rate_factor(time: np.ndarray, x: np.ndarray, dx: np.ndarray) -> float:
    """How many times the derivative of x is dx; 0 where they have little to do with each other."""
    m = max(1, len(time) // 100)
    # Differences over many samples, and means over them, hold less noise than derivatives.
    integral = np.append(0, np.cumsum((dx[1:] + dx[:-1]) / 2 * np.diff(time)))
    a, b = x[m:] - x[:-m], integral[m:] - integral[:-m]
    power, other, common = float(a @ a), float(b @ b), float(a @ b)
    return common / power if common**2 > 0.81 * power * other > 1e-30 else 0.0


def unit_of_force(mapping: ColumnMapping, force: np.ndarray, weight: float) -> list[str]:
    """A note if the ground's force (N, 3) is so far below the weight, N, that it may be in kilonewtons."""
    force = force[:, ~np.isnan(force[0])]
    largest = float(np.linalg.norm(force, axis=1).max())
    if not force.shape[1] or largest >= weight / KILONEWTONS or mapping.columns[f"wrenches.{GROUND}.force"].unit_stated:
        return []
    return [
        f"The ground's force is at most {largest:.3g} N where the mechanism weighs {weight:.4g} N: its unit may be "
        f'kN; map it, with unit = "kN" under [wrenches.{GROUND}].'
    ]
