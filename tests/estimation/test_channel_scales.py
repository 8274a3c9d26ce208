"""Scales of channels: a flat one has that of its kind, wherever channels are weighted by their signals."""

import numpy as np
import pytest
from recorded_faults import PENDULUM, TRUTH, angles_and_wrench, faulty, wrench_of
from slow_pendulum import recorded

import ident
from ident.estimation.noise import LEAST, least_noise
from ident.estimation.preparation import Part, prepared
from ident.regression.conventional import filtered_least_squares
from ident.trajectory.late_start import unexplained

NOTHING = np.zeros(len(TRUTH)), np.zeros((len(TRUTH), len(TRUTH)))


def flattened(part, *channels):
    """A recording some of whose channels are zero in a part."""
    recording = faulty(1)
    wrench = wrench_of(recording)
    for channel in channels:
        wrench[part, channel] = 0
    return angles_and_wrench(recording.time, recording.of_joints(PENDULUM.tree.joints, "position"), wrench)


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


T = np.arange(1000) / 100


def test_floors_are_those_of_spread_resolution_and_kind():
    rng = np.random.default_rng(0)
    flat, coarse, fine = np.full(1000, 3.0), 0.3 * np.round(np.sin(T) / 0.3), 30 * np.sin(T) + rng.normal(size=1000)
    every = np.stack([flat, fine, coarse, flat, fine], axis=1)
    every[::7, 2] = np.nan
    floor = least_noise([every[:600], every[600:]], ("Fx", "Fy", "Fz", "joint1", "joint2"))
    of_fine = LEAST * fine.std()
    np.testing.assert_allclose(floor, [of_fine, of_fine, 0.3 / np.sqrt(12), of_fine, of_fine], rtol=1e-6)


@pytest.mark.parametrize("seed", range(3))
def test_a_joint_at_rest_is_held_where_it_is(seed):
    """The angle of a joint at rest is one number, without noise."""
    estimate = ident.identify(PENDULUM, recorded(seed, speed=1.5, rests=0.7, noise=1))
    assert estimate.prepared.notes == ("'joint2' rests at 0.7.",)
    fit = estimate.trajectory.fit
    assert fit.status == "converged" and not estimate.trajectory.search.incredible
    for c in fit.coefficients:
        np.testing.assert_allclose(c[:, 1], 0.7, atol=1e-3)
    assert (abs(estimate.psi - TRUTH) < 3 * estimate.std_setup).all()
    assert (estimate.held_out.ratio[1:] < 1.05 * estimate.rivals["model"][1:] + 0.01).all()
