"""Jumps faster than the knots can follow do not count as a clock error, but a fast clock is found."""

from dataclasses import replace

import numpy as np
import pytest

import ident
from docs.tools.noise.conditions import CONDITIONS
from docs.tools.noise.estimators import Case

pytestmark = pytest.mark.slow

CASE = Case.drawn(CONDITIONS["trapezoids_100"], 0, 2)


def setup_of(recording):
    options = {"holdout": 0.0, **CASE.condition.options}
    return ident.identify(CASE.subject.mechanism, recording, **options).setup


def test_jumps_are_no_clock():
    """A clock error of 0.023 ± 0.002 %, a tenth of a sample, would predict unseen pieces better."""
    assert not setup_of(CASE.recording)


def test_a_fast_clock_is_found():
    # A rate error of this size needs no more than six seconds.
    short = replace(CONDITIONS["trapezoids_100"], samples=600)
    recording, fast = Case.drawn(short, 0, 2).recording, 0.003
    t, measured = recording.time, dict(recording.measured)
    for name in ("ground_force", "ground_torque"):
        measured[name] = np.stack([np.interp(t * (1 - fast), t, x) for x in measured[name].T], axis=1)
    (clock,) = setup_of(replace(recording, measured=measured))
    assert clock.name == "clock(ground)"
    assert abs(clock.value) == pytest.approx(fast, rel=0.1)
