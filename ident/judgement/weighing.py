"""Findings on masses and offsets: `Σ m_i = c · ψ`, with ψ = B φ, beside the mass by the wrenches and the model's.

Bᵀ c selects the masses in φ.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy import special

from ident.estimation.equations import COMPONENTS
from ident.estimation.noise import coefficient_unit
from ident.judgement.checks import standing_mass
from ident.judgement.evidence import Evidence
from ident.judgement.finding import FINDINGS, Finding, Place, Row, listed, percent
from ident.parameters.base_parameters import STANDARD_GRAVITY
from ident.setup import SETUP
from ident.tolerances import INTERVAL, SIGNIFICANT

HEAVY = 0.05
"""Relative difference of the measured mass from the model's from which there is a remark."""

FAR_OFF = 0.3
"""The same from which it is a doubt."""

DRIFT = 0.02
"""Drift of the measured mass over the model's from which there is a remark."""

OFFSET = 0.1
"""Constant offset over the weight, for moments over the weight times the mechanism's reach, that is a doubt."""

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
    bodies = len(evidence.mechanism.bodies)
    B = evidence.fit.parameters.regroup(np.eye(10 * bodies))
    masses = np.tile(np.eye(10)[0], bodies)
    c = np.linalg.lstsq(B, masses, rcond=None)[0]
    if np.linalg.norm(B @ c - masses) > SPANNED * np.linalg.norm(masses):
        return None
    rank = evidence.fit.parameters.rank
    variances = (float(c @ C[:rank, :rank] @ c) for C in (evidence.covariance, evidence.covariance_setup))
    return Mass(float(c @ evidence.fit.psi), *(float(np.sqrt(max(variance, 0))) for variance in variances))


def weight_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on a measured mass that differs from the model's, or drifts."""
    weight = evidence.checks.weight
    if weight is None:
        return
    if abs(weight.measured - weight.model) > HEAVY * weight.model:
        far = abs(weight.measured - weight.model) > FAR_OFF * weight.model
        yield Finding.of("weight_differs", doubt=far, measured=weight.measured, model=weight.model)
    if abs(weight.drift) > DRIFT * weight.model:
        yield Finding.of("weight_drifts", drift=weight.drift)


def mass_by_setup_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on set-up errors that change the mass from that by the wrenches."""
    weight = evidence.checks.weight
    if weight is None or not any(SETUP[each.kind].weighs for each in evidence.setup):
        return
    mass, weighed = estimated_mass(evidence), standing_mass(evidence.prepared)
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


def offset_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on constant offsets beyond noise, doubts if they are large relative to the weight."""
    offsets, scales = evidence.offsets, dict(zip(evidence.channels, evidence.scale.tolist(), strict=True))
    large = {
        channel: (value, std, coefficient_unit(f"offset({channel})", evidence.mechanism.tree))
        for channel, (value, std) in offsets.items()
        if abs(value) > 4 * std and abs(value) > 0.3 * scales[channel]
    }
    if not large:
        return
    references = _references(evidence)
    of_weight = {c: abs(offsets[c][0]) / references[c[0]] for c in large if c in COMPONENTS}
    if huge := {c: share for c, share in of_weight.items() if share > OFFSET}:
        own = {c: large[c] for c in huge}
        yield Finding.of("large_offsets", Place(channels=tuple(huge)), offsets=own, shares=huge)
    code = "offsets_taken_out" if evidence.fit.equations.offsets else "offsets_not_fitted"
    yield Finding.of(code, Place(channels=tuple(large)), offsets=large)


def _references(evidence: Evidence) -> dict[str, float]:
    """Sizes with which offsets of forces, `F` in N, and of moments, `M` in N m, are compared.

    Without gravity that is the weight on Earth.
    """
    mechanism = evidence.mechanism
    motion, frame = evidence.prepared.samples.motion, evidence.prepared.frame
    g = float(np.linalg.norm(mechanism.gravity) or np.linalg.norm(STANDARD_GRAVITY))
    weight = max(mechanism.mass * g, 1e-12)
    origins = mechanism.tree.poses(motion.q[:: max(1, len(motion) // 100)])[..., :3, 3]
    reach = float(np.linalg.norm(origins - frame[:3, 3], axis=-1).max())
    return {"F": weight, "M": weight * reach if reach > 0 else np.inf}


def inseparable_findings(evidence: Evidence) -> Iterator[Finding]:
    """A remark on channels whose constant offset cannot be separated from parameters."""
    if channels := evidence.inseparable:
        yield Finding.of("inseparable_offsets", Place(channels=channels), channels=channels)


def _common_gain(mass: float, std: float, model: float) -> str:
    more = mass / model - 1
    return (
        f"The estimate's mass, {mass:.2f} ± {std:.2g} kg, is {percent(abs(more), 1)} {'more' if more > 0 else 'less'} "
        "than the model's. The recording cannot separate it from a gain that all channels share: weigh the mechanism."
    )


def _offset(channel: str, value: float, std: float, unit: str) -> str:
    return f"{channel} {value:.3g} ± {std:.2g} {unit}"


def _large(offsets: Mapping[str, Sequence[Any]], shares: Mapping[str, float]) -> str:
    each = listed(
        (f"{_offset(channel, *offset)} ({percent(shares[channel])})" for channel, offset in offsets.items()), "channels"
    )
    return (
        "Constant offsets are large, in brackets relative to the model's weight, or to its moment at the mechanism's "
        f"reach: {each}. Tare the sensor, and check the model's mass and gravity, and unmeasured supports."
    )


def _taken_out(offsets: Mapping[str, Sequence[Any]]) -> str:
    return f"Constant offsets are taken out: {_all(offsets)}."


def _not_fitted(offsets: Mapping[str, Sequence[Any]]) -> str:
    return f"The measurements have constant offsets that were not fitted: {_all(offsets)}. Fit them with --offsets."


def _all(offsets: Mapping[str, Sequence[Any]]) -> str:
    return listed((_offset(channel, *offset) for channel, offset in offsets.items()), "channels")


FINDINGS.update(
    weight_differs=Row(
        "The wrenches weigh {measured:.2f} kg, the model {model:.2f} kg. Check unmeasured contacts and supports, "
        "units, and whether the model is of this mechanism.",
        doubt=None,
    ),
    weight_drifts=Row(
        "The weighed mass drifts by {drift:+.2f} kg over the recording. Look for an unmeasured contact or a drifting "
        "sensor.",
        doubt=True,
    ),
    mass_by_setup=Row(
        "By the estimated set-up the mechanism has {mass:.2f} ± {std:.2g} kg. The wrenches weigh {weighed:.2f} kg, the "
        "model {model:.2f} kg. Weigh it: if the wrenches are right, that set-up is not.",
        doubt=None,
    ),
    mass_or_common_gain=Row(_common_gain, doubt=False),
    large_offsets=Row(_large, doubt=True),
    offsets_taken_out=Row(_taken_out, doubt=False),
    offsets_not_fitted=Row(_not_fitted, doubt=True),
    inseparable_offsets=Row(
        "This motion does not separate constant offsets of {channels} from masses and first moments, which "
        "take them up. Tare these channels.",
        doubt=False,
    ),
)
