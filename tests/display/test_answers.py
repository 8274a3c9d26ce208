"""Estimates, recordings, mechanisms and regroupings in an interpreter and in a notebook."""

import re
import sys
from dataclasses import replace
from importlib.util import find_spec
from types import SimpleNamespace as Namespace
from xml.etree import ElementTree

import driven_arm
import numpy as np
import pytest
from driven_arm import jointly, quick
from scipy import stats

import ident
from ident.display.brief import html_table
from ident.errors import InputError
from ident.estimate import PAGES

pytestmark = pytest.mark.extras

SHORT = 10  # Most lines of a repr.


def words_of(html):
    """Text of a page's part, which must be well formed."""
    return " ".join(ElementTree.fromstring(f"<div>{html}</div>").itertext())


@pytest.mark.parametrize("setup", [True, False])
@pytest.mark.parametrize("level", [0.5, 0.95])
def test_intervals_are_those_of_normal_errors(level, setup):
    estimate = jointly()
    intervals, std = estimate.interval(level, setup=setup), estimate.std_setup if setup else estimate.std
    np.testing.assert_allclose(intervals, np.transpose(stats.norm.interval(level, estimate.psi, std)))
    np.testing.assert_allclose(estimate[estimate.names[3]].interval(level, setup=setup), intervals[3])


def test_estimated_scales_of_torques_are_parameters():
    estimate = jointly()
    value, std = estimate.scales["bend"]
    scale = estimate["scale(bend)"]
    assert (scale.kind, scale.body, scale.estimate, scale.std_setup, scale.model) == ("scale", "bend", value, std, 1.0)
    assert scale in estimate.by_body["bend"] and "scale(bend)" in estimate._repr_html_()
    assert estimate.to_dict()["scales"] == {"bend": {"value": value, "std": std}} and not quick().to_dict()["scales"]
    assert re.search(r"^scale\(bend\) +bend +[0-9.]+", estimate.summary(), re.MULTILINE)
    assert " and scales from" in repr(estimate)


def test_an_estimate_is_a_mapping_of_parameters_with_unit_body_and_model():
    estimate = quick()
    assert list(estimate) == list(estimate.names) and len(estimate) == estimate.base.rank and estimate
    assert all(estimate[name].name == name for name in estimate)
    assert "m3rx3" in estimate and "Fc(bend)" in estimate and "m3rx4" not in estimate and 3 not in estimate
    friction, moment = estimate["Fc(bend)"], estimate["m3rx3"]
    assert (friction.kind, friction.unit, friction.body) == ("drive", "N m", "bend")
    assert (moment.kind, moment.unit, moment.body) == ("base", "kg m", "fore")
    assert friction.model == pytest.approx(0.4) and moment.model == pytest.approx(1.5 * 0.15)
    assert str(moment).startswith("m3rx3 = 0.22") and "kg m, 95 % interval" in str(moment)
    assert replace(friction, estimate=0.01, std_setup=1.0).interval() == (0.0, pytest.approx(0.01 + 1.959964))
    for name, sentence in {
        "m3rx4": r"has no parameter 'm3rx4'; near that are .*m3rx3",
        "M3RX3": "near that are .*m3rx3",
        "fc(bent)": r"near that are .*Fc\(bend\)",
        3: r"has no parameter 3; there are Izz1, .* and others\.$",
    }.items():
        with pytest.raises(InputError, match=sentence):
            estimate[name]
    with pytest.raises(InputError, match=r"The estimate has no parameters of 'Fores'; near that are fore\."):
        estimate.by_body["Fores"]


