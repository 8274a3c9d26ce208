"""Files of figures and pictures of the first screen show the numbers that they are given."""

import csv
import io
import re
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.figure import Figure
from recorded_faults import PENDULUM, faulty, shortened

import ident
from experiments.document import figures, pictures
from experiments.reports.identify_page import SHEET, held_out_caption, held_out_figure, parameters_figure
from ident.display.plots import few_decades, spectra_figure


def drawing(extension, x, y):
    with figures.empty_figure(2) as figure:
        ax = figure.subplots()
        ax.loglog(x, y)
        few_decades(ax)
        return figures.drawn(figure, extension)


@pytest.mark.parametrize("extension", ["svg", "png"])
def test_what_a_user_has_of_matplotlib_leaves_the_papers_figures_as_they_are(extension):
    own = {"axes.facecolor": "black", "lines.linestyle": "--", "font.size": 30}
    expected = drawing(extension, [1, 2], [1, 9])
    with mpl.rc_context(own):
        assert drawing(extension, [1, 2], [1, 9]) == expected
        assert mpl.rcParams["font.size"] == own["font.size"]


def test_logarithmic_axes_have_ticks_without_numbers_between_decades():
    ax = Figure().subplots()
    ax.loglog([1e-7, 1e3], [0.03, 3])
    few_decades(ax)
    assert len(ax.get_yticks(minor=True)) > 10 and not any(label.get_text() for label in ax.get_yticklabels(minor=True))
    assert {"0.1", "1"} <= {label.get_text() for label in ax.get_yticklabels()}
    assert "$10^{-6}$" in {label.get_text() for label in ax.get_xticklabels()}


def test_a_place_without_a_panel_has_no_ticks():
    noise = np.random.default_rng(0).normal(size=(2, 100, 3))
    with figures.paper_style():
        figure = spectra_figure(SHEET, ["a", "b", "c"], 100.0, tuple(noise))
    figures.drawn(figure, "png")
    assert len(figure.axes) == 3 and figure.axes[0].get_xlim() == pytest.approx((1, 50))


def test_minor_ticks_are_drawn_as_matplotlib_draws_them(monkeypatch):
    def laid_out(layout, figure):
        layout.execute(figure)
        figure.set_layout_engine("none")

    marked = drawing("png", [0.03, 30], [2e-3, 5])
    monkeypatch.setattr(figures, "_solve", laid_out)
    assert drawing("png", [0.03, 30], [2e-3, 5]) == marked


DRAWN = {
    "line": (lambda ax: ax.plot([0, np.nan], [2, 3]), ["0.0 2.0 - - - -", "- 3.0 - - - -"]),
    "points": (lambda ax: ax.plot([1], [2], "o"), ["1.0 2.0 - - - -"]),
    "bar": (lambda ax: ax.barh([1], [4], left=-1), ["- 1.0 -1.0 3.0 - -"]),
    "interval": (lambda ax: ax.vlines([8], 0, 9), ["8.0 - - - 0.0 9.0"]),
    "span": (lambda ax: ax.axvspan(6, 7, label="_a"), ["- - 6.0 7.0 - -"]),
}


@pytest.mark.parametrize("mark", DRAWN)
def test_data_are_the_numbers_that_artists_draw(mark):
    (draw, expected), ax = DRAWN[mark], Figure().subplots()
    draw(ax)
    ax.set(xlabel=r"$m_{2}r_{z,2}$ (kg m)", yticks=[1, 2, 3], yticklabels=["=a", "b", "c"])
    rows = list(csv.DictReader(io.StringIO(figures.csv_text(ax.figure))))
    assert [" ".join(row.get(name) or "-" for name in figures.NUMBERS) for row in rows] == expected
    assert {(row["mark"], row["x_axis"]) for row in rows} == {(mark, "m2rz2 (kg m)")}
    words = {"1.0": "'=a", "2.0": "b", "3.0": "c"}
    assert [row.get("y_category", "") for row in rows] == [words.get(row["y"], "") for row in rows]
    for artist in (ax.fill_between([0, 1, 2], [0, 1, 0]), ax.imshow(np.eye(2))):
        with pytest.raises(TypeError, match=f"not of {type(artist).__name__}"):
            figures.csv_text(ax.figure)
        artist.remove()


def places(picture, shape, attribute):
    return [float(x) for x in re.findall(rf'<\w+ class="{shape}"[^>]*? {attribute}="([^"]*)"', picture)]


@pytest.mark.parametrize(("most", "ticks"), [(0.9, ["0.01", "0.1", "1"]), (2.0, ["0.01", "0.1", "1", "10"])])
def test_a_ring_is_around_the_best_candidate_of_each_channel(most, ticks):
    ratios = {"estimate": [0.1, 0.2], "least squares": [0.05, np.nan], "model": [most, 0.3]}
    drawn = pictures.candidates(["Fx", "Fy"], {name: np.array(each) for name, each in ratios.items()})
    dots, rings = (places(drawn, shape, "cx") for shape in ("mark0", "best"))
    decades = len(ticks) - 1
    at = [100 + 252 * np.log10(ratio / 0.01) / decades for ratio in (0.1, 0.2)]
    np.testing.assert_allclose(dots[1:], at, atol=0.06)
    np.testing.assert_allclose(rings, [100 + 252 * np.log10(5) / decades, at[1]], atol=0.06)
    assert "<title>Fx: estimate 0.1, least squares 0.05," in drawn and all(f">{tick}<" in drawn for tick in ticks)


