"""Trials of a study: what they redraw, how they end and are resumed, and their statistics."""

import os
import signal
from functools import partial

import numpy as np
import pytest
from commands import rows_of
from trial_runs import Mortal, draw, interrupted, kept, run

from experiments import multicontact
from experiments.data import paper
from experiments.data.fitting import Distribution
from experiments.data.simulated_study import StudyProblem
from experiments.reports import paper_report
from experiments.runs import workers
from experiments.studies import simulation
from experiments.studies.simulation import study, trial
from experiments.studies.study_entries import packaged


@pytest.mark.parametrize("redrawn", paper.REDRAWN)
def test_trials_differ_by_the_noise_that_is_redrawn(tmp_path, redrawn):
    source = draw(tmp_path, "--redraw", redrawn)
    a, b, again = source.recordings([0, 1, 0])
    assert (a["ground_force"] != b["ground_force"]).all()
    np.testing.assert_array_equal(a["ground_force"], again["ground_force"])
    assert (a["joint1_position"] != b["joint1_position"]).any() == (redrawn != "wrench")
    (other,) = draw(tmp_path, "--redraw", redrawn, "--seed", "1").recordings([0])
    assert (a["ground_force"] - a.true["ground_force"] != other["ground_force"] - other.true["ground_force"]).all()
    assert (a.true["joint1_position"] != b.true["joint1_position"]).any() == (redrawn == "all")


@pytest.mark.slow
@pytest.mark.skipif(os.name != "posix", reason="signals to process groups are POSIX")
def test_a_request_to_end_ends_all_processes_without_a_traceback(tmp_path):
    command = ["--samples", "100", "--trials", "100000", "--redraw", "sensors", "--workers", "2", "--formats", "png"]
    code, output = interrupted([*command, "--out", str(tmp_path)], rb" [1-9]\d*/100000", signal.SIGTERM)
    # The second request ends the process at once if the first has been obeyed before it comes.
    assert code in (130, -signal.SIGTERM), output.decode()
    assert b"Traceback" not in output and b"resource_tracker" not in output, output.decode()
    assert b"every file is whole" in output and b"run again with --resume" in output
    assert (tmp_path / simulation.FILE).exists()


@pytest.mark.slow
def test_a_dead_worker_is_one_sentence_and_costs_no_trials(tmp_path, capsys):
    source = draw(tmp_path, "--redraw", "sensors", samples="100")
    whole = run(source, 24, tmp_path, file="whole.npz")
    (fatal,) = source.recordings([15])
    mortal = Mortal(fatal["ground_force"][0, 0], tmp_path / "died")
    with pytest.raises(ValueError, match="A worker process died, perhaps for want of memory; use fewer --workers"):
        run(source, 24, tmp_path, analyse=mortal, given=workers.Workers(2))
    assert "The trials done so far are in" in capsys.readouterr().err
    # At most those of its batch and of the other worker are lost.
    done = [k for k, outcome in enumerate(kept(tmp_path)) if outcome]
    assert 8 <= len(done) <= 20 and {14, 15}.isdisjoint(done)
    np.testing.assert_array_equal([kept(tmp_path)[k] for k in done], whole[done])
    np.testing.assert_array_equal(run(source, 24, tmp_path, given=workers.Workers(resume=True)), whole)


def distribution(outcomes):
    names = study("multicontact", samples=200).fit("contact").base.names
    return Distribution(names, outcomes[:, 0, 0], outcomes[:, 0, 1], np.zeros(13))


@pytest.mark.slow
@pytest.mark.parametrize(
    ("contact", "samples", "trials", "off"), [("pad", "100", 500, 0.02), ("pad handle", "300", 250, 0.04)]
)
def test_predicted_standard_deviations_are_right_for_wrench_noise(tmp_path, contact, samples, trials, off):
    """A number n of trials determines a standard deviation to 1 / sqrt(2 n), and a coverage to 1 % or 1.4 %."""
    source = draw(tmp_path, "--redraw", "wrench", samples=samples, contact=contact)
    analyse = partial(trial, StudyProblem.of(packaged("multicontact", contact=contact)), ("contact",))
    errors_of = distribution(run(source, trials, tmp_path, analyse=analyse))
    np.testing.assert_allclose(errors_of.std / errors_of.predicted_std, 1, atol=3.15 / np.sqrt(2 * trials))
    assert (abs(errors_of.coverage - 0.95) <= off).all()
    assert abs(errors_of.coverage.mean() - 0.95) <= 0.02
    assert (np.abs(errors_of.mean) < 4.5 * errors_of.std / np.sqrt(trials)).all()


def test_noise_on_the_joint_states_biases(tmp_path):
    errors_of = distribution(run(draw(tmp_path, "--redraw", "sensors", samples="943"), 30, tmp_path))
    assert np.abs(errors_of.mean / errors_of.std).max() * np.sqrt(30) > 6


def test_statistics(tmp_path):
    errors = np.array([[-1.0, 0.0], [0.0, 1.0], [1.0, 2.0], [2.0, 3.0]])
    errors_of = Distribution(("a", "b"), errors, np.full((4, 2), 1.0), np.array([0.5, 9.0]))
    np.testing.assert_array_equal(errors_of.percentile, [[50, 100], [50, 100]])
    np.testing.assert_array_equal([errors_of.mean, errors_of.coverage], [[0.5, 1.5], [0.75, 0.5]])
    (tmp_path / "table.csv").write_text(paper_report.trials_table("m", errors_of).csv(), encoding="utf-8")
    low, high = np.percentile(errors[:, 1], [2.5, 97.5])
    numbers = {"mean_error": 1.5, "std": np.std(errors[:, 1], ddof=1), "low_95": low, "high_95": high}
    numbers |= {"predicted_std": 1.0, "coverage_95": 0.5, "paper_error": 9.0, "paper_percentile": "100 to 100"}
    row = rows_of(tmp_path / "table.csv")[1]
    assert row == {"parameter": "b"} | {key: str(x) for key, x in numbers.items()}


@pytest.mark.usefixtures("undrawn", "no_trajectory", "here")
def test_trajectory_trials_are_resumed_as_well(tmp_path, monkeypatch):
    """With least squares in place of the trajectory estimate, so that its trials are the first of the others."""
    done = []

    def quick(problem, model, recording):
        done.append(model)
        if len(done) == 4:
            raise KeyboardInterrupt
        return trial(problem, [model], recording)

    monkeypatch.setattr(simulation, "trajectory_trial", quick)
    command = ["--out", str(tmp_path), "--formats", "none", "--samples", "200", "--redraw", "sensors", "--trials", "8"]
    assert multicontact.main([*command, "--trajectory-trials", "6"]) == 130
    assert not (tmp_path / "monte_carlo.json").exists()
    assert multicontact.main([*command, "--trajectory-trials", "6", "--resume"]) == 0
    np.testing.assert_array_equal(kept(tmp_path, simulation.TRAJECTORY_FILE), kept(tmp_path)[:6])
    # A run that ends before its trajectory trials does not leave those of the previous run to be resumed.
    assert multicontact.main([*command, "--seed", "1", "--trajectory-trials", "0"]) == 0
    assert multicontact.main([*command, "--seed", "1", "--trajectory-trials", "3", "--resume"]) == 0
    np.testing.assert_array_equal(kept(tmp_path, simulation.TRAJECTORY_FILE), kept(tmp_path)[:3])
