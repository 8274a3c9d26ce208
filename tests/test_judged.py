"""Samples that judge an estimate: no ends, no gaps, and the estimated set-up."""

import numpy as np
import pytest
import swinging
from recorded_faults import PENDULUM, TRUTH, faulty, shortened

import ident
from experiments.reports.identify_figures import held_out_figure
from ident.estimation.preparation import prepared
from ident.trajectory.angles_alone import LARGEST_END, UNSETTLED

pytestmark = pytest.mark.slow

GAP = 4.0, 7.4


@pytest.mark.parametrize("samples", [900, 400, 120])
def test_ends_of_a_recording_are_not_judged_however_short(samples):
    recording = shortened(faulty(), samples)
    held = ident.identify(PENDULUM, shortened(faulty(1), 500), held_out=recording).held_out
    edge = min(UNSETTLED, LARGEST_END * np.ptp(recording.time))
    inside = (recording.time > recording.time[0] + edge) & (recording.time < recording.time[-1] - edge)
    np.testing.assert_array_equal(held.time, recording.time[inside])


def test_nothing_in_a_gap_is_judged_or_fitted_by_least_squares():
    recording = ident.Recording.from_streams(swinging.streams(np.random.default_rng(2), gap=GAP))
    log = prepared(swinging.pendulum(), recording)
    taken = recording.time[log.taken(slice(None))]
    assert not ((taken > GAP[0] + 0.01) & (taken < GAP[1] - 0.01)).any() and len(taken) > 500
    filtered = prepared(swinging.pendulum(), recording, cutoff=6.0)
    apart = recording.time[filtered.taken(slice(None))]
    settles = filtered.edge / recording.rate - 0.02
    assert not ((apart > GAP[0] - settles) & (apart < GAP[1] + settles)).any()
    held = ident.identify(swinging.pendulum(), recording).held_out
    assert not ((held.time > GAP[0] - UNSETTLED + 0.01) & (held.time < GAP[1] + UNSETTLED - 0.01)).any()
    psi = ident.find_base_parameters(swinging.pendulum()).regroup(swinging.pendulum().known)
    noise = np.repeat([0.5, 0.05], 3)
    assert (np.sqrt((held.residual_with(psi) ** 2).mean(axis=0))[[0, 1, 2, 4, 5]] < 1.2 * noise[[0, 1, 2, 4, 5]]).all()


def test_recordings_that_are_judged_follow_one_another():
    logs = [shortened(faulty(seed), 400) for seed in range(2)]
    judges = [shortened(faulty(seed), 300) for seed in (5, 6)]
    estimate = ident.identify(PENDULUM, logs, held_out=judges)
    held = estimate.held_out
    assert (np.diff(held.time) > 0).all() and len(held.starts) == 2 and held.starts[0] == 0
    np.testing.assert_allclose(np.diff(held.time), np.median(np.diff(held.time)), rtol=1e-6)
    first = ident.identify(PENDULUM, logs, held_out=judges[:1]).held_out
    assert held.starts[1] == len(first.time)
    np.testing.assert_array_equal(held.time[: held.starts[1]], first.time)
    (line, _) = held_out_figure(estimate).axes[0].lines
    assert np.flatnonzero(np.isnan(line.get_xdata())).tolist() == [held.starts[1]]
    rms = np.sqrt((held.residual_with(TRUTH) ** 2).mean(axis=0))
    assert (rms[[0, 1, 2, 4, 5]] < 1.2 * np.array([0.5, 0.5, 0.5, 0.05, 0.05])).all()
