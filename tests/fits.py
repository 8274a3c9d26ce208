"""Fits of the total wrench's six components, for the tests."""

from mechanisms import GRAVITY

from ident import Equations, Mechanism, Motion, Samples, least_squares


def sampled(q, dq, ddq, measured, base=None, covariance=None):
    return Samples(Motion(q, dq, ddq, base), measured, covariance)


def equations(tree, parameters=None, gravity=GRAVITY, moving=False):
    return Equations.of_wrench(Mechanism(tree, gravity), parameters, moving=moving)


def fitted(tree, source, *, gravity=GRAVITY, parameters=None, **options):
    moving = isinstance(source, Samples) and source.motion.base is not None
    return least_squares(equations(tree, parameters, gravity, moving), source, **options)
