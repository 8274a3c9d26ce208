"""Section VII: required results of the study, and its command line."""

import numpy as np
import pytest
from commands import entries_of, rows_of
from shared_studies import packaged_study
from stand_ins import leave_undrawn, use_truth

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
        leave_undrawn(patched)
        # In any order: the scene determines the recording.
        command = ["--out", str(folder), "--contact", *reversed(contact.split()), "--formats", "png"]
        assert multicontact.main(command) == 0
    return folder


def test_condition_number_shape_and_errors_at_default_noise(result):
    fit = result.fit("contact")
    assert fit.estimate.condition_number == pytest.approx(36.5, rel=0.1)
    assert (fit.estimate.rows, fit.base.rank) == paper.SHAPE_MULTICONTACT and fit.base.names == tuple(paper.TABLE_4)
    assert abs(fit.error).max() <= 0.10
    for name, error in zip(fit.base.names, abs(fit.error), strict=True):
        assert error <= 0.02 or name != "m1"
        assert error <= 0.05 or "r" not in name


def test_ignoring_the_contact_is_ten_times_worse(result, contact):
    names = [name for name in result.file.models if name.startswith("ignoring")]
    assert names == (["ignoring_pad", "ignoring_handle", "ignoring"] if contact == "pad handle" else ["ignoring"])
    errors = abs(result.fit("contact").error)
    for ignoring in (abs(result.fit(name).error) for name in names):
        assert (ignoring / errors).max() > 10 and ignoring.max() > 10 * errors.max()


def test_without_noise_the_estimate_is_exact(contact):
    assert np.abs(study("multicontact", contact=contact, noise_scale=0).fit("contact").error).max() < 1e-6


@pytest.mark.parametrize("contact", ["pad", "pad handle"], indirect=True)
def test_command_line_writes_everything(results, contact, result):
    more = ("contacts",) if result.several else ()
    expected = {f"table_{n}.{s}" for n in ("4", "4_ignoring", *more) for s in ("csv", "md", "tex")}
    expected |= {f"figure_{n}.{ending}" for n in ("4", "5", *more) for ending in ("png", "csv")}
    expected |= {"recording.npz", "summary.json", "provenance.json", "report.html"}
    assert {file.name for file in results.iterdir()} == expected
    rows = rows_of(results / "table_4.csv")
    of_paper = ("true",) if result.several else ("true_scene", "true_paper", "paper_error")
    assert {*rows[0]} == {"parameter", "body", "error", *of_paper, "trajectory_error", "trajectory_std"}
    assert f"trajectory_error_ignoring{'_all' * result.several}" in (results / "table_4_ignoring.csv").read_text()
    np.testing.assert_array_equal([float(row["error"]) for row in rows], result.fit("contact").error)
    markdown = (results / "table_4.md").read_text()
    assert all((text in markdown) == (contact == "pad") for text in ("Ixx3*", "parallel-axis terms", "paper"))
    summary, sites, true = entries_of(results / "summary.json"), scenes.load_cells(contact), result.recording.true
    touching = true["pad_normal_force"] > 0
    peaks = {site: np.linalg.norm(true[f"{site}_force"], axis=1).max() for site in sites.values()}
    numbers = {f"{site}_peak_force_N": peak for site, peak in {**peaks, "contact": max(peaks.values())}.items()}
    numbers |= {
        "rank": 13,
        "rows": 4715,
        "condition_number": result.fit("contact").estimate.condition_number,
        "largest_error_ignoring": np.abs(result.fit("ignoring").error).max(),
        "fraction_all_touch": touching.mean(),
        f"{sites['pad']}_fraction": touching.mean(),
        f"{sites['pad']}_episodes": touching[0] + np.sum(touching[1:] & ~touching[:-1]),
    }
    assert {name: summary[name] for name in numbers} == pytest.approx(numbers)
    assert entries_of(results / "provenance.json")["options"]["contact"] == contact


@pytest.mark.parametrize("contact", ["pad", "handle"], indirect=True)
def test_the_trajectory_estimate_takes_contacts_too(result, contact):
    """Also accelerations that jump at the pad, with denser knots."""
    own, fit = result.trajectory("contact"), result.fit("contact")
    k = fit.base.names.index("Ixx2")
    assert abs(own.error / own.std).max() < 4 and (contact == "pad" or abs(own.error[k]) < abs(fit.error[k]))


@pytest.mark.parametrize("contact", ["pad handle"], indirect=True)
def test_two_contacts_touch_at_the_same_time(result):
    touching, summary = result.recording.true["pad_normal_force"] > 0, summary_of(result)
    assert 0.25 < touching.mean() < 0.8
    alone = ("contact_pad_fraction_alone", "contact_handle_fraction_alone", "fraction_none_touches")
    assert [summary[key] for key in alone] == [0, np.mean(~touching), 0]
    assert summary["contact_handle_episodes"] == summary["contact_handle_fraction"] == 1
    pad, handle = study_report.table(result, "table_contacts").rows
    assert pad[:4] + handle[:2] == ("pad", "link2", touching.mean(), 0, "handle", "link1")
    assert summary["tracking_error_rad"] < 0.03
