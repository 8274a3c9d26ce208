"""The command line of the study: its files, reproducibility, and exit."""

import re
from dataclasses import replace

import numpy as np
import pytest
from commands import entries_of, rows_of
from shared_studies import packaged_study
from stand_ins import undetermined

from experiments import misaligned
from experiments.data import paper
from experiments.data.fitting import trajectory_estimate
from experiments.data.simulated_study import SimulatedStudy, tilts, wrench_error
from experiments.document.figures import SHEET
from experiments.reports import study_report
from ident.tolerances import INTERVAL

MODELS = {"simplified": "simplified", "full": "full_on_table"}
KINDS = ("true", "error", "paper_error", "trajectory_error")
COLUMNS = ["parameter", "body", *(f"{kind}_{model}" for model in MODELS for kind in KINDS), "trajectory_std_full"]


@pytest.fixture(scope="module")
def study():
    return packaged_study("misaligned", seed=0)


@pytest.fixture(scope="module")
def results(study, tmp_path_factory):
    """Folder of the command's results, with the trajectory estimates of `study`."""
    out, trajectory = tmp_path_factory.mktemp("results") / "new" / "folder", study.trajectory
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(SimulatedStudy, "trajectory", lambda self, model: trajectory(model))
        assert misaligned.main(["--out", str(out), "--seed", "0", "--formats", *paper.FORMATS]) == 0
    return out


def test_everything_is_written(results):
    names = ("table_3", "table_3_searched", "table_3_full", "table_tilts", "table_wrench_errors")
    expected = {f"{name}.{suffix}" for name in names for suffix in ("csv", "md", "tex")}
    expected |= {f"figure_{k}.{extension}" for k in (2, 3) for extension in (*paper.FORMATS, "tex", "csv")}
    expected |= {"summary.json", "provenance.json", "report.html", "recording.npz"}
    assert {file.name for file in results.iterdir()} == expected
    assert all(file.stat().st_size > 100 for file in results.iterdir())
    origin = entries_of(results / "provenance.json")
    own = {"seed": 0, "samples": 943, "tilt_deg": 5.0, "azimuth_deg": 120.0, "noise_scale": 1.0}
    assert origin["options"] == own | {"formats": list(paper.FORMATS)}
    assert len(origin["recording"]["scene_sha256"]) == 64
    assert "joint angles and wrenches alone" in origin["estimators"]["trajectory"]
    assert set(origin["versions"]) >= {"python", "mujoco", "numpy", "scipy", "matplotlib"}


def test_table_3_holds_both_models_beside_the_paper(results, study):
    rows = rows_of(results / "table_3.csv")
    assert list(rows[0]) == COLUMNS and [row["parameter"] for row in rows] == list(paper.TABLE_3)
    for k, row in enumerate(rows):
        expected = []
        for model, published in zip(MODELS.values(), paper.TABLE_3[row["parameter"]], strict=True):
            fitted = study.fit(model)
            expected += [fitted.psi_true[k], fitted.error[k], published, study.trajectory(model).error[k]]
        expected.append(study.trajectory("full_on_table").std[k])
        assert [float(row[column]) for column in COLUMNS[2:]] == expected


def test_the_trajectory_estimate_has_not_the_bias_of_least_squares(study):
    """It takes angles and wrenches alone, and does not know that axes are tilted."""
    joint, fitted = study.trajectory("full_on_table"), study.fit("full_on_table")
    k = fitted.base.names.index("Ixx2")
    assert abs(joint.error[k]) < min(4 * joint.std[k], abs(fitted.error[k]) / 2)
    # Errors are within the standard deviation and the effect of a hundredth of a degree of the recovered axes.
    assert (abs(joint.error) < 4 * joint.std + 0.02).all() and abs(study.trajectory("simplified").error).max() > 0.5
    kept = {name: x for name, x in study.recording.measured.items() if "force" in name or "torque" in name}
    angles = {name: study.recording[name] for name in ("joint1_position", "joint2_position")}
    recording = replace(study.recording, measured=kept | angles, true={})
    alone = trajectory_estimate(study.mechanism("full_on_table"), recording, fitted.base)
    np.testing.assert_array_equal([alone.psi, alone.std_setup], [joint.psi, joint.std])


@pytest.mark.usefixtures("undrawn")
def test_too_few_angles_for_the_trajectory_estimate_leave_its_columns_empty(tmp_path, monkeypatch):
    """The same bytes of the same seed."""
    for estimate in ("simulated_study.trajectory_estimate", "fitting.trajectory_estimate"):
        monkeypatch.setattr(f"experiments.data.{estimate}", undetermined)
    first, again = tmp_path / "first", tmp_path / "again"
    for out in (first, again):
        assert misaligned.main(["--out", str(out), "--samples", "60", "--formats", "png"]) == 0
    rows = rows_of(first / "table_3.csv")
    assert {row["trajectory_error_full"] for row in rows} == {""} and float(rows[1]["error_full"]) != 0
    assert {*rows_of(first / "table_tilts.csv")[0]} == {"tilt", "true_deg", "tilt_full_deg", "std_full_deg"}
    assert entries_of(first / "summary.json")["trajectory"]["largest_error_full_on_table"] is None
    files = [file for file in first.iterdir() if file.name not in ("provenance.json", "report.html")]
    assert {file.suffix for file in files} == {".csv", ".md", ".tex", ".png", ".json", ".npz"}
    assert [file.name for file in files if file.read_bytes() != (again / file.name).read_bytes()] == []


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn", "no_trajectory")
@pytest.mark.parametrize(("options", "beside"), [(["--seed", "4"], True), (["--tilt-deg", "2"], False)])
def test_the_paper_is_beside_its_own_settings_alone(options, beside, tmp_path, capsys):
    assert misaligned.main(["--out", str(tmp_path), "--formats", "png", *options]) == 0
    printed = capsys.readouterr().out
    assert ("(paper: 334.2 at 5658 × 13)" in printed) == ("paper's" in printed) == beside
    assert bool(re.search("paper(:|'s)", printed)) == beside
    for name in ("table_3.md", "table_3.tex", "summary.json"):
        assert ("paper" in (tmp_path / name).read_text(encoding="utf-8").lower()) == beside, name


