"""Figures of an identification show what their labels say."""

from dataclasses import replace

import numpy as np
import pytest
from recorded_faults import PENDULUM, faulty, shortened

import ident
from experiments.document import figures, symbols
from experiments.document.sheet import WIDTHS
from experiments.reports.identify_figures import held_out_figure, parameters_figure, spectra_figure
from experiments.reports.identify_page import held_out_caption
from ident.display import plots


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


@pytest.mark.parametrize("draw", [held_out_figure, spectra_figure])
def test_labels_of_ordinates_are_above_their_panels_and_clear_of_each_other(estimate, draw):
    figure = draw(estimate)
    figures.drawn(figure, "png")
    titles = [ax._left_title for ax in figure.axes]
    assert [title.get_text() for title in titles] == [ax.get_ylabel() for ax in figure.axes]
    boxes = [title.get_window_extent() for title in titles]
    for ax, box in zip(figure.axes, boxes, strict=True):
        view = ax.get_window_extent()
        assert box.y0 >= view.y1 and abs(box.x0 - view.x0) < 3
        assert not any(box.overlaps(other) for other in boxes if other is not box)
        assert not any(box.overlaps(other.get_window_extent()) for other in figure.axes)


def test_spans_can_be_seen_and_are_one_where_they_nearly_touch(estimate):
    time = estimate.held_out.time
    mask = np.zeros(estimate.held_out.residual.shape, bool)
    # One sample alone, and three that are closer together than a line's width.
    mask[[20, 60, 62, 64], 0] = True
    slow = replace(estimate, held_out=replace(estimate.held_out, resting=mask))
    first = held_out_figure(slow).axes[0]
    (bars,) = first.collections
    edges = np.array([path.get_extents().intervalx for path in bars.get_paths()])
    least = plots.VISIBLE * np.ptp(time)
    assert len(edges) == 2 and (np.diff(edges) >= 0.999 * least).all()
    np.testing.assert_allclose(edges.mean(axis=1), time[[20, 62]], atol=1e-9)
    # Lines of the grid would look like spans.
    assert not any(line.get_visible() for line in first.get_xgridlines())


def test_many_parameters_stand_in_panels_over_the_page(estimate, monkeypatch):
    monkeypatch.setattr(plots, "COLUMN_ROWS", 5)
    figure = parameters_figure(estimate)
    assert figure.get_figwidth() == WIDTHS[2][1] and len(figure.axes) == 3
    labels = [text.get_text() for ax in figure.axes for text in ax.get_yticklabels()]
    named = [symbols.named_symbol(name, PENDULUM.bodies) for name in estimate.base.names]
    assert labels == named
    heights = {tuple(np.ptp(ax.get_ylim(), keepdims=True).round(9)) for ax in figure.axes}
    assert len(heights) == 1 and figure.axes[1].get_ylim()[1] < figure.axes[1].get_yticks()[0]
