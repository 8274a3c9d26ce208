"""Findings on masses, offsets and the bodies of the updated model: `Σ m_i = c · ψ`, with ψ = B φ.

Bᵀ c selects the masses in φ.
"""

from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np
from scipy import special

from ident.estimation.accumulator import separable
from ident.estimation.equations import COMPONENTS
from ident.estimation.noise import coefficient_unit
from ident.geometry.inertia import body_of_parameter
from ident.judgement.checks import standing_mass
from ident.judgement.evidence import Evidence
from ident.judgement.finding import Finding, Place
from ident.judgement.residuals import BEYOND_CHANCE
from ident.mechanism.mechanism import Mechanism
from ident.model.axes import column_place
from ident.parameters.base_parameters import STANDARD_GRAVITY
from ident.parameters.prior import conditioned, known_deviations
from ident.setup import SETUP
from ident.tolerances import DRIVE, INTERVAL, SIGNIFICANT

HEAVY = 0.05
"""Relative difference of the measured mass from the model's from which there is a remark."""

FACTOR = 2.0
"""Factor between a body's mass and the model's above which there is a remark."""

SLIGHT = 1e-3
"""Bodies below this fraction of the whole mass are not worth a remark."""


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
    masses = np.tile(np.eye(10)[0], len(evidence.mechanism.bodies))
    B = evidence.fit.parameters.regroup(np.eye(len(masses)))
    c = np.linalg.lstsq(B, masses, rcond=None)[0]
    # Masses outside the span of the base parameters, by more than rounding.
    if np.linalg.norm(B @ c - masses) > 1e-6 * np.linalg.norm(masses):
        return None
    variances = (c @ C[: len(c), : len(c)] @ c for C in (evidence.covariance, evidence.covariance_setup))
    return Mass(float(c @ evidence.fit.psi), *(float(np.sqrt(max(variance, 0))) for variance in variances))


def weight_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on a weighed mass that differs from the model's or drifts, and on another one by the set-up or a gain.

    A drift of 2 % of the model's mass is a remark, a difference of 30 % a doubt. Set-up errors may change the mass from
    that by the wrenches, and a gain that all channels share explains any. Where the estimate has the weighed mass, the
    latter is no remark of its own.
    """
    if (weight := evidence.checks.weight) is None:
        return
    measured, model, drift = weight
    mass, difference, z = estimated_mass(evidence), abs(measured - model), -float(special.ndtri(SIGNIFICANT / 2))
    another = mass is not None and model > 0 and abs(mass.value - model) > max(HEAVY * model, z * mass.std)
    alike = mass is not None and another and abs(mass.value - measured) <= HEAVY * model
    if difference > (0.3 if alike else HEAVY) * model:
        yield Finding.of("weight_differs", doubt=difference > 0.3 * model, measured=measured, model=model)
    if abs(drift) > 0.02 * model:
        yield Finding.of("weight_drifts", drift=drift)
    if mass is None:
        return
    value, std, std_setup = mass
    if any(SETUP[each.kind].weighs for each in evidence.setup):
        weighed = standing_mass(evidence.prepared)
        if abs(value - weighed) >= max(INTERVAL * std, 0.01 * model):
            farther = abs(value - model) > max(abs(weighed - model), HEAVY * model)
            yield Finding.of("mass_by_setup", doubt=farther, mass=value, std=std, weighed=weighed, model=model)
    if another:
        yield Finding.of("mass_or_common_gain", mass=value, std=std_setup, model=model)


def offset_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on constant offsets beyond noise: doubts from a tenth of the weight, for moments times the reach."""
    offsets, scales = evidence.offsets, dict(zip(evidence.channels, evidence.scale.tolist(), strict=True))
    large = {
        channel: (value, std, coefficient_unit(f"offset({channel})", evidence.mechanism.tree))
        for channel, (value, std) in offsets.items()
        if abs(value) > BEYOND_CHANCE * std and abs(value) > 0.3 * scales[channel]
    }
    if not large:
        return
    references = _references(evidence)
    of_weight = {c: abs(offsets[c][0]) / references[c[0]] for c in large if c in COMPONENTS}
    if huge := {c: share for c, share in of_weight.items() if share > 0.1}:
        yield Finding.of("large_offsets", offsets={c: large[c] for c in huge}, shares=huge)
    yield Finding.of("offsets_taken_out" if evidence.fit.equations.offsets else "offsets_not_fitted", offsets=large)


