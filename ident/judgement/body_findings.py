"""Findings on the bodies of the updated model: physical or not, and far from the model's or not."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ident.estimation.separation import separable
from ident.geometry.inertia import body_of_parameter
from ident.judgement.evidence import Evidence
from ident.judgement.finding import FINDINGS, Finding, Place, Row, bracketed, judged, listed, remark
from ident.mechanism.mechanism import Mechanism
from ident.model.axes import column_place
from ident.parameters.consistency import ConsistentParameters
from ident.parameters.prior import conditioned, known_deviations
from ident.tolerances import DRIVE, INTERVAL

FAR = 2.0
"""Distance of the physical bodies from the estimate, over √r, its size by noise alone, above which it is a doubt."""

NARROWER = 0.5
"""Standard deviation of a mass over that of the prior below which the data determine it."""

FACTOR = 2.0
"""Factor between a body's mass and the model's above which there is a remark."""

SLIGHT = 1e-3
"""Bodies below this fraction of the whole mass are not worth a remark."""


def consistency_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on the base parameters that are moved to make the bodies physical."""
    full = evidence.consistent()
    yield _consistency(full, evidence.mechanism.bodies)
    if full.rotors:
        joints = tuple(column_place(name)[1] for name in full.rotors)
        yield Finding.of("rotors_apart", Place(joints=joints), rotors=dict(full.rotors))


def _consistency(full: ConsistentParameters, bodies: Sequence[str]) -> Finding:
    if not full.divergence.any():
        return Finding.of("model_not_contradicted")
    moved = [(name, body_of_parameter(name, bodies), z) for name, z in full.moved(0.1)[:5]]
    place = Place(bodies=tuple(dict.fromkeys(body for _, body, _ in moved if body)))
    values = [{"name": name, "body": body, "z": z} for name, body, z in moved]
    if full.attainable:
        return Finding.of("physical_within_region", place, moved=values)
    far = full.distance > FAR * float(np.sqrt(len(full.psi)))
    return Finding.of("no_physical_bodies", place, doubt=far, moved=values)


def mass_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remarks on bodies far from the model's mass, on rotor inertia that explains it, and on heavier last links."""
    full, mechanism = evidence.consistent(), evidence.mechanism
    far: dict[str, dict[str, dict[str, float | None]]] = {}
    whole = full.phi[::10].sum()
    for each, before in zip(full.rows[::10], mechanism.known[::10].tolist(), strict=True):
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
    yield from rotor_findings(evidence, [name for masses in far.values() for name in masses])
    yield from tool_findings(evidence)


def rotor_findings(evidence: Evidence, far: Sequence[str]) -> Iterator[Finding]:
    """Remarks on bodies far from the model's mass whose joint's rotor inertia was not fitted or is inseparable.

    Args:
        evidence: The evidence.
        far: Names of the bodies.
    """
    mechanism, equations = evidence.mechanism, evidence.fit.equations
    torques = {mechanism.tree.freedoms[k] for k in equations.torques if equations.axes.driven[k]}
    joints = {body.name: body.joint for body in mechanism.tree.bodies}
    without = [
        name
        for name in far
        if (joint := joints.get(name)) in torques and f"{DRIVE['rotor']}({joint})" not in equations.drives
    ]
    columns = {name: f"{DRIVE['rotor']}({joints[name]})" for name in without}
    with_rotors = equations.with_drives((*equations.drives, *columns.values()))
    apart = separable(with_rotors, evidence.prepared.samples).drives if without else ()
    for code, is_apart in (("rotor_not_fitted", True), ("rotor_inseparable", False)):
        if of := {name: str(joints[name]) for name in without if (columns[name] in apart) == is_apart}:
            yield Finding.of(code, Place(bodies=tuple(of), joints=tuple(of.values())), joints=of)