@pytest.mark.parametrize("estimate", [quick, jointly])
def test_repr_is_short_and_summary_and_html_have_everything(estimate):
    estimate = estimate()
    assert str(estimate) == repr(estimate)
    *_, counts, _ = lines = repr(estimate).splitlines()
    assert len(lines) <= SHORT and max(map(len, lines)) <= 100 and "base parameters" in lines[0]
    assert re.search(r"verdict: \w+( \w+)*, (1 doubt|\d+ doubts), (1 remark|\d+ remarks)$", counts)
    summary = estimate.summary()
    heads = {tuple(line.split()[:2]) for line in summary.splitlines()}
    assert {(each.name, each.body) for each in estimate.parameters} <= heads
    words = " ".join(summary.split())
    assert all(each.expression in words for each in estimate.parameters)
    sentences = [str(estimate.verdict()), *estimate.prepared.notes, *(finding.text for finding in estimate.findings)]
    assert all(" ".join(sentence.split()) in words for sentence in sentences)
    assert max(map(len, summary.splitlines())) <= 120
    words = words_of(estimate._repr_html_())
    assert all(name in words for name in estimate.names) and str(estimate.verdict()) in words
    assert "Replay" not in words and "kg\N{NO-BREAK SPACE}m²" in words


def test_html_links_to_the_page_and_is_escaped(tmp_path, monkeypatch):
    monkeypatch.setitem(PAGES, quick(), tmp_path / 'a "page"' / "report.html")
    linked = quick()._repr_html_()
    assert "Replay and figures" in linked and "&quot;page&quot;" in linked
    assert re.findall(r">([^<]+)<", html_table(["<b>"], [["a & b"]])) == ["&lt;b&gt;", "a &amp; b"]


def test_plots_are_figures_of_the_estimate():
    estimate = jointly()
    (ax,) = estimate.plot().axes
    assert [label.get_text() for label in ax.get_yticklabels()] == list(estimate.names)
    spectra, fit = estimate.plot_spectra(), estimate.plot_fit()
    for figure in (spectra, fit):
        assert {ax.get_ylabel().partition(" (")[0] for ax in figure.axes if ax.axison} == {*estimate.channels}
    assert [line.get_xdata().size > 10 for line in spectra.axes[0].lines] == [True, True]
    measured, predicted = (line.get_ydata() for line in fit.axes[0].lines)
    np.testing.assert_allclose(measured, estimate.held_out.samples.measured[:, 0])
    np.testing.assert_allclose(measured - predicted, estimate.held_out.residual[:, 0])


def test_a_notebook_shows_a_figure_once_whatever_its_cell_ends_with(monkeypatch):
    """`estimate.plot();` has no last value, and `estimate.plot()` shows it before the cell ends."""
    shown, ends = [], []

    def display(figure):
        with pytest.raises(NotImplementedError):  # IPython goes on to other ways to show it.
            figure._ipython_display_()
        shown.append(figure)

    shell = Namespace(kernel=None, events=Namespace(register=lambda event, function: ends.append(function)))
    notebook = Namespace(get_ipython=lambda: shell, display=Namespace(display=display))
    monkeypatch.setitem(sys.modules, "IPython", notebook)
    figures = [quick().plot(), quick().plot()]
    display(figures[1])
    ends[-1]()
    ends[-1]()
    assert shown == figures[::-1]
    del shell.kernel
    quick().plot()
    ends[-1]()
    assert len(shown) == 2


def test_answers_are_sentences_and_tables_instead_of_their_fields():
    estimate = quick()
    comparison, consistent = estimate.compare(estimate), estimate.consistent()
    for answer in (estimate.verdict(), comparison, consistent, estimate["m3rx3"], jointly().consistent()):
        assert not re.search(r"\barray\(|outcome=|phi=|names=", repr(answer) + words_of(answer._repr_html_()))
    assert str(estimate.verdict()) in repr(estimate.verdict())
    assert comparison.names == tuple(each.name for each in estimate.parameters if each.kind != "offset")
    assert set(estimate.fit.equations.drives) < set(comparison.names)
    assert "χ² is 0.0 of" in repr(comparison) and "no more than noise" in repr(comparison)
    assert "m3rx3 of fore" in comparison._repr_html_() and "<th>unit</th>" in comparison._repr_html_()
    assert "column 4" in repr(consistent) and "upper 3" in consistent._repr_html_()


