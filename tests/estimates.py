"""Small estimates that tests of results share."""

from functools import cache

import driven_arm

import ident
from ident.setup import PRIORS


@cache
def quick():
    """Least squares of the arm with friction, from its torques."""
    return ident.identify(driven_arm.mechanism(), driven_arm.log(6.0, 50.0), estimator="weighted", cutoff=8.0)


@cache
def jointly():
    """Trajectory estimate of the same, with the set-up as stated."""
    exact = dict.fromkeys(PRIORS, 0.0) | {"gain": 0.01}
    return ident.identify(driven_arm.mechanism(), driven_arm.log(4.0, 50.0), setup=exact, known=True)