@pytest.mark.parametrize(("least", "first"), [(0.016, -2), (0.0105, -3), (0.0029, -3), (1e-9, -6), (np.nan, -2)])
def test_an_axis_of_residuals_has_room_for_the_smallest(least, first):
    drawn = pictures.candidates(["Fx"], {"estimate": np.array([0.1]), "model": np.array([least])})
    assert places(drawn, "mark0", "cx")[1] == pytest.approx(100 + 252 * (1 + 1 / first), abs=0.06)
    assert f">{10.0**first:g}<" in drawn


def test_labels_of_names_that_begin_or_end_alike_differ():
    """A shoulder's two joints were one label, as both were cut after ten letters."""
    for name, label in {
        "shoulder_pan_joint, shoulder_lift_joint": "shoulder pan, shoulder lift",
        "left_upper_forearm, left_lower_forearm": "left upper, left lower",
        "knee_joint": "knee joint",
        "Fx, Fy": "Fx, Fy",
    }.items():
        assert pictures.labels_of(name.split(", ")) == label.split(", ")
    labels = pictures.labels_of(["right_upper_arm_roll", "right_upper_arm_pitch"])
    assert len(set(labels)) == 2 and max(map(len, labels)) <= 16


def test_one_candidate_has_no_ring_and_columns_and_ends_of_curves_have_their_numbers():
    small = r'<text class="small"[^>]*>([^<]*)<'
    drawn = pictures.candidates(["Fx"], {"estimate": np.array([0.1])})
    assert ">best<" not in drawn and not places(drawn, "best", "cx") and drawn.count("v-4") == 16
    each = [pictures.Interval(name, k, 1.0, 0.1, 0.05, None) for k, name in ((0, "m1"), (4, "Ixx1"), (10, "Fc(a)"))]
    drawn = pictures.parameters({"arm": each}, (1, 2, 3), 3)
    assert re.findall(small, drawn)[4:] == ["xx", "yy", "zz", "xy", "xz", "yz", "Fc"]
    drawn = pictures.curves(np.arange(3.0), {"worst": (np.array([0.0, 111.2, 1.0]), np.array([0.0, -49.4, 1.0]))})
    assert re.findall(small, drawn) == ["111", "\N{MINUS SIGN}49.4"]


@pytest.fixture(scope="module")
def estimate():
    return ident.identify(PENDULUM, shortened(faulty(1), 300))


def test_intervals_of_the_figure_are_those_that_the_verdict_goes_by(estimate):
    figure = parameters_figure(estimate)
    (axes,) = figure.axes
    (bars,) = axes.collections
    half = [np.ptp(segment[:, 0]) / 2 for segment in bars.get_segments()]
    prior = estimate.base.regroup(PENDULUM.known)
    size = np.max([abs(estimate.psi), abs(prior), 1.96 * estimate.std_setup], axis=0)
    np.testing.assert_allclose(half, 1.96 * estimate.std_setup / size, rtol=1e-3)
    assert axes.get_xlabel() == "Value over the largest of estimate, model and half-width"
    assert [text.get_text() for text in figure.legends[0].get_texts()] == ["Model", "Estimate, 95 % with set-up"]


def test_grey_spans_can_be_seen_are_one_where_they_nearly_touch_and_stand_in_the_legend(estimate):
    def drawn(samples, channel):
        resting = np.zeros(estimate.held_out.residual.shape, bool)
        resting[samples, channel] = True
        slow = replace(estimate, held_out=replace(estimate.held_out, resting=resting))
        figure = held_out_figure(slow)
        return slow, figure, [text.get_text() for text in figure.legends[0].get_texts()]

    assert drawn([], 0)[2] == ["Measured", "Predicted"] and "not judged" not in held_out_caption(estimate)
    slow, figure, legend = drawn(range(40), 3)
    assert legend == ["Measured", "Predicted", "Low velocity, not judged"] and "not judged" in held_out_caption(slow)
    assert sum(len(axes.collections) for axes in figure.axes) == 1
    # One sample alone, and three that are closer together than a line's width.
    first, time = drawn([20, 60, 62, 64], 0)[1].axes[0], estimate.held_out.time
    edges = np.array([path.get_extents().intervalx for path in first.collections[0].get_paths()])
    assert len(edges) == 2 and (np.diff(edges) >= 0.999 * 0.012 * np.ptp(time)).all()
    np.testing.assert_allclose(edges.mean(axis=1), time[[20, 62]], atol=1e-9)
    # Lines of the grid would look like spans.
    assert not any(line.get_visible() for line in first.get_xgridlines())
