"""Two results side by side: their differences, significance of these, and different settings."""

import json

import numpy as np
import pytest
from commands import entries_of, rows_of
from scipy import stats

from experiments import compare
from experiments.data.comparison import Difference, read_results
from experiments.document import writer
from experiments.reports import compare_report

NAMES = ("m1", "m2rz2", "Ixx2")
COVARIANCE = np.diag([0.01, 0.04, 0.09]) + 0.005


def result(
    folder, values, *, log="a", file=None, covariance=COVARIANCE, regrouping=NAMES, bodies=("base", "shank"), **options
):
    """A folder in the format of `identify`, with an offset after the base parameters."""
    folder.mkdir()
    wide = np.pad(covariance, ((0, 1), (0, 1)), constant_values=1.0)
    estimate = {
        "verdict": f"Usable, {folder.name}",
        "columns": [*NAMES, "offset(Fx)"],
        "values": [*values, 7.0],
        "covariance": wide.tolist(),
        "std_setup": (2 * np.sqrt(np.diag(wide))).tolist(),
        "regrouping": dict(zip(NAMES, regrouping, strict=True)),
        "held_out": {"Fx": {"ratio": 0.25}, folder.name: {"ratio": 0.5}},
        "setup": [{"name": "delay", "text": "late"}] if log == "a" else [],
        "bodies": {name: {} for name in bodies},
    }
    logs = [{"file": file or f"{log}.csv", "sha256": log}]
    provenance = {
        "options": {"logs": [log], "out": folder.name, "verbose": log == "a", "estimator": "trajectory"} | options,
        "recording": {"model": {"file": "m.xml", "sha256": "0"}, "logs": logs},
        "versions": {"multicontact": "1"},
        "git_commit": None,
    }
    for name, content in (("estimate", estimate), ("provenance", provenance)):
        (folder / f"{name}.json").write_text(json.dumps(content))
    return folder


def run(tmp_path, *folders, more=()):
    assert compare.main([*map(str, folders), "--out", str(tmp_path / "out"), *more]) == 0
    return entries_of(tmp_path / "out" / "comparison.json")["pairs"]


@pytest.fixture
def without_page(monkeypatch):
    monkeypatch.setattr(writer, "write_page", lambda *_: None)


@pytest.mark.usefixtures("undrawn", "without_page")
def test_differences_have_the_intervals_of_independent_noise(tmp_path, capsys):
    a, b = np.array([1.0, 2.0, 3.0]), np.array([1.1, 1.5, 3.0])
    first, second = result(tmp_path / "first", a), result(tmp_path / "second", b, log="b", estimator="weighted")
    (compared,) = run(tmp_path, first, second)
    np.testing.assert_allclose(compared["difference"], a - b)
    np.testing.assert_allclose(compared["std"], np.sqrt(2 * np.diag(COVARIANCE)))
    np.testing.assert_allclose(compared["std_setup"], 2 * np.sqrt(2 * np.diag(COVARIANCE)))
    chi2 = (a - b) @ np.linalg.inv(2 * COVARIANCE) @ (a - b)
    assert compared["chi2"] == pytest.approx(chi2) and compared["p_value"] == pytest.approx(stats.chi2.sf(chi2, 3))
    assert compared["settings"] == {"estimator": ["trajectory", "weighted"], "logs": ["a.csv", "b.csv"]}
    rows = rows_of(tmp_path / "out" / "table_differences.csv")
    assert [row["body"] for row in rows] == ["base", "shank", "shank"]
    assert float(rows[1]["interval_95"]) == pytest.approx(1.959964 * compared["std"][1])
    output = capsys.readouterr().out
    assert "'first' and 'second' agree within noise." in output and "late" in output and "as stated" in output
    z = next(line for line in output.splitlines() if line.startswith("m2rz2 of shank")).split()[-2]
    assert z == f"{(a - b)[1] / compared['std'][1]:.1f}"


