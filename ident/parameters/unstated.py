"""Bodies whose mass a model does not state, and a guess of them."""

import numpy as np

from ident.geometry.inertia import parameters_from_com
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree

SMALLEST = 0.1
"""Size of a body that no model states, in a mechanism without lengths, m."""

COINCIDENT = 1e-6
"""Distance of joints that count as one compound joint, m."""


def unstated(mechanism: Mechanism) -> np.ndarray:
    """Mask of the bodies that joints move and whose mass no model states, alone or with what is welded to them (b,).

    Where other moving bodies have mass, a massless one at whose very joint the next one turns is a link of a compound
    joint, whose zero is meant; so is that of welded frames.
    """
    tree, masses = mechanism.tree, mechanism.known[::10]
    carriers, together = _carriers(tree), np.zeros(len(tree.bodies))
    np.add.at(together, [carriers[i] for i in tree.inertial], masses)
    moving = {i for i in tree.inertial if tree.bodies[i].moves}
    compound = {
        carriers[body.parent]
        for body in tree.bodies
        if body.moves and body.parent >= 0 and not np.any(abs(body.home[:3, 3]) > COINCIDENT)
    }
    if not any(together[i] for i in moving):
        compound = set()
    return np.array([i in moving and not together[i] and i not in compound for i in tree.inertial])


def _carriers(tree: Tree) -> list[int]:
    """Index of the moving body that each body is welded to, its own if it moves, or of the first on the base (b,)."""
    carriers = list[int]()
    for i, body in enumerate(tree.bodies):
        carriers.append(i if body.moves or body.parent < 0 else carriers[body.parent])
    return carriers


def guessed(mechanism: Mechanism) -> np.ndarray:
    """The model's φ, with balls between their joint and the next for bodies whose mass it does not state (10 b,)."""
    phi, tree = mechanism.known.reshape(-1, 10).copy(), mechanism.tree
    usual = float(np.mean(phi[phi[:, 0] > 0, 0])) if phi[:, 0].any() else 1.0
    lengths = [float(np.linalg.norm(body.home[:3, 3])) for body in tree.bodies]
    typical = max(float(np.mean([x for x in lengths if x > 0] or [0])), SMALLEST)
    for k in np.flatnonzero(unstated(mechanism)).tolist():
        on_it = [each.home[:3, 3] for each in tree.bodies if each.parent == tree.inertial[k]]
        center = max(on_it, key=np.linalg.norm, default=np.zeros(3)) / 2
        size = max(2 * float(np.linalg.norm(center)), typical)
        phi[k] = parameters_from_com(usual, center, usual * size**2 / 10 * np.eye(3))
    return phi.ravel()
