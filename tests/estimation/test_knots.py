"""How far apart the knots of the trajectory are, by what fits with them leave."""

from types import SimpleNamespace

import numpy as np
import pytest

from ident.estimation.joint_estimate import _fine_enough


class Told:
    """What fits are told to leave: status, correlation and noise of one channel, by the distance of the knots."""

    def __init__(self, fits):
        self.fits = fits

    def fitted(self, step, share=1, begin=None):
        status, correlation, noise = self.fits[step]
        left = SimpleNamespace(channels_rho=np.array([correlation]), channels=np.array([noise]))
        return SimpleNamespace(step=step, fit=SimpleNamespace(status=status, noise=left))

    def searched(self, estimate):
        return estimate


SETTLES, STOPS = "converged", "stopped"


@pytest.mark.parametrize(
    "fits, kept",
    [
        ({0.16: (SETTLES, 0.1, 2.0)}, 0.16),
        ({0.16: (SETTLES, 0.5, 4.0), 0.08: (SETTLES, 0.1, 2.0)}, 0.08),
        ({0.16: (SETTLES, 0.5, 4.0), 0.08: (SETTLES, 0.2, 2.0), 0.04: (STOPS, 0.3, 1.0)}, 0.08),
        ({0.16: (SETTLES, 0.5, 4.0), 0.08: (SETTLES, 0.3, 4.0), 0.04: (SETTLES, 0.1, 2.0)}, 0.04),
        ({0.16: (SETTLES, 0.5, 4.0), 0.08: (SETTLES, 0.3, 2.0), 0.04: (SETTLES, 0.3, 1.99)}, 0.08),
        ({0.16: (SETTLES, 0.95, 4.0), 0.08: (SETTLES, 0.95, 3.0)}, 0.16),
        ({0.16: (STOPS, 0.5, 4.0), 0.08: (STOPS, 0.1, 2.0)}, 0.08),
    ],
    ids=["white", "jumps", "the last does not settle", "at last", "in vain", "a wrong model", "none settles"],
)
def test_knots_get_denser_as_long_as_that_helps_and_settles(fits, kept):
    assert _fine_enough(Told(fits), 1, 0.16, 0.04).step == kept
