"""The study and its report on small simulated recordings in the entries' form, and on a real one where it is there."""

import json
import os
from dataclasses import replace
from pathlib import Path

import driven_arm
import numpy as np
import pytest
from commands import refusal
from fuzz.here import Here
from registered import TEXT, files_of, recorded, written

from experiments import validate
from experiments.data.validation import CANDIDATES, ESTIMATE, LEAST_SQUARES, MODEL, inside
from experiments.reports import validation_report as report
from experiments.reports import validation_tables
from experiments.reports.validation_numbers import numbers
from experiments.runs import workers
from experiments.studies.validation import registry, study
from experiments.studies.validation.files import Places
from experiments.studies.validation.run import trial_name, trials_of
from ident.errors import InputError

DATA = Path(os.environ.get("MULTICONTACT_DATA", "")) / "dfki_double_pendulum"
MORE = """
alike = [["Fc(turn)", "Fc(lift)"]]
held_out = { lift = 0.02 }
"""
PUBLISHED = "".join(
    f'[[published]]\nname = "{name}"\nvalue = {value}\nstd = {std}\nsource = "model"\n'
    for name, value, std in (("Fc(turn)", 0.9, 0.01), ("Fc(bend)", 0.4, 0.01), ("Ia(bend)", 0.05, 0.001))
)


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    """Folder with the recordings, and an entry of them."""
    data = tmp_path_factory.mktemp("data")
    recorded(data / "arm")
    entries = tmp_path_factory.mktemp("entries")
    files = files_of(data / "arm", "arm.xml", "one.csv", "two.csv")
    text = TEXT.format(files=files, more=PUBLISHED).replace("\n[source]", f"{MORE}\n[source]", 1)
    return data, registry.read_entry(written(entries, text))


@pytest.fixture(scope="module")
def result(arm, tmp_path_factory):
    """Study of the entry in this process."""
    data, entry = arm
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(workers, "Processes", Here)
        return study.study([entry], Places((data,)), tmp_path_factory.mktemp("out"), workers.Workers())


def test_an_arm_is_identified_as_by_the_command(result):
    (each,) = result
    assert each.channels == driven_arm.JOINTS and set(each.ratios) == set(CANDIDATES)
    assert (each.ratios[ESTIMATE] < 0.1).all() and each.explained.all()
    assert each.outcome == "usable" and each.samples[0] > each.samples[1] > 0
    assert each.seconds > 0 and each.cutoff > 0 and each.unchecked == ()
    value, std, std_setup = each.values["Fc(turn)"]
    assert abs(value - 0.9) < 4 * std_setup and std <= std_setup
    assert len(each.halves) == len([name for name in each.values.names if "(" not in name])
    assert all(len(x) == len(each.values.names) for x in each.rivals.values())
    k = each.values.names.index("Fc(turn)")
    assert each.rivals[MODEL][k] == pytest.approx(0.9)
    assert each.rivals[LEAST_SQUARES][k] == pytest.approx(0.9, rel=0.1)


def test_each_log_is_identified_alone_and_compared(result):
    (each,) = result
    assert set(each.trials) == {"one", "two"}
    assert len(each.trial_z) == int((each.trials["one"].from_data & each.trials["two"].from_data).sum()) > 5
    assert inside(each.trial_z) > 0.8
    # The turning joint rubs more than the lifting one: they are not alike, and that shows.
    assert abs(each.alike_z[0]) > 5


def test_published_values_are_compared_with_both_deviations(result):
    (each,) = result
    published = each.entry.published[0]
    value, _, std = each.values[published.name]
    assert each.published_z(published) == pytest.approx((value - 0.9) / np.hypot(std, 0.01))
    unknown = replace(published, std=float("nan"))
    assert each.published_z(unknown) == pytest.approx((value - 0.9) / std)


def test_the_report_has_all_tables_and_figures(result):
    document = report.document(result, {})
    assert set(document.figures) == {"figure_validation", "figure_held_out", "figure_published"}
    assert set(document.tables) == {"table_recordings", "table_held_out", "table_published", "table_agreement"}
    rows = document.tables["table_held_out"].rows
    assert [row[1] for row in rows] == list(driven_arm.JOINTS)
    assert [row[5] for row in rows] == [None, 0.02, None]
    text = " ".join(document.text().split())
    assert "of 1 pairs of parameters that are equal by construction 0 differ by at most 1.96 s.d." in text


def test_tables_and_figures_follow_from_the_numbers(result):
    (each,) = result
    saved = json.loads(json.dumps(report.document(result, {}).numbers["summary"], allow_nan=False))
    assert saved["channels"] == 3 and set(saved["recordings"]) == {"arm"}
    again = study.study_of(saved, {"arm": each.entry})
    np.testing.assert_allclose(next(iter(again)).values.prior, each.values.prior, rtol=1e-5)
    assert report.main_lines(again) == report.main_lines(result)
    tables = [validation_tables.table_recordings, validation_tables.table_held_out, validation_tables.table_published]
    assert [table(again).markdown() for table in tables] == [table(result).markdown() for table in tables]


def made_worse(result, factors):
    """The study with the estimate's residuals multiplied by channel."""
    (each,) = result
    usual = each.ratios[LEAST_SQUARES]
    ratios = {LEAST_SQUARES: usual, ESTIMATE: usual * np.array(factors), MODEL: 5 * usual}
    return replace(result, validations={"arm": replace(each, ratios=ratios)})


