"""Joint states and motions of a base from coordinates and their derivatives."""

import numpy as np

from ident.geometry.quaternion import turning
from ident.mechanism.motion import BaseMotion
from ident.mechanism.tree import Tree


def joint_states(tree: Tree, states: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joint coordinates, velocities and accelerations from coordinates and their derivatives (3, …, n_q)."""
    velocities, accelerations = [], []
    for body, *own in zip(tree.bodies, *(tree.body_coordinates(x) for x in states), strict=True):
        rates = turning(np.array(own)) if body.is_ball else own[1:]
        velocities.append(rates[0])
        accelerations.append(rates[1])
    return states[0], np.concatenate(velocities, axis=-1), np.concatenate(accelerations, axis=-1)


def base_motion(states: np.ndarray) -> BaseMotion:
    """Motion of a base from its position and quaternion and their derivatives (3, …, 7)."""
    w, dw = turning(states[..., 3:])
    velocity, acceleration = (np.concatenate([states[d, ..., :3], x], axis=-1) for d, x in ((1, w), (2, dw)))
    return BaseMotion.from_free_joint(states[0], velocity, acceleration)
