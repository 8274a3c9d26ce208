"""Findings on the bodies of the updated model: physical or not, and far from the model's or not."""

from collections.abc import Iterator, Sequence

import numpy as np

from ident.estimation.excitation import separable
from ident.geometry.inertia import body_of_parameter
from ident.judgement.evidence import Evidence
from ident.judgement.finding import Finding
from ident.judgement.place import Place
from ident.mechanism.mechanism import Mechanism
from ident.parameters.consistency import ConsistentParameters
from ident.parameters.prior import conditioned, known_deviations, updated
from ident.tolerances import DRIVE

FAR = 2.0
"""Distance of the physical bodies from the estimate, over √r, its size by noise alone, above which it is a doubt."""

INTERVAL = 1.96
"""Difference of masses, in standard deviations, that is significant with 95 % confidence."""

NARROWER = 0.5
"""Standard deviation of a mass over that of the prior below which the data determine it."""

TINIEST = 1e-300

FACTOR = 2.0
"""Factor between a body's mass and the model's above which there is a remark."""

SLIGHT = 1e-3
"""Bodies below this fraction of the whole mass are not worth a remark."""


def consistency_findings(evidence: Evidence) -> Iterator[Finding]:
    """Findings on the base parameters that are moved to make the bodies physical."""
    if evidence.consistent is not None:
        yield _consistency(evidence.consistent, evidence.mechanism.bodies)


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
    full, mechanism = evidence.consistent, evidence.mechanism
    if full is None:
        return
    far: dict[bool, dict[str, dict[str, float]]] = {False: {}, True: {}}
    masses = zip(mechanism.bodies, full.phi[::10], full.mass_std, mechanism.known[::10], full.unseen, strict=True)
    for name, mass, std, before, hardly in masses:
        if max(mass, before) > SLIGHT * full.phi[::10].sum() and not before / FACTOR <= mass <= before * FACTOR:
            far[bool(hardly)][name] = {"mass": float(mass), "std": float(std), "model": float(before)}
    for hardly, code in ((False, "masses_shown"), (True, "masses_hardly_shown")):
        if masses_of := far[hardly]:
            yield Finding.of(code, Place(bodies=tuple(masses_of)), masses=masses_of, factor=FACTOR)
    yield from rotor_findings(evidence, [*far[True], *far[False]])
    yield from tool_findings(evidence, full)


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
    apart = separable(with_rotors, evidence.logs[0].samples).drives if without else ()
    for code, is_apart in (("rotor_not_fitted", True), ("rotor_inseparable", False)):
        if of := {name: str(joints[name]) for name in without if (columns[name] in apart) == is_apart}:
            yield Finding.of(code, Place(bodies=tuple(of), joints=tuple(of.values())), joints=of)


def tool_findings(evidence: Evidence, full: ConsistentParameters) -> Iterator[Finding]:
    """Remarks on last links that are significantly heavier than the model, by the data rather than by the prior."""
    mechanism, known = evidence.mechanism, evidence.known["mass"]
    last = _last_links(mechanism)
    heavier = _heavier(evidence)
    masses = zip(mechanism.bodies, full.phi[::10], full.mass_std, mechanism.known[::10], strict=True)
    for name, mass, std, before in masses:
        more = mass - before
        if name in last and name in heavier and more > max(INTERVAL * std, known * before):
            place = Place(bodies=(name,))
            yield Finding.of("heavier_last_link", place, body=name, mass=float(more), std=float(std))


def _heavier(evidence: Evidence) -> set[str]:
    """Names of the bodies whose mass the data determine and whose first moment is significantly above the model's.

    Torques determine combinations, not masses: physical bodies with these combinations may be heavier only because
    heavier ones are likelier.
    """
    mechanism, base, known = evidence.mechanism, evidence.fit.parameters, evidence.known
    psi, covariance = evidence.fit.psi - evidence.fit.equations.from_drives[: base.rank], evidence.covariance
    if evidence.trajectory is None or not evidence.trajectory.known:
        psi, covariance = updated(mechanism, base, psi, covariance, known)
    after = conditioned(mechanism, base, psi, covariance, known)
    phi, std, before, std_before = (
        x.reshape(-1, 10)[:, :4] for x in (*after, mechanism.known, known_deviations(mechanism, known))
    )
    size = np.linalg.norm(phi[:, 1:], axis=1)
    grown = size - np.linalg.norm(before[:, 1:], axis=1)
    std_size = np.linalg.norm(phi[:, 1:] * std[:, 1:], axis=1) / np.maximum(size, TINIEST)
    heavier = (std[:, 0] < NARROWER * std_before[:, 0]) & (grown > INTERVAL * std_size)
    return {name for name, each in zip(mechanism.bodies, heavier, strict=True) if each}


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