def tool_findings(evidence: Evidence) -> Iterator[Finding]:
    """Remarks on last links that are heavier than the model if the other bodies are as well known as usually.

    Data and that prior have to determine the mass; its interval and that of the first moment exclude the model's.
    """
    mechanism, base, known = evidence.mechanism, evidence.fit.parameters, evidence.known
    included = evidence.trajectory is not None and evidence.trajectory.known
    after = conditioned(mechanism, base, evidence.psi_of_links, evidence.covariance, known, included=included)
    each = (*after, mechanism.known, known_deviations(mechanism, known))
    phi, std, before, std_before = (x.reshape(-1, 10)[:, :4] for x in each)
    size = np.linalg.norm(phi[:, 1:], axis=1)
    grown = size - np.linalg.norm(before[:, 1:], axis=1)
    std_size = np.linalg.norm(phi[:, 1:] * std[:, 1:], axis=1) / np.maximum(size, 1e-300)
    more, least = phi[:, 0] - before[:, 0], np.maximum(INTERVAL * std[:, 0], known["mass"] * before[:, 0])
    heavier = (std[:, 0] < NARROWER * std_before[:, 0]) & (grown > INTERVAL * std_size) & (more > least)
    for k in np.flatnonzero(heavier).tolist():
        if (name := mechanism.bodies[k]) in _last_links(mechanism):
            yield Finding.of("heavier_last_link", body=name, mass=float(more[k]), std=float(std[k, 0]))


def _last_links(mechanism: Mechanism) -> list[str]:
    """Names of the last bodies of the chains, without those of negligible mass."""
    bodies, masses = mechanism.tree.bodies, mechanism.known[::10].tolist()
    least = SLIGHT * sum(masses)
    heavy = {i for i, mass in zip(mechanism.tree.inertial, masses, strict=True) if mass > least}
    carrying = set[int]()
    for i in heavy:
        parent = bodies[i].parent
        while parent >= 0:
            carrying.add(parent)
            parent = bodies[parent].parent
    return [bodies[i].name for i in sorted(heavy - carrying)]


def _moved(beginning: str) -> Callable[..., str]:
    def sentence(moved: Sequence[Mapping[str, Any]]) -> str:
        shifts = {f"{x['name']}{' of ' * bool(x['body'])}{x['body'] or ''}": x["z"] for x in moved}
        each = bracketed(shifts, "parameters", "+.1f")
        end = f"In standard deviations, the updated model moves {each}." if moved else "It moves none of them."
        return f"{beginning} {end}"

    return sentence


def _masses(beginning: str, end: str = "") -> Row:
    def sentence(masses: Mapping[str, Mapping[str, float]], factor: float) -> str:
        each = listed((f"{body} {_mass(**x)}" for body, x in masses.items()), "bodies")
        return f"{beginning.format(factor=factor)}: {each}.{end}"

    return remark(sentence, bodies="masses")


def _mass(mass: float, lower: float | None, upper: float | None, model: float) -> str:
    if lower is None:
        limits = "" if upper is None else f"less than {upper:.3g}; "
    else:
        limits = f"more than {lower:.3g}; " if upper is None else f"{lower:.3g} to {upper:.3g}; "
    return f"{mass:.3g} kg ({limits}model: {model:.3g} kg)"


def _rotor(what: str) -> Row:
    def sentence(joints: Mapping[str, str]) -> str:
        each = listed((f"{body} (joint {joint})" for body, joint in joints.items()), "bodies")
        return f"Rotor inertia may explain the masses of {each}. {what}"

    return remark(sentence)


FINDINGS.update(
    model_not_contradicted=remark("The estimate does not contradict the model, whose bodies stay as they are."),
    physical_within_region=remark(_moved("The updated model has the base parameters within their joint 95 % region.")),
    no_physical_bodies=judged(_moved("No physical bodies near the model's have these base parameters.")),
    rotors_apart=remark(
        "No links can take up all inertia about the joints; the rest is kept apart as rotor inertia, kg m²: "
        "{rotors:rotors .3g}."
    ),
    masses_shown=_masses("Masses beyond a factor of {factor:g} of the model's, which is outside their 95 % intervals"),
    masses_limited=_masses(
        "Masses that no channel contains, limited only by what other parameters of a physical body allow",
        " An unmeasured hand or contact that drives a joint has the same effect: leave such parts out.",
    ),
    masses_hardly_shown=_masses(
        "Masses beyond a factor of {factor:g} of the model's in the updated model, which the data do not determine"
    ),
    rotor_not_fitted=_rotor("The links take it up, as it was not fitted: add --drive rotor."),
    rotor_inseparable=_rotor("The links take it up: this motion does not separate it, even with --drive rotor."),
    heavier_last_link=remark(
        "The last link '{body}' carries {mass:.2g} ± {std:.1g} kg more than the model, if that is right on the other "
        "bodies: a tool? `multicontact payload` identifies it.",
        bodies="body",
    ),
)
