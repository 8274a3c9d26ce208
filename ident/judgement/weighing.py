"""Mass of an estimate compared with that by the wrenches and the model's: `Σ m_i = c · ψ`, with ψ = B φ.

Bᵀ c selects the masses in φ.
"""

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np
from scipy import special

from ident.judgement.checks import standing_mass
from ident.judgement.evidence import Evidence
from ident.judgement.finding import Finding
from ident.judgement.wrench_findings import HEAVY
from ident.setup import SETUP
from ident.tolerances import INTERVAL, SIGNIFICANT

NOTICED = 0.01
"""Change of the mass by the set-up, over the model's mass, from which there is a remark."""

SPANNED = 1e-6
"""Part of the masses outside the span of the base parameters up to which these determine the whole mass."""


class Mass(NamedTuple):
    """The whole mass of an estimate, kg.

    Attributes:
        value: The mass.
        std: Its standard deviation from the noise.
        std_setup: Its standard deviation with the uncertainty of the set-up.
    """

    value: float
    std: float
    std_setup: float


def estimated_mass(evidence: Evidence) -> Mass | None:
    """Mass of all bodies together; None if the base parameters do not determine it."""
    if evidence.covariance_setup is None:
        return None
    bodies = len(evidence.mechanism.bodies)
    B = evidence.fit.parameters.regroup(np.eye(10 * bodies))
    masses = np.tile(np.eye(10)[0], bodies)
    c = np.linalg.lstsq(B, masses, rcond=None)[0]
    if np.linalg.norm(B @ c - masses) > SPANNED * np.linalg.norm(masses):
        return None
    rank = evidence.fit.parameters.rank
    variances = (float(c @ C[:rank, :rank] @ c) for C in (evidence.covariance, evidence.covariance_setup))
    return Mass(float(c @ evidence.fit.psi), *(float(np.sqrt(max(variance, 0))) for variance in variances))


def mass_by_setup_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on set-up errors that change the mass from that by the wrenches."""
    weight = evidence.checks.weight
    if weight is None or not evidence.logs or not any(SETUP[each.kind].weighs for each in evidence.setup):
        return
    mass, weighed = estimated_mass(evidence), standing_mass(evidence.logs[0])
    if mass is None or abs(mass.value - weighed) < max(INTERVAL * mass.std, NOTICED * weight.model):
        return
    farther = abs(mass.value - weight.model) > max(abs(weighed - weight.model), HEAVY * weight.model)
    values = {"mass": mass.value, "std": mass.std, "weighed": weighed, "model": weight.model}
    yield Finding.of("mass_by_setup", doubt=farther, **values)


def common_gain_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remark on a mass that differs from the model's, which a common gain of all channels would explain as well."""
    weight, mass = evidence.checks.weight, estimated_mass(evidence)
    if weight is None or mass is None or weight.model <= 0:
        return
    more = mass.value / weight.model - 1
    z = -float(special.ndtri(SIGNIFICANT / 2))
    if abs(more) > HEAVY and abs(mass.value - weight.model) > z * mass.std:
        yield Finding.of("mass_or_common_gain", mass=mass.value, std=mass.std_setup, model=weight.model)