@pytest.mark.usefixtures("undrawn", "without_page")
def test_drives_are_compared_too_and_those_of_one_alone_are_named(tmp_path, capsys):
    folders = [result(tmp_path / name, [1.0, 2.0, 3.0], log=name) for name in "ab"]
    for folder, friction, other in zip(folders, (1.0, 9.0), ("Fc(knee)", "Ia(knee)"), strict=True):
        estimate = json.loads((folder / "estimate.json").read_text())
        estimate["columns"][3:3] = ["Fv(knee)", other]
        estimate["values"][3:3] = [friction, 0.5]
        wide = np.insert(np.insert(np.array(estimate["covariance"]), [3, 3], 0, axis=0), [3, 3], 0, axis=1)
        wide[[3, 4], [3, 4]] = 0.5
        estimate |= {"covariance": wide.tolist(), "std_setup": np.sqrt(np.diag(wide)).tolist()}
        (folder / "estimate.json").write_text(json.dumps(estimate))
    (compared,) = run(tmp_path, *folders)
    assert compared["parameters"] == [*NAMES, "Fv(knee)"] and compared["chi2"] == pytest.approx(64)
    output = capsys.readouterr().out
    assert "✕ Differ. 'a' and 'b' differ by more than noise." in output and "Fv(knee) by -8.0 ± 1.0 (z -8.0)" in output
    assert "only one result has them or regroups them so: Fc(knee), Ia(knee)." in output


def test_the_chance_of_disagreement_is_right(tmp_path):
    """The p-value of two draws around one truth is uniform."""
    rng, p = np.random.default_rng(0), []
    both = read_results([result(tmp_path / log, np.zeros(3), log=log) for log in "ab"])
    for _ in range(400):
        for one in both:
            one.estimate["values"][:3] = rng.multivariate_normal([1, 2, 3], COVARIANCE).tolist()
        p.append(Difference(*both).comparison.p_value)
    assert stats.kstest(p, "uniform").pvalue > 0.01


@pytest.mark.usefixtures("undrawn", "without_page")
def test_a_log_that_both_were_fitted_to_leaves_no_interval(tmp_path, capsys):
    folders = [result(tmp_path / name, [1.0, 2.0, x]) for name, x in (("a", 3.0), ("b", 4.0))]
    folders.append(result(tmp_path / "c", [1.0, 2.0, 9.0], log="c"))
    shared, far = run(tmp_path, *folders)
    assert shared["shared_logs"] == ["a.csv"] and shared["chi2"] is None and shared["difference"] == [0, 0, -1]
    assert far["p_value"] < 1e-9
    output = capsys.readouterr().out
    assert "'a' and 'b' share logs: their difference has no interval." in output
    assert "of a less those of b, SI units\n" in output
    assert "✕ Differ. 1 of 2 results beside 'a' differ by more than noise." in output
    assert "Both were fitted to a.csv" in output and "'a' and 'c' differ by more than noise" in output
    assert not (tmp_path / "out" / "figure_differences_2.svg").exists()
    assert (tmp_path / "out" / "figure_differences_3.svg").exists()


@pytest.mark.usefixtures("without_page")
def test_logs_of_one_name_go_by_their_paths(tmp_path, capsys):
    named = {name: {"log": name, "file": "run.csv", "logs": [f"{name}/run.csv"]} for name in "abc"}
    folders = [result(tmp_path / name, [1.0, 2.0, 3.0], **options) for name, options in named.items()]
    first, _ = run(tmp_path, *folders, more=["--formats", "none"])
    assert first["settings"]["logs"] == ["a/run.csv (a)", "b/run.csv (b)"]
    assert capsys.readouterr().out.count("If logs are independent") == 1, "once for all pairs"


def test_parameters_that_mean_something_else_are_not_compared(tmp_path):
    other = {"log": "b", "regrouping": ("m1 + m2", "m2rz2", "Ixx2")}
    both = [result(tmp_path / name, [1.0, 2.0, 3.0], **options) for name, options in (("a", {}), ("b", other))]
    difference = Difference(*read_results(both))
    assert difference.names == ("m2rz2", "Ixx2") and difference.comparison.covariance.shape == (2, 2)
    assert "Not compared, because only one result has them or regroups them so: m1." in compare_report.agreement(
        difference
    )