def _references(evidence: Evidence) -> dict[str, float]:
    """Sizes with which offsets of forces, `F` in N, and of moments, `M` in N m, are compared.

    Without gravity that is the weight on Earth.
    """
    mechanism, motion = evidence.mechanism, evidence.prepared.samples.motion
    g = float(np.linalg.norm(mechanism.gravity) or np.linalg.norm(STANDARD_GRAVITY))
    weight = max(mechanism.mass * g, 1e-12)
    origins = mechanism.tree.poses(motion.q[:: max(1, len(motion) // 100)])[..., :3, 3]
    reach = float(np.linalg.norm(origins - evidence.prepared.frame[:3, 3], axis=-1).max())
    return {"F": weight, "M": weight * reach if reach > 0 else np.inf}


def inseparable_findings(evidence: Evidence) -> Iterator[Finding]:
    """A remark on channels whose constant offset cannot be separated from parameters."""
    if channels := evidence.inseparable:
        yield Finding.of("inseparable_offsets", channels=channels)


def consistency_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on the base parameters that are moved to make the bodies physical."""
    full, bodies = evidence.consistent(), evidence.mechanism.bodies
    moved = [{"name": name, "body": body_of_parameter(name, bodies), "z": z} for name, z in full.moved(0.1)[:5]]
    place = Place(bodies=tuple(dict.fromkeys(str(each["body"]) for each in moved if each["body"])))
    if not full.divergence.any():
        yield Finding.of("model_not_contradicted")
    elif full.attainable:
        yield Finding.of("physical_within_region", place, moved=moved)
    else:
        # By noise alone it is about √r.
        far = full.distance > 2 * float(np.sqrt(len(full.psi)))
        yield Finding.of("no_physical_bodies", place, doubt=far, moved=moved)
    if full.rotors:
        joints = tuple(column_place(name)[1] for name in full.rotors)
        yield Finding.of("rotors_apart", Place(joints=joints), rotors=dict(full.rotors))


def mass_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remarks on bodies far from the model's mass, on rotor inertia that explains it, and on heavier last links."""
    full, far = evidence.consistent(), dict[str, dict[str, dict[str, float | None]]]()
    whole = full.phi[::10].sum()
    for each, before in zip(full.rows[::10], evidence.mechanism.known[::10].tolist(), strict=True):
        # Where the model states no mass, a note says so.
        heavy = before and max(each.estimate, before) > SLIGHT * whole
        if heavy and not before / FACTOR <= each.estimate <= before * FACTOR:
            outside = not each.lower <= before <= each.upper
            code = "masses_hardly_shown" if not outside or np.isnan(each.lower) else "masses_limited"
            code = "masses_shown" if outside and each.determined else code
            lower, upper = (x if np.isfinite(x) and x else None for x in (each.lower, each.upper))
            values = {"mass": each.estimate, "model": before, "lower": lower, "upper": upper}
            far.setdefault(code, {})[each.body] = values
    for code, masses in far.items():
        yield Finding.of(code, masses=masses, factor=FACTOR)
    yield from _rotor_findings(evidence, [name for masses in far.values() for name in masses])
    yield from _tool_findings(evidence)


def _rotor_findings(evidence: Evidence, far: Sequence[str]) -> Iterator[Finding]:
    """Remarks on bodies far from the model's mass whose joint's rotor inertia was not fitted or is inseparable."""
    tree, equations = evidence.mechanism.tree, evidence.fit.equations
    torques = {tree.freedoms[k] for k in equations.torques if equations.axes.driven[k]}
    columns = {body.name: (body.joint, f"{DRIVE['rotor']}({body.joint})") for body in tree.bodies if body.name in far}
    lacking = {
        name: columns[name]
        for name in far
        if name in columns and columns[name][0] in torques and columns[name][1] not in equations.drives
    }
    if not lacking:
        return
    with_rotors = equations.with_drives((*equations.drives, *(column for _, column in lacking.values())))
    apart = separable(with_rotors, evidence.prepared.samples).drives
    for code, is_apart in (("rotor_not_fitted", True), ("rotor_inseparable", False)):
        if of := {name: joint for name, (joint, column) in lacking.items() if (column in apart) == is_apart}:
            yield Finding.of(code, Place(bodies=tuple(of), joints=tuple(of.values())), joints=of)


def _tool_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remarks on last links that are heavier than the model if the other bodies are as well known as usually.

    Data and that prior have to halve the mass's deviation; its interval and that of the first moment exclude the
    model's.
    """
    mechanism, known = evidence.mechanism, evidence.known
    included = evidence.trajectory is not None and evidence.trajectory.known
    after = conditioned(
        mechanism, evidence.fit.parameters, evidence.psi_of_links, evidence.covariance, known, included=included
    )
    each = (*after, mechanism.known, known_deviations(mechanism, known))
    phi, std, before, std_before = (x.reshape(-1, 10)[:, :4] for x in each)
    size = np.linalg.norm(phi[:, 1:], axis=1)
    grown = size - np.linalg.norm(before[:, 1:], axis=1)
    std_size = np.linalg.norm(phi[:, 1:] * std[:, 1:], axis=1) / np.maximum(size, 1e-300)
    more, least = phi[:, 0] - before[:, 0], np.maximum(INTERVAL * std[:, 0], known["mass"] * before[:, 0])
    heavier = (std[:, 0] < 0.5 * std_before[:, 0]) & (grown > INTERVAL * std_size) & (more > least)
    last = _last_links(mechanism)
    for k in np.flatnonzero(heavier).tolist():
        if mechanism.tree.inertial[k] in last:
            yield Finding.of("heavier_last_link", body=mechanism.bodies[k], mass=float(more[k]), std=float(std[k, 0]))


def _last_links(mechanism: Mechanism) -> set[int]:
    """Indices of the last bodies of the chains, without those of negligible mass."""
    tree, masses = mechanism.tree, mechanism.known[::10]
    heavy = {i for i, mass in zip(tree.inertial, masses, strict=True) if mass > SLIGHT * masses.sum()}
    return heavy - {k for i in heavy for k in tree.chain(tree.bodies[i].parent)}
