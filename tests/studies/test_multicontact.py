"""Section VII: required results of the study, and its command line."""

import csv
import json

import numpy as np
import pytest
from shared_studies import packaged_study
from stand_ins import use_truth

import scenes
from experiments import multicontact
from experiments.data import paper
from experiments.data.simulated_study import summary as summary_of
from experiments.reports import study_report
from experiments.studies.simulation import study


@pytest.fixture(scope="module", params=(*scenes.CONTACTS, "pad handle"))
def contact(request):
    return request.param


@pytest.fixture(scope="module")
def result(contact):
    return packaged_study("multicontact", contact=contact)


@pytest.fixture(scope="module")
def results(contact, tmp_path_factory):
    folder = tmp_path_factory.mktemp("results")
    with pytest.MonkeyPatch.context() as patched:
        use_truth(patched)
        # In any order: the scene determines the recording.
        command = ["--out", str(folder), "--contact", *reversed(contact.split()), "--formats", "png"]
        assert multicontact.main(command) == 0
    return folder


def test_condition_number_and_shape(result):
    assert result.fit("contact").estimate.condition_number == pytest.approx(36.5, rel=0.1)
    assert (result.fit("contact").estimate.rows, result.fit("contact").base.rank) == paper.SHAPE_MULTICONTACT
    assert result.fit("contact").base.names == tuple(paper.TABLE_4)


def test_errors_at_default_noise(result):
    error = dict(zip(result.fit("contact").base.names, np.abs(result.fit("contact").error), strict=True))
    assert max(error.values()) <= 0.10
    assert error["m1"] <= 0.02
    assert all(e <= 0.05 for name, e in error.items() if "r" in name)


def test_ignoring_the_contact_is_ten_times_worse(result, contact):
    names = [name for name in result.file.models if name.startswith("ignoring")]
    assert names == (["ignoring_pad", "ignoring_handle", "ignoring"] if contact == "pad handle" else ["ignoring"])
    for ignoring in map(result.fit, names):
        assert np.max(np.abs(ignoring.error) / np.abs(result.fit("contact").error)) > 10
        assert np.abs(ignoring.error).max() > 10 * np.abs(result.fit("contact").error).max()


def test_without_noise_the_estimate_is_exact(contact):
    assert np.abs(study("multicontact", contact=contact, noise_scale=0).fit("contact").error).max() < 1e-6


@pytest.mark.parametrize("contact", ["pad", "pad handle"], indirect=True)
def test_command_line_writes_everything(results, contact, result):
    more = ("contacts",) if result.several else ()
    tables = [f"table_{n}.{s}" for n in ("4", "4_ignoring", *more) for s in ("csv", "md", "tex")]
    charts = [f"figure_{n}.{ending}" for n in ("4", "5", *more) for ending in ("png", "csv")]
    expected = {*tables, *charts, "recording.npz", "summary.json", "provenance.json", "report.html"}
    assert {file.name for file in results.iterdir()} == expected
    rows = list(csv.DictReader((results / "table_4.csv").read_text().splitlines()))
    ours, trajectory = ("true" if result.several else "true_scene", "error"), ("trajectory_error", "trajectory_std")
    beside = () if result.several else ("true_paper", "paper_error")
    assert {*rows[0]} == {"parameter", "body", *ours, *beside, *trajectory}
    assert f"trajectory_error_ignoring{'_all' * result.several}" in (results / "table_4_ignoring.csv").read_text()
    np.testing.assert_array_equal([float(row["error"]) for row in rows], result.fit("contact").error)
    markdown = (results / "table_4.md").read_text()
    assert all((text in markdown) == (contact == "pad") for text in ("Ixx3*", "parallel-axis terms", "paper"))
    summary = json.loads((results / "summary.json").read_text())
    assert (summary["rank"], summary["rows"]) == (13, 4715)
    assert summary["condition_number"] == result.fit("contact").estimate.condition_number
    if "pad" in contact:
        site = scenes.load_cells(contact)["pad"]
        touching = result.recording.true["pad_normal_force"] > 0
        assert summary["fraction_all_touch"] == summary[f"{site}_fraction"] == touching.mean()
        begun = [k for k in np.flatnonzero(touching) if k == 0 or not touching[k - 1]]
        assert summary[f"{site}_episodes"] == len(begun)
    peaks = []
    for site in scenes.load_cells(contact).values():
        force = result.recording.true[f"{site}_force"]
        peaks.append(np.sqrt((force**2).sum(axis=1)).max())
        assert summary[f"{site}_peak_force_N"] == pytest.approx(peaks[-1])
    assert summary["contact_peak_force_N"] == pytest.approx(max(peaks))
    assert summary["largest_error_ignoring"] == np.abs(result.fit("ignoring").error).max()
    assert json.loads((results / "provenance.json").read_text())["options"]["contact"] == contact


@pytest.mark.parametrize("contact", ["handle"], indirect=True)
def test_the_trajectory_estimate_takes_contacts_too(result):
    k = result.fit("contact").base.names.index("Ixx2")
    assert abs(result.trajectory("contact").error[k]) < 4 * result.trajectory("contact").std[k]
    assert abs(result.trajectory("contact").error[k]) < abs(result.fit("contact").error[k])
    assert abs(result.trajectory("contact").error / result.trajectory("contact").std).max() < 4
    rows, own = study_report.table(result, "table_4").rows, result.trajectory("contact")
    np.testing.assert_array_equal([row[-2:] for row in rows], np.transpose([own.error, own.std]))
    assert abs(result.trajectory("ignoring").error).max() > 10


def test_two_contacts_touch_at_the_same_time():
    result = packaged_study("multicontact", contact="pad handle")
    touching, summary = result.recording.true["pad_normal_force"] > 0, summary_of(result)
    assert 0.25 < summary["fraction_all_touch"] == touching.mean() < 0.8
    alone = ("contact_pad_fraction_alone", "contact_handle_fraction_alone", "fraction_none_touches")
    assert [summary[key] for key in alone] == [0, np.mean(~touching), 0]
    assert summary["contact_handle_episodes"] == summary["contact_handle_fraction"] == 1
    pad, handle = study_report.table(result, "table_contacts").rows
    assert pad[:2] + handle[:2] == ("pad", "link2", "handle", "link1")
    assert pad[2:4] == (touching.mean(), 0)
    assert summary["tracking_error_rad"] < 0.03


@pytest.mark.parametrize("contact", ["pad"], indirect=True)
def test_the_trajectory_estimate_follows_accelerations_that_jump_with_denser_knots(result):
    assert abs(result.trajectory("contact").error / result.trajectory("contact").std).max() < 4
