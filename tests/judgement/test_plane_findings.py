"""A planar model and a person who sways: the finding that names channels to leave out, and its effect."""

from functools import cache

import numpy as np
import pytest
import sagittal_walker
from coded import coded

import ident


@cache
def estimate(leave_out=(), **options):
    return ident.identify(sagittal_walker.mechanism(), sagittal_walker.recording(**options), leave_out=leave_out)


def test_what_the_model_cannot_explain_is_named_with_the_option_that_leaves_it_out():
    (finding,) = coded(estimate(), "out_of_plane")
    assert not finding.doubt and finding.values == {"normal": "z", "channels": sagittal_walker.SIDEWAYS}
    assert finding.place.channels == sagittal_walker.SIDEWAYS and "--leave-out Fz Mx My" in finding.text
    assert set(estimate().verdict().predicted) == set(estimate().channels) - set(sagittal_walker.SIDEWAYS)


@pytest.mark.slow
def test_without_it_the_estimate_is_right_usable_and_the_same_however_she_sways():
    left_out = coded(estimate(), "out_of_plane")[0].values["channels"]
    without, upright = (estimate(left_out, sway=sway) for sway in (1.0, 0.0))
    assert without.channels == ("Fx", "Fy", "Mz") and not coded(without, "out_of_plane")
    assert without.verdict().usable and without.held_out.ratio.max() < 0.1
    z = (without.psi - without.base.regroup(sagittal_walker.mechanism().known)) / without.std
    assert len(z) == 16 and np.sqrt(np.mean(z**2)) < 1.5 and np.abs(z).max() < 4
    np.testing.assert_allclose(without.psi, upright.psi, rtol=1e-6)
    np.testing.assert_allclose(without.std, upright.std, rtol=1e-4)
    assert "Left out, as asked for: Fz, Mx, My." in without.prepared.notes


def test_signs_of_plates_are_still_held_against_the_model():
    """A plate with inverted signs is found by the remaining channels."""
    person, recording = sagittal_walker.mechanism(), sagittal_walker.recording(300)
    values = {name: -x if name in ("right_force", "right_torque") else x for name, x in recording.measured.items()}
    turned = ident.Recording(recording.time, values, sensors=recording.sensors, held=False)
    estimate = ident.identify(person, turned, leave_out=sagittal_walker.SIDEWAYS)
    (finding,) = coded(estimate, "wrench_sign_or_axes")
    assert finding.values["opposite"] and finding.values["frame"] == "as stated"
    assert finding.place.wrenches == ("right",) and not estimate.verdict().usable