def test_where_it_loses_it_says_so(result):
    worse = made_worse(result, [0.9, 1.04, 1.5])
    first, second, *_ = report.lines(worse)
    assert first.startswith("In 1 of 3 channels") and "in 1 it is worse by at most 5%" in first
    assert first.endswith("in 1 by more.")
    assert second.startswith("Arm: it loses in bend (") and "least squares" in second
    notes = [row[-1] for row in validation_tables.table_held_out(worse).rows]
    assert notes == ["best", "as good", "worse by 50%"]
    row = dict(zip(*(lambda t: (t.columns, t.rows[0]))(validation_tables.table_recordings(worse)), strict=True))
    assert (row["channels"], row["best"], row["worse"]) == (3, 1, 1)
    assert not any("loses" in line for line in report.lines(made_worse(result, [0.9, 1.0, 1.05])))


def test_channels_that_nobody_explains_do_not_count(result):
    (each,) = result
    ratios = {name: np.array([2.0, 0.5, 0.5]) for name in each.ratios}
    assert replace(each, ratios=ratios).against_best.tolist() == [1.0, 1.0]


def test_the_steel_pendulum_s_table_has_the_form_of_the_paper_s(result):
    (each,) = result
    table = validation_tables.table_steel(each)
    assert table.columns == ("parameter", "published", "error_model", "error_least_squares", "error", "std")
    name, published, of_model, _, error, std = table.rows[0]
    assert (name, published) == ("Fc(turn)", 0.9) and of_model == pytest.approx(0.0)
    assert (error, std) == (each.values[name][0] - 0.9, each.values[name][2])


def test_a_recording_that_cannot_be_identified_is_named_and_the_others_are_shown(arm, result, tmp_path):
    data, entry = arm
    other = replace(entry, name="other")
    untried = replace(entry, name="untried", title="Panda", tried=False)
    tasks = study.tasks_of([entry, other], {"arm": data, "other": data})
    assert [(task.entry.name, task.trial) for task in tasks] == [
        *(("arm", None), ("other", None), ("arm", (("one.csv",),)), ("arm", (("two.csv",),))),
        *(("other", (("one.csv",),)), ("other", (("two.csv",),))),
    ]
    several = replace(entry, fitted=tuple((name,) for name in "abcd"), judged=(("e",),))
    assert [trial_name(trial) for trial in trials_of(several)] == ["a, c, e", "b, d"]
    assert trials_of(replace(entry, fitted=(("a",),))) == []
    (each,) = result
    good, bad = numbers(result)["recordings"]["arm"], {"refused": "No excitation."}
    made = study.collected([entry, other, untried], tasks[:3], [good, bad, bad], {"untried": "Not here."})
    assert list(made.validations) == ["arm"] and made.untried == (untried,)
    np.testing.assert_allclose(next(iter(made)).values.values, each.values.values, rtol=1e-5)
    shown = report.lines(made)
    assert "Not run: other: No excitation." in shown and "Not run: arm: one: No excitation." in shown
    assert "In the registry, but never tried: Panda." in shown
    with pytest.raises(InputError, match="No excitation"):
        study.collected([other], tasks[1:2], [bad])


def test_the_command_asks_for_recordings(tmp_path, capsys, monkeypatch):
    monkeypatch.delenv(validate.VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    out = ["--out", str(tmp_path / "out")]
    assert "--fetch downloads" in refusal(validate.main, out, capsys)
    assert "needs a folder that exists" in refusal(validate.main, [*out, "--data", str(tmp_path / "no")], capsys)
    assert "Recordings are bow" in refusal(validate.main, ["nobody", *out, "--fetch"], capsys)
    assert "has no three_link_human.xml" in refusal(validate.main, ["bow", *out, "--data", str(tmp_path)], capsys)
    assert "is untried" in refusal(validate.main, ["panda", *out, "--data", str(tmp_path)], capsys)
    assert not (tmp_path / "out").exists()


@pytest.mark.usefixtures("undrawn")
def test_the_command_writes_a_page(arm, tmp_path, monkeypatch, capsys):
    data, entry = arm
    monkeypatch.setattr("experiments.studies.validation.registry.registry", lambda: {"arm": entry})
    monkeypatch.setattr(workers, "Processes", Here)
    monkeypatch.setenv(validate.VARIABLE, str(data))
    assert validate.main(["--out", str(tmp_path / "out"), "--workers", "1", "--formats", "png"]) == 0
    assert (tmp_path / "out" / "report.html").is_file() and (tmp_path / "out" / "summary.json").is_file()
    assert "the trajectory estimate predicts best" in " ".join(capsys.readouterr().out.split())


@pytest.mark.skipif(not (DATA / "c0_00.csv").is_file(), reason="MULTICONTACT_DATA has no dfki_double_pendulum")
def test_the_pendulum_in_steel_has_the_published_inertias():
    entry = registry.registry()["double_pendulum"]
    whole, *_ = study.tasks_of([entry], {entry.name: DATA})
    each = study.validation(entry, json.loads(study.work(whole)[0]), {})
    assert each.unchecked == () and each.channels == ("Joint1", "Joint2") and each.outcome == "usable"
    for name in ("m2rz2", "m3rz3", "Ixx2", "Ixx3", "Ia(Joint2)"):
        (published,) = [x for x in entry.published if x.name == name]
        assert abs(each.published_z(published)) < 1.96, name
        assert each.values[name][2] < 0.25 * abs(published.value), name
    assert (each.ratios[ESTIMATE] < 0.5).all() and (each.ratios[MODEL] > 2).all()