def test_figures_show_what_their_captions_say(study):
    figure, magnitudes = (study_report.figure(study, name) for name in ("figure_2", "figure_3"))
    assert figure.get_figwidth() == SHEET.column and len(figure.axes) == 6
    truth, half = study.recording.noise_free.wrench("ground").values, 25 // 2
    curves = {"True": truth} | {name: study.fit(name.lower()).predicted for name in ("Simplified", "Full")}
    for component, (ax, below) in enumerate(zip(figure.axes, magnitudes.axes, strict=True)):
        # Panels run row by row, components column by column.
        k = component // 2 + 3 * (component % 2)
        lines, errors = ({line.get_label(): line for line in each.get_lines()} for each in (ax, below))
        colors = {name: line.get_color() for name, line in lines.items()}
        assert colors == {"True": "black", "Simplified": "C1", "Full": "C0"}
        for name, curve in curves.items():
            np.testing.assert_array_equal(lines[name].get_xydata().T, [study.recording.time, curve[:, k]])
        # Samples of the two models are opaque and alternate, so that neither hides the other.
        for first, name in enumerate(("Simplified", "Full")):
            expected = abs(curves[name] - truth)[:, k]
            dots, mean = errors[name], errors[f"{name}, running RMS"]
            np.testing.assert_array_equal(dots.get_xydata().T, [np.arange(943)[first::2] + 1, expected[first::2]])
            for at, window in ((500, slice(500 - half, 501 + half)), (0, slice(half + 1))):
                assert mean.get_ydata()[at] == pytest.approx(np.sqrt((expected[window] ** 2).mean()))


def test_axes_that_are_searched_for_give_the_full_model_from_the_simplified_one(study):
    """Without their poses, and as well as with axes recovered from these."""
    searched, recovered = study.trajectory("searched"), study.trajectory("full_on_table")
    np.testing.assert_allclose(searched.psi_true, recovered.psi_true, atol=0.01)
    assert abs(searched.error).max() < 0.02 and (abs(searched.error) < INTERVAL * searched.std).all()
    assert (recovered.std < 1.01 * searched.std).all() and (searched.std < 2.2 * recovered.std).all()
    assert study.fit("searched").estimate.rows == paper.SHAPE_FULL[0]
    np.testing.assert_allclose(wrench_error(study, "searched"), wrench_error(study, "full"), atol=0.02)


def test_tilts_are_found_within_their_intervals(results, study):
    rows = rows_of(results / "table_tilts.csv")
    assert [row["tilt"] for row in rows] == [f"joint{k} about {axis}" for k in (1, 2) for axis in "yz"]
    azimuth = np.radians(120)
    for row, true in zip(rows, 2 * [-5 * np.sin(azimuth), 5 * np.cos(azimuth)], strict=True):
        assert float(row["true_deg"]) == pytest.approx(true)
        for model in ("full", "searched"):
            tilt, std = (float(row[f"{name}_{model}_deg"]) for name in ("tilt", "std"))
            assert abs(tilt - true) < INTERVAL * std and 0.01 < std < 0.03
    assert study.axis_error(study.estimated_axes("searched")).max() < np.radians(0.05)


def test_tilts_that_explain_nothing_alone_are_found_together_whatever_bodies_the_model_has():
    """With little noise neither axis turns much about z while the other one does not.

    No base parameter of the simplified model is one of the full model, which needs what no channel showed.
    """
    study = packaged_study("misaligned", noise_scale=0.03, samples=400)
    assert study.axis_error(study.estimated_axes("searched")).max() < np.radians(0.02)
    searched = study.trajectory("searched")
    assert (abs(searched.error) < 3 * searched.std).all()
    lighter = replace(study.known, prior=study.known.known * np.repeat([1.2, 0.7, 0.9], 10))
    other = SimulatedStudy(replace(study.problem, known=lighter), study.recording).trajectory("searched")
    assert (abs(other.psi - searched.psi) < 0.2 * searched.std).all()
    np.testing.assert_allclose(other.std, searched.std, rtol=0.05)


def test_a_tilt_that_is_left_as_drawn_is_empty_and_wrong_axes_are_called_that(study, monkeypatch):
    axes = study.estimated_axes("searched")
    first, last = axes.separate
    left = replace(axes, separate=(replace(first, influence=0 * first.influence), last))
    monkeypatch.setitem(vars(study), "searched", left)
    rows = list(tilts(study, ["searched"]).values())
    assert {row[f"{name}_searched_deg"] for row in rows[:2] for name in ("tilt", "std")} == {None}
    assert min(row["std_searched_deg"] for row in rows[2:]) > 0.01
    for tree, wrong in ((axes.tree, False), (study.known.tree, True)):
        monkeypatch.setitem(vars(study), "searched", replace(axes, tree=tree))
        (sentence,) = (line for line in study_report.lines(study) if line.startswith("Axes found"))
        assert sentence.endswith(", which does not cover that: these are not the true axes") == wrong, sentence
