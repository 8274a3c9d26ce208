"""What became of the bodies of a model: whether they are physical, and how far from the model's."""

from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ident.geometry.inertia import body_of_parameter, with_bodies
from ident.judgement.finding import Finding, Place
from ident.parameters.consistency import ConsistentParameters

if TYPE_CHECKING:
    from ident.estimate import Estimate

FAR = 2.0
"""Distance of the physical bodies from the estimate, over √r as noise would make it, from which it is doubted."""

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
    """Bodies that end far from the model's mass, a doubt where the data cannot tell a mass from one so different."""
    full, mechanism = result.consistent(), result.prepared.mechanism
    told: dict[bool, dict[str, str]] = {True: {}, False: {}}
    masses = zip(mechanism.bodies, full.phi[::10], full.mass_std, mechanism.known[::10], strict=True)
    for name, mass, std, before in masses:
        if max(mass, before) > SLIGHT * full.phi[::10].sum() and not before / FACTOR <= mass <= before * FACTOR:
            was = f"{before:.3g} kg" if before else "none"
            text = f"{name} {mass:.3g} ± {std:.2g} kg (model: {was})"
            told[bool(2 * std < np.log(FACTOR) * mass)][name] = text
    for known, how in ((True, "which the data show"), (False, "though the data hardly see them")):
        if told[known]:
            text = f"Masses beyond a factor of {FACTOR:g} of the model's, {how}: {', '.join(told[known].values())}."
            yield Finding(text, not known, Place(bodies=tuple(told[known])))