@pytest.mark.skipif(find_spec("pandas") is None, reason="pandas is an extra")
def test_a_data_frame_has_every_parameter():
    estimate = jointly()
    frame = estimate.to_frame()
    assert tuple(frame.index) == tuple(each.name for each in estimate.parameters) and "scale(bend)" in frame.index
    base = frame[frame["kind"] == "base"]
    for column, expected in (("estimate", estimate.psi), ("std_setup", estimate.std_setup)):
        np.testing.assert_array_equal(base[column], expected)
    np.testing.assert_allclose(base[["lower", "upper"]], estimate.interval())
    assert frame.loc["Fc(bend)", "unit"] == "N m" and frame.loc["Fc(bend)", "model"] == pytest.approx(0.4)


@pytest.mark.parametrize("thing", [quick, lambda: quick().consistent(), lambda: quick().prepared.recording])
def test_without_pandas_a_sentence_names_the_extra(monkeypatch, thing):
    monkeypatch.setitem(sys.modules, "pandas", None)
    with pytest.raises(InputError, match="A data frame needs the package 'pandas', which the extra 'pandas' brings: p"):
        thing().to_frame()


@pytest.mark.parametrize(
    ("thing", "parts"),
    [
        (lambda: driven_arm.log(6.0, 50.0), ["300 at 50 Hz", "turn_position", "bend_torque"]),
        (driven_arm.mechanism, ["column, upper, fore", "turn, lift, bend", "8.5 kg in 3 bodies"]),
        (lambda: ident.find_base_parameters(driven_arm.mechanism()), ["of 30 parameters", "m1 + m2 + m3"]),
    ],
)
def test_a_repr_has_at_most_ten_lines_and_says_the_most_important(thing, parts):
    made = thing()
    lines = repr(made).splitlines()
    assert len(lines) <= SHORT and max(map(len, lines)) <= 100
    assert all(part in repr(made) and part in made._repr_html_() for part in parts)
    assert lines[0] == f"<{type(made).__name__}" and lines[-1].endswith(">")


def test_a_recording_is_plotted_with_all_that_it_measures():
    log = driven_arm.log(6.0, 50.0)
    wrenches = {"ground_force": np.ones((300, 3)), "ground_torque": np.zeros((300, 3))}
    of_body = {"hand_position": np.zeros((300, 3)), "hip_position": np.tile([1.0, 0, 0, 0], (300, 1))}
    recording = ident.Recording(log.time, {**log.measured, **wrenches, **of_body}, units={"lift_torque": "mN m"})
    panels = {ax.get_ylabel(): {line.get_label(): line for line in ax.lines} for ax in recording.plot().axes}
    joints = (*driven_arm.JOINTS, *(f"hip.{x}" for x in "wxyz"))
    assert {label: tuple(lines) for label, lines in panels.items()} == {
        "Joint position\n(rad or m)": joints,
        "Joint torque\n(N m or N, mN m)": driven_arm.JOINTS,
        "Force ground\n(N)": ("F.x", "F.y", "F.z"),
        "Moment ground\n(N m)": ("M.x", "M.y", "M.z"),
    }
    line = panels["Joint position\n(rad or m)"]["lift"]
    np.testing.assert_array_equal(line.get_xydata(), np.stack([log.time, log["lift_position"]], axis=1))


def test_a_recording_as_a_data_frame_is_read_back():
    pytest.importorskip("pandas")
    log = driven_arm.log(4.0, 50.0)
    frame = ident.Recording(log.time, {**log.measured, "ground_force": np.ones((200, 3))}).to_frame()
    assert frame.index.name == "time"
    assert [name for name in frame if "force" in name] == [f"ground_force.{axis}" for axis in "xyz"]
    again = ident.read_log(frame, driven_arm.mechanism())
    np.testing.assert_allclose(again.time, log.time)
    assert {*log.measured} <= {*again.measured} and (again["bend_torque"] == log["bend_torque"]).all()
