"""The mass of an estimate beside what the wrenches weigh, and beside the model's: `Σ m_i = c · ψ`, with ψ = B φ.

Bᵀ c picks the masses out of φ.
"""

from collections.abc import Iterator
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy import special

from ident.judgement.checks import standing_mass
from ident.judgement.finding import Finding
from ident.judgement.wrench_findings import HEAVY
from ident.tolerances import SIGNIFICANT

if TYPE_CHECKING:
    from ident.estimate import Estimate

INTERVAL = 1.96
"""Standard deviations of a 95 % interval."""

OF_SETUP = ("gain", "gravity", "rotation")
"""Kinds of set-up parameters that change a weight."""

NOTICED = 0.01
"""Change of the weight by the set-up, of the model's mass, that is worth a remark."""

SPANNED = 1e-6
"""Part of the masses that may lie beyond the base parameters where these are taken to hold the whole mass."""


class Mass(NamedTuple):
    """The whole mass of an estimate, kg.

    Attributes:
        value: The mass.
        std: Its standard deviation from the noise.
        std_setup: Its standard deviation with what is left open of the set-up.
    """

    value: float
    std: float
    std_setup: float


def estimated_mass(result: "Estimate") -> Mass | None:
    """The mass of all bodies together, None where the base parameters do not hold it."""
    bodies = len(result.prepared.mechanism.bodies)
    B = result.base.regroup(np.eye(10 * bodies))
    masses = np.tile(np.eye(10)[0], bodies)
    c = np.linalg.lstsq(B, masses, rcond=None)[0]
    if np.linalg.norm(B @ c - masses) > SPANNED * np.linalg.norm(masses):
        return None
    rank = result.base.rank
    variances = (float(c @ C[:rank, :rank] @ c) for C in (result.covariance, result.covariance_setup))
    return Mass(float(c @ result.psi), *(float(np.sqrt(max(variance, 0))) for variance in variances))


def mass_by_setup_findings(result: "Estimate") -> Iterator[Finding]:
    """A set-up that was found and by which the mechanism weighs more or less than the wrenches read."""
    weight = result.checks.weight
    if weight is None or not any(each.name.startswith(OF_SETUP) for each in result.setup):
        return
    mass, weighed = estimated_mass(result), standing_mass(result.prepared)
    if mass is None or abs(mass.value - weighed) < max(INTERVAL * mass.std, NOTICED * weight.model):
        return
    farther = abs(mass.value - weight.model) > max(abs(weighed - weight.model), HEAVY * weight.model)
    yield Finding(
        f"By the set-up that was found the mechanism has {mass.value:.2f} ± {mass.std:.2g} kg; the wrenches weigh "
        f"{weighed:.2f} kg, the model {weight.model:.2f} kg. Weigh it: if the wrenches are right, that set-up "
        "is not.",
        farther,
    )


def common_gain_findings(result: "Estimate") -> Iterator[Finding]:
    """A mass that is not the model's, which a gain of all channels would make as well."""
    weight, mass = result.checks.weight, estimated_mass(result)
    if weight is None or mass is None or weight.model <= 0:
        return
    more = mass.value / weight.model - 1
    z = -float(special.ndtri(SIGNIFICANT / 2))
    if abs(more) > HEAVY and abs(mass.value - weight.model) > z * mass.std_setup:
        yield Finding(
            f"The estimate's mass, {mass.value:.2f} ± {mass.std_setup:.2g} kg, is {abs(more):.1%} "
            f"{'more' if more > 0 else 'less'} than the model's. A gain common to all channels is one with the mass: "
            "the recording cannot tell them apart, a scale can.",
            False,
        )
