"""Checks of a log for wrong units: degrees for radians, kilonewtons for newtons."""

from collections.abc import Sequence
from itertools import product

import numpy as np

from ident.errors import LogError
from ident.mechanism.mechanism import Mechanism
from ident.recordings.columns.mapping import ColumnMapping
from ident.recordings.recording import Recording
from ident.recordings.wrench import GROUND
from ident.tolerances import KILONEWTONS, TURNS


def check_angles(recording: Recording, mapping: ColumnMapping, hinges: Sequence[str]) -> None:
    """Refuses positions of hinges that look like degrees, unless their unit is stated."""
    for joint in hinges:
        columns, extent = mapping.columns[f"joints.{joint}.position"], float(np.ptp(recording[f"{joint}_position"]))
        if extent > TURNS and not columns.unit:
            raise LogError(
                f"column '{columns.names[0]}', the position of joint '{joint}', ranges over {extent:.3g} rad, which "
                f'looks like degrees; map it, as in position = {{ column = "{columns.names[0]}", unit = "deg" }} '
                f'under [joints.{joint}], or state its unit "rad".'
            )


def check_rates(recording: Recording, hinges: Sequence[str]) -> None:
    """Refuses rates of hinges in degrees whose integrals are in radians, or the reverse."""
    for joint, (kind, rate) in product(hinges, (("position", "velocity"), ("velocity", "acceleration"))):
        x, dx = (recording.measured.get(f"{joint}_{quantity}") for quantity in (kind, rate))
        if x is None or dx is None:
            continue
        factor = rate_factor(recording.time, x, dx)
        if any(0.8 < abs(factor) / suspected < 1.25 for suspected in (180 / np.pi, np.pi / 180)):
            raise LogError(
                f"the {rate} of joint '{joint}' is {factor:.3g} times the derivative of its {kind}, so one of them is "
                f"in degrees; map it with its unit under [joints.{joint}]."
            )


def rate_factor(time: np.ndarray, x: np.ndarray, dx: np.ndarray) -> float:
    """Factor of dx to the derivative of x; 0 if the two are hardly correlated."""
    m = max(1, len(time) // 100)
    # Differences and integrals over many samples have less noise than derivatives.
    integral = np.append(0, np.cumsum((dx[1:] + dx[:-1]) / 2 * np.diff(time)))
    a, b = x[m:] - x[:-m], integral[m:] - integral[:-m]
    power, other, common = float(a @ a), float(b @ b), float(a @ b)
    return common / power if common**2 > 0.81 * power * other > 1e-30 else 0.0


def unit_of_force(recording: Recording, mapping: ColumnMapping, mechanism: Mechanism) -> list[str]:
    """A note if the ground's force is so far below the mechanism's weight that its unit may be kilonewtons."""
    force = recording.measured.get(f"{GROUND}_force")
    if force is None or recording.base is not None or mechanism.prior is None:
        return []
    force = force[:, ~np.isnan(force[0])]
    largest = float(np.linalg.norm(force, axis=1).max())
    stated = mapping.columns[f"wrenches.{GROUND}.force"].unit
    if not force.shape[1] or largest >= mechanism.weight / KILONEWTONS or stated:
        return []
    return [
        f"The ground's force is at most {largest:.3g} N where the mechanism weighs {mechanism.weight:.4g} N: its unit "
        f'may be kN; map it, with unit = "kN" under [wrenches.{GROUND}].'
    ]
