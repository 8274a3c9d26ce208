"""Bodies of a model in wrong units, whose size set-up deviations do not have."""

from dataclasses import replace

import driven_arm
import numpy as np

import ident

ARM = driven_arm.mechanism(**driven_arm.NONE)


def scaled(inertia, every=1.0):
    """The arm with factors on its inertias and on all of it."""
    return replace(ARM, prior=(every * ARM.known.reshape(-1, 10) * np.r_[np.ones(4), np.full(6, inertia)]).ravel())


def test_set_up_deviations_have_the_size_of_the_estimate_whatever_the_unit_of_the_model():
    log = driven_arm.log()
    right, wrong = (ident.identify(model, log, known=False) for model in (ARM, scaled(1e9)))
    factor = wrong.std_setup / right.std_setup
    assert factor.min() > 0.3 and factor.max() < 3
