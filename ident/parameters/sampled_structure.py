"""Structure matrix of mechanisms with followers or loops, by sampling: rows of the regressor at well-spread states.

The regressor is analytic in the states. A dependency between its columns therefore holds at all states, or with
probability zero at as many random ones as there are columns.
"""

import numpy as np

from ident.geometry import se3
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import BaseMotion, Motion
from ident.mechanism.tree import Tree
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor
from ident.parameters.structure import Sensors

MORE = 20
"""Number of samples in addition to the number of columns."""


def sampled_structure(mechanism: Mechanism, sensors: Sensors | None = None) -> np.ndarray:
    """Rows of the sensors' regressor at random states, leaders within the spans of their followers, loops closed.

    Args:
        mechanism: The mechanism of b bodies.
        sensors: The measurements; by default the base wrench of a base at rest.

    Returns:
        A matrix (rows, 10 b) whose columns have the dependencies of the regressor for general motions.
    """
    sensors, rng = sensors or Sensors(), np.random.default_rng(0)
    motion = _motion(rng, mechanism.tree, 10 * len(mechanism.bodies) + MORE, sensors)
    tree, g = mechanism.tree, mechanism.gravity
    rows = []
    if sensors.base_wrench:
        Y = base_wrench_regressor(tree, *motion.states, gravity=g, base=motion.base)
        rows.append(Y if sensors.channels is None else np.asarray(sensors.channels) @ Y)
    if sensors.joint_torques:
        rows.append(joint_torque_regressor(tree, *motion.states, gravity=g, base=motion.base))
    return np.concatenate([Y.reshape(-1, Y.shape[-1]) for Y in rows])


def _motion(rng: np.random.Generator, tree: Tree, samples: int, sensors: Sensors) -> Motion:
    """A random state of joints and base for each sample."""
    moves = not sensors.still
    leads = [body.follows for body in tree.bodies if body.follows]
    q, in_loops = [np.zeros((samples, 0))], tree.closure.drawn(rng, samples) if tree.closure else {}
    for i in tree.moving:
        body = tree.bodies[i]
        if body.joint in in_loops:
            q.append(in_loops[body.joint])
            continue
        spans = [lead.span for lead in leads if lead.joint == body.joint]
        low, high = max((low for low, _ in spans), default=-np.pi), min((high for _, high in spans), default=np.pi)
        size = (samples, body.coordinates)
        q.append(rng.normal(size=size) if body.is_ball else rng.uniform(min(low, high), max(low, high), size))
    dq, ddq = moves * rng.uniform(-2, 2, size=(2, samples, len(tree.freedoms)))
    if not sensors.moving_base:
        return Motion(np.hstack(q), dq, ddq)
    T = se3.pose(se3.rotation(rng.normal(size=(samples, 4))), rng.uniform(-1, 1, size=(samples, 3)))
    return Motion(np.hstack(q), dq, ddq, BaseMotion(T, *(moves * rng.uniform(-2, 2, size=(2, samples, 6)))))
