"""Figures of an identification show what their labels say."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import to_hex
from recorded_faults import PENDULUM, faulty, shortened

import ident
from experiments.document import figures, sheet, styles, symbols
from experiments.document.sheet import HEIGHTS, INKS, WIDTHS
from experiments.reports import identify_page
from experiments.reports.identify_figures import held_out_figure, parameters_figure, spectra_figure
from experiments.reports.identify_page import held_out_caption, parameters_caption, replay
from ident.estimation.preparation import LeftOut


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
def test_labels_of_ordinates_are_beside_their_ticks(estimate, draw):
    figure = draw(estimate)
    figures.drawn(figure, "png")
    for ax in figure.axes:
        label, view = ax.yaxis.label.get_window_extent(), ax.get_window_extent()
        ticks = [text.get_window_extent() for text in ax.get_yticklabels() if text.get_text()]
        visible = [box for box in ticks if view.y0 <= (box.y0 + box.y1) / 2 <= view.y1]
        assert visible and label.x1 <= min(box.x0 for box in visible)


def test_the_caption_says_how_dense_knots_are_where_there_are_any(estimate):
    sentence = f"a knot every {1e3 * min(estimate.trajectory.steps):.3g} ms"
    assert sentence in held_out_caption(estimate)
    assert "knot" not in held_out_caption(replace(estimate, trajectory=None))


def test_spans_can_be_seen_and_are_one_where_they_nearly_touch(estimate):
    time = estimate.held_out.time
    mask = np.zeros(estimate.held_out.residual.shape, bool)
    # One sample alone, and three that are closer together than a line's width.
    mask[[20, 60, 62, 64], 0] = True
    slow = replace(estimate, held_out=replace(estimate.held_out, resting=mask))
    first = held_out_figure(slow).axes[0]
    (bars,) = first.collections
    edges = np.array([path.get_extents().intervalx for path in bars.get_paths()])
    least = figures.VISIBLE * np.ptp(time)
    assert len(edges) == 2 and (np.diff(edges) >= 0.999 * least).all()
    np.testing.assert_allclose(edges.mean(axis=1), time[[20, 62]], atol=1e-9)
    # Lines of the grid would look like spans.
    assert not any(line.get_visible() for line in first.get_xgridlines())


def test_the_page_and_the_figures_have_the_same_colours(estimate):
    shown = replay(estimate).to_page()
    inks = dict(zip(shown["curves"], (INKS[k] for k in shown["inks"]), strict=True))
    drawn = {line.get_label().lower(): line.get_color() for line in held_out_figure(estimate).axes[0].lines}
    assert drawn == {name: inks[name] for name in ("measured", "predicted")}
    (bars,) = parameters_figure(estimate).axes[0].collections
    assert to_hex(bars.get_color()[0]) == to_hex(cycle_color(inks["predicted"]))


def cycle_color(name):
    with styles.paper_style():
        return to_hex(name)


def test_many_parameters_stand_in_panels_over_the_page(estimate, monkeypatch):
    monkeypatch.setattr(styles, "COLUMN_ROWS", 5)
    figure = parameters_figure(estimate)
    assert figure.get_figwidth() == WIDTHS[2][1] and len(figure.axes) == 3
    labels = [text.get_text() for ax in figure.axes for text in ax.get_yticklabels()]
    named = [symbols.named_symbol(name, PENDULUM.bodies) for name in estimate.base.names]
    assert labels == named
    heights = {tuple(np.ptp(ax.get_ylim(), keepdims=True).round(9)) for ax in figure.axes}
    assert len(heights) == 1 and figure.axes[1].get_ylim()[1] < figure.axes[1].get_yticks()[0]


@pytest.mark.parametrize("columns", [1, 2])
def test_no_figure_is_higher_than_a_page(estimate, monkeypatch, columns):
    assert "narrowest" not in parameters_caption(estimate)
    with sheet.page(columns):
        most = sheet.most_rows()
        figure, _ = styles.row_panels(["x"] * most, "")
        assert most > 60 and figure.get_figheight() <= HEIGHTS[columns]
        # If there are too many parameters, those with the narrowest intervals are shown, and the caption says so.
        monkeypatch.setattr(identify_page, "most_rows", lambda: 4)
        (axes,) = parameters_figure(estimate).axes
        size = np.maximum(abs(estimate.psi), abs(estimate.base.regroup(PENDULUM.known)))
        best = sorted(np.argsort(estimate.std_setup / size)[:4])
        labels = [text.get_text() for text in axes.get_yticklabels()]
        assert labels == [symbols.named_symbol(estimate.base.names[k], PENDULUM.bodies) for k in best]
        assert "Shown are the 4 of 13 with the narrowest relative intervals" in parameters_caption(estimate)


def test_the_page_predicts_nothing_where_samples_were_left_out(estimate):
    log = estimate.prepared
    start, end = log.recording.time[[50, 90]]
    less = replace(log, left_out=(LeftOut(start, end, 0.1),))
    less = replace(estimate, logs=(estimate.logs[0].of(less), *estimate.logs[1:]))
    for shown, left in ((replay(estimate), 0), (replay(less), 41)):
        inside = (log.recording.time >= start) & (log.recording.time <= end)
        for name, values in shown.curves.items():
            gone = np.isnan(values).all(axis=1)
            assert gone.sum() == (0 if name == "measured" else left) and not (gone & ~inside[shown.drawn]).any()
        assert ("left out" in shown.remark) == bool(left)
