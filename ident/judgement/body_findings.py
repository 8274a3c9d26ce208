"""What became of the bodies of a model: whether they are physical, and how far from the model's."""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ident.estimation.separable import separable
from ident.geometry.inertia import body_of_parameter, with_bodies
from ident.judgement.finding import Finding, Place
from ident.mechanism.mechanism import Mechanism
from ident.parameters.consistency import ConsistentParameters
from ident.parameters.prior import KNOWN, conditioned, known_deviations, updated
from ident.tolerances import DRIVE

if TYPE_CHECKING:
    from ident.estimate import Estimate

FAR = 2.0
"""Distance of the physical bodies from the estimate, over √r as noise would make it, from which it is doubted."""

SEEN = 1.96
"""Standard deviations by which a mass has to differ to be another one, with 95 % confidence."""

NARROWER = 0.5
"""Standard deviation of a mass, over that before the data, below which they tell it."""

TINIEST = 1e-300

FACTOR = 2.0
"""By how much a body's mass may differ from the model's without a remark."""

SLIGHT = 1e-3
"""Bodies below this fraction of the whole mass are not worth a remark."""


def consistency_finding(full: ConsistentParameters, bodies: Sequence[str]) -> Finding:
    """What physical consistency has cost, with the names of the bodies."""
    if not full.divergence.any():
        return Finding("The estimate does not contradict the model, whose bodies stay as they are.", False)
    moved = full.moved(0.1)[:5]
    listed = ", ".join(f"{with_bodies([name], bodies)} by {shift:+.1f}" for name, shift in moved)
    owners = (body_of_parameter(name, bodies) for name, _ in moved)
    place = Place(bodies=tuple(dict.fromkeys(filter(None, owners))))
    moves = f"it moves {listed} standard deviations" if listed else "it moves none of them"
    if full.attainable:
        text = f"The updated model has the base parameters within their joint 95 % region: {moves}."
        return Finding(text, False, place)
    return Finding(
        f"No physical bodies near the model's have these base parameters; of the updated model's, {moves}.",
        full.distance > FAR * float(np.sqrt(len(full.psi))),
        place,
    )


def mass_findings(result: "Estimate") -> Iterator[Finding]:
    """Remarks on bodies that end far from the model's mass, seen or not, and on what a last link or a rotor adds."""
    full, mechanism = result.consistent(), result.prepared.mechanism
    listed: dict[bool, dict[str, str]] = {True: {}, False: {}}
    masses = zip(mechanism.bodies, full.phi[::10], full.mass_std, mechanism.known[::10], full.unseen, strict=True)
    for name, mass, std, before, unseen in masses:
        if max(mass, before) > SLIGHT * full.phi[::10].sum() and not before / FACTOR <= mass <= before * FACTOR:
            was = f"{before:.3g} kg" if before else "none"
            listed[bool(unseen)][name] = f"{name} {mass:.3g} ± {std:.2g} kg (model: {was})"
    for unseen, how in ((False, "which the data show"), (True, "though the data hardly see them")):
        if texts := listed[unseen]:
            text = f"Masses beyond a factor of {FACTOR:g} of the model's, {how}: {', '.join(texts.values())}."
            yield Finding(text, False, Place(bodies=tuple(texts)))
    yield from rotor_findings(result, [name for texts in listed.values() for name in texts])
    yield from tool_findings(result)


def rotor_findings(result: "Estimate", far: Sequence[str]) -> Iterator[Finding]:
    """Bodies far from the model's mass on joints whose rotor inertia was not fitted or cannot be told from the links'.

    Args:
        result: The estimate.
        far: Names of the bodies.
    """
    mechanism, equations = result.prepared.mechanism, result.fit.equations
    torques = {mechanism.tree.freedoms[k] for k in equations.torques}
    joints = {body.name: body.joint for body in mechanism.tree.bodies}
    without = [
        name
        for name in far
        if (joint := joints.get(name)) in torques and f"{DRIVE['rotor']}({joint})" not in equations.drives
    ]
    columns = {name: f"{DRIVE['rotor']}({joints[name]})" for name in without}
    with_rotors = replace(equations, drives=(*equations.drives, *columns.values()))
    apart = separable(with_rotors, result.prepared.samples).drives if without else ()
    kinds = (
        ("was not fitted beside the inertias of the links, which take it up (--drive rotor)", True),
        ("cannot be told from the inertias of the links, which take it up, with or without --drive rotor", False),
    )
    for what, is_apart in kinds:
        if bodies := [name for name in without if (columns[name] in apart) == is_apart]:
            named = ", ".join(f"{name} (joint {joints[name]})" for name in bodies)
            yield Finding(
                f"Rotor inertia may explain the masses of {named}: it turns with the joint and {what}.",
                False,
                Place(bodies=tuple(bodies), joints=tuple(str(joints[name]) for name in bodies)),
            )


def tool_findings(result: "Estimate") -> Iterator[Finding]:
    """Last links that are significantly heavier than the model, where the data themselves tell that they are."""
    full, mechanism = result.consistent(), result.prepared.mechanism
    known = {**KNOWN, **result.prepared.recording.known}["mass"]
    last = _last_links(mechanism)
    heavier = _heavier(result)
    masses = zip(mechanism.bodies, full.phi[::10], full.mass_std, mechanism.known[::10], strict=True)
    for name, mass, std, before in masses:
        more = mass - before
        if name in last and name in heavier and more > max(SEEN * std, known * before):
            yield Finding(
                f"The last link '{name}' carries {more:.2g} ± {std:.1g} kg more than the model: a tool? "
                "(experiments.payload)",
                False,
                Place(bodies=(name,)),
            )


def _heavier(result: "Estimate") -> set[str]:
    """Names of the bodies whose mass the data tell and whose first moments they show to be larger than the model's.

    Torques tell no mass, but combinations: the physical bodies that have them may be heavier for no other reason than
    that these are likelier.
    """
    mechanism, base, psi, covariance = result.prepared.mechanism, result.base, result.psi, result.covariance
    known = {**KNOWN, **result.prepared.recording.known}
    if result.trajectory is None or not result.trajectory.known:
        psi, covariance = updated(mechanism, base, psi, covariance, known)
    after = conditioned(mechanism, base, psi, covariance, known)
    phi, std, before, std_before = (
        x.reshape(-1, 10)[:, :4] for x in (*after, mechanism.known, known_deviations(mechanism, known))
    )
    size = np.linalg.norm(phi[:, 1:], axis=1)
    grown = size - np.linalg.norm(before[:, 1:], axis=1)
    std_size = np.linalg.norm(phi[:, 1:] * std[:, 1:], axis=1) / np.maximum(size, TINIEST)
    heavier = (std[:, 0] < NARROWER * std_before[:, 0]) & (grown > SEEN * std_size)
    return {name for name, each in zip(mechanism.bodies, heavier, strict=True) if each}


def _last_links(mechanism: Mechanism) -> list[str]:
    """Names of the bodies worth a remark that carry no other such body."""
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
