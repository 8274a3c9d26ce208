"""Scales of channels: a flat one has that of its kind, wherever channels are weighted by their signals."""

import numpy as np
from recorded_faults import PENDULUM, TRUTH, angles_and_wrench, faulty, wrench_of

from ident.estimation.channel_scales import channel_scales
from ident.estimation.equations import COMPONENTS
from ident.estimation.preparation import Part, prepared
from ident.regression.filtered import filtered_least_squares
from ident.trajectory.late_start import unexplained

NOTHING = np.zeros(len(TRUTH)), np.zeros((len(TRUTH), len(TRUTH)))


def flattened(part, *channels):
    """A recording some of whose channels are zero in a part."""
    recording = faulty(1)
    wrench = wrench_of(recording)
    for channel in channels:
        wrench[part, channel] = 0
    return angles_and_wrench(recording.time, recording.of_joints(PENDULUM.tree.joints, "position"), wrench)


def test_a_flat_channel_has_the_scale_of_its_kind():
    rng = np.random.default_rng(0)
    every = rng.normal(size=(1000, 8)) * [0, 30, 2, 0, 0, 0, 5, 0] + [7, 0, 0, 9, 0, 0, 0, 1]
    every[:, 5] = np.nan
    every[::7, 1] = np.nan
    spread = np.nanstd(every[:, :3], axis=0)
    largest = spread[1]  # of all channels, for moments, none of which changes
    expected = [largest, largest, spread[2], largest, largest, largest, *every[:, [6, 6]].std(axis=0)]
    names = (*COMPONENTS, "hip", "unplugged")
    np.testing.assert_allclose(channel_scales([every[:300], every[300:]], names), expected)
    np.testing.assert_array_equal(channel_scales([np.full((9, 8), 3.0)], names), 1)


def test_a_channel_that_is_flat_in_one_half_does_not_choose_the_cut_off():
    """With Fx flat in the first half 5.9 Hz were chosen for 3.0 Hz, with twice the residuals."""
    logs = [prepared(PENDULUM, flattened(slice(0, 400), *channels)) for channels in ((), (0,))]
    equations = logs[0].equations.with_offsets(logs[0].equations.sensed)
    every = [
        filtered_least_squares([Part(log, slice(0, 560))], [Part(log, slice(560, 913))], equations, NOTHING)
        for log in logs
    ]
    assert every[1].cutoffs == every[0].cutoffs
    np.testing.assert_allclose(every[1].values[0][1:13], every[0].values[0][1:13], rtol=0.2, atol=0.05)


def test_a_channel_that_angles_explain_exactly_leaves_weight_to_the_others():
    """Weighted by its rounding errors alone it would hide how the other one separates the columns."""
    rng = np.random.default_rng(0)
    a, b, rounding = rng.normal(size=(3, 200)) * [[1], [1], [1e-14]]
    columns = np.stack([np.stack([a, b], axis=1), np.stack([a, a], axis=1)], axis=1)
    residual = np.stack([a - b, rounding], axis=1)
    assert unexplained(residual, columns, ("shoulder", "elbow")) < np.log(1e-13)
