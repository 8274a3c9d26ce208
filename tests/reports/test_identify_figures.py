"""Figures of an identification show what their labels say."""

from dataclasses import replace

import numpy as np
import pytest
from recorded_faults import PENDULUM, faulty, shortened

import ident
from experiments.reports.identify_page import held_out_caption, held_out_figure, parameters_figure


@pytest.fixture(scope="module")
def estimate():
    return ident.identify(PENDULUM, shortened(faulty(1), 300))


def labels(figure):
    return [text.get_text() for text in figure.legends[0].get_texts()]


def test_intervals_of_the_figure_are_those_that_the_verdict_goes_by(estimate):
    figure = parameters_figure(estimate)
    (axes,) = figure.axes
    (bars,) = axes.collections
    half = [np.ptp(segment[:, 0]) / 2 for segment in bars.get_segments()]
    prior = estimate.base.regroup(PENDULUM.known)
    size = np.max([abs(estimate.psi), abs(prior), 1.96 * estimate.std_setup], axis=0)
    np.testing.assert_allclose(half, 1.96 * estimate.std_setup / size, rtol=1e-3)
    assert axes.get_xlabel() == "Value over the largest of estimate, model and half-width"
    assert labels(figure) == ["Model", "Estimate, 95 % with set-up"]


def test_grey_spans_have_an_entry_in_the_legend_where_there_are_any(estimate):
    assert labels(held_out_figure(estimate)) == ["Measured", "Predicted"]
    resting = np.zeros(estimate.held_out.residual.shape, bool)
    resting[:40, 3] = True
    slow = replace(estimate, held_out=replace(estimate.held_out, resting=resting))
    figure = held_out_figure(slow)
    assert labels(figure) == ["Measured", "Predicted", "Low velocity, not judged"]
    assert "not judged" in held_out_caption(slow) and "not judged" not in held_out_caption(estimate)
    assert sum(len(axes.collections) for axes in figure.axes) == 1


def test_spans_can_be_seen_and_are_one_where_they_nearly_touch(estimate):
    time, mask = estimate.held_out.time, np.zeros(estimate.held_out.residual.shape, bool)
    # One sample alone, and three that are closer together than a line's width.
    mask[[20, 60, 62, 64], 0] = True
    first = held_out_figure(replace(estimate, held_out=replace(estimate.held_out, resting=mask))).axes[0]
    edges = np.array([path.get_extents().intervalx for path in first.collections[0].get_paths()])
    assert len(edges) == 2 and (np.diff(edges) >= 0.999 * 0.012 * np.ptp(time)).all()
    np.testing.assert_allclose(edges.mean(axis=1), time[[20, 62]], atol=1e-9)
    # Lines of the grid would look like spans.
    assert not any(line.get_visible() for line in first.get_xgridlines())


def test_coefficients_beside_base_parameters_are_offsets_of_channels(estimate):
    parameters, rank = estimate.parameters, estimate.base.rank
    assert len(estimate.offsets) == len(parameters) - rank > 0
    assert {each.kind for each in parameters[:rank]} == {"base"} and parameters[0].unit.startswith("kg")
    assert [(each.kind, each.body) for each in parameters[rank:]] == [("offset", each) for each in estimate.offsets]
