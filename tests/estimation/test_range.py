"""Measured numbers at the ends of what can be computed: no tracebacks, and one sentence."""

from dataclasses import replace

import driven_arm
import numpy as np
import pytest
from recorded_faults import PENDULUM, faulty, shortened

import ident

RECORDINGS = {
    "wrench": (PENDULUM, shortened(faulty(0), 120), ("_force", "ground_torque")),
    "torques": (driven_arm.mechanism(), driven_arm.log(4.0, 50.0), ("_torque",)),
}


def scaled(recording, ends, factor):
    """The recording with some of its channels times a factor."""
    measured = {name: x * factor if name.endswith(ends) else x for name, x in recording.measured.items()}
    return replace(recording, measured=measured, true={}, noise={}, streams={})


@pytest.mark.parametrize("estimator", ["weighted", "trajectory"])
@pytest.mark.parametrize("of", RECORDINGS)
def test_numbers_that_no_sensor_reads_are_one_sentence(of, estimator):
    arm, recording, ends = RECORDINGS[of]
    options = {"estimator": estimator} | ({"cutoff": 8.0} if estimator == "weighted" else {})
    for factor in (1e-310, 1e-200, 1e-154, 1e-153, 1e-120):
        with pytest.raises(ident.InputError, match=r"The recording is constant in every channel"):
            ident.identify(arm, scaled(recording, ends, factor), **options)
    for factor in (1e9, 1e30, 1e151, 1e154, 1e155, 1e300):
        with pytest.raises(ident.InputError, match=r"^channel '\w+' needs numbers below 1e\+08, sample \d+ has "):
            ident.identify(arm, scaled(recording, ends, factor), **options)
    with pytest.raises(ident.InputError, match=r"_position' needs numbers below 1e\+08"):
        ident.identify(arm, scaled(recording, ("_position",), 1e200), **options)


def test_streams_are_in_range_too():
    arm, recording, _ = RECORDINGS["torques"]
    streams = {name: (recording.time, x) for name, x in recording.measured.items()}
    late = (recording.time, np.where(np.arange(len(recording.time)) == 7, 1e160, recording["bend_torque"]))
    with pytest.raises(ident.InputError, match=r"'bend_torque' needs numbers below 1e\+08, sample 7 has 1e\+160"):
        ident.identify(arm, ident.Recording.from_streams(streams | {"bend_torque": late}))
    tiny = (recording.time, 1e-200 * recording["bend_torque"])
    estimate = ident.identify(arm, ident.Recording.from_streams(streams | {"bend_torque": tiny}), known=True)
    assert "bend" not in estimate.channels and np.isfinite(estimate.std).all()
