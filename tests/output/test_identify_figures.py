"""Figures of an identification show what their labels say."""

from dataclasses import replace

import numpy as np
import pytest
from recorded_faults import PENDULUM, faulty, shortened

import ident
from experiments.output.identify_report import held_out_figure, parameters_figure


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
    slow = replace(estimate)
    vars(slow)["near_reversals"] = np.zeros(estimate.held_out.residual.shape, bool)
    vars(slow)["near_reversals"][:40, 3] = True
    figure = held_out_figure(slow)
    assert labels(figure) == ["Measured", "Predicted", "Torques left open"]
    assert sum(len(axes.collections) for axes in figure.axes) == 1
