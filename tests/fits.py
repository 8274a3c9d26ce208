"""Fits of the total wrench's six components, for the tests."""

from mechanisms import GRAVITY

from ident.estimation.equations import Equations
from ident.estimation.samples import Samples
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.regression.ordinary import least_squares


def sampled(q, dq, ddq, measured, base=None, covariance=None):
    return Samples(Motion(q, dq, ddq, base), measured, covariance)


def equations(tree, parameters=None, gravity=GRAVITY, moving=False):
    return Equations.of_wrench(Mechanism(tree, gravity), parameters, moving=moving)


def fitted(tree, source, *, gravity=GRAVITY, parameters=None, **options):
    moving = isinstance(source, Samples) and source.motion.base is not None
    return least_squares(equations(tree, parameters, gravity, moving), source, **options)
