"""Bodies of a model in wrong units, whose size set-up deviations do not have."""

from dataclasses import replace

import driven_arm
import numpy as np

import ident
from ident.estimation.preparation import Part, prepared
from ident.trajectory.estimate import with_bodies_to_size

ARM = driven_arm.mechanism(**driven_arm.NONE)


def scaled(inertia, every=1.0):
    """The arm with factors on its inertias and on all of it."""
    return replace(ARM, prior=(every * ARM.known.reshape(-1, 10) * np.r_[np.ones(4), np.full(6, inertia)]).ravel())


def test_set_up_deviations_have_the_size_of_the_estimate_whatever_the_unit_of_the_model():
    log = driven_arm.log()
    right, wrong = (ident.identify(model, log, known=False) for model in (ARM, scaled(1e9)))
    factor = wrong.std_setup / right.std_setup
    assert factor.min() > 0.3 and factor.max() < 3


def test_bodies_of_about_the_right_size_stay_the_model_s():
    log = driven_arm.log()
    for factor in (0.6, 1.0, 1.6):
        ready = prepared(scaled(1.0, factor), log, filters=False)
        part = Part(ready, slice(0, len(ready.samples)))
        assert with_bodies_to_size(ready.equations, part) is ready.equations.mechanism
    ready = prepared(scaled(1.0, 50.0), log, filters=False)
    sized = with_bodies_to_size(ready.equations, Part(ready, slice(0, len(ready.samples))))
    np.testing.assert_allclose(sized.known, ARM.known, rtol=0.3)
