"""Words for the samples that a fit is judged by."""

import re

import driven_arm
import pytest

import ident
from experiments import identify

OPTIONS = ["--estimator", "weighted", "--cutoff", "8", "--formats", "png", "--out", "out", "--name", "x"]


@pytest.mark.parametrize(("holdout", "there"), [("0", False), ("0.4", True)])
def test_samples_that_were_fitted_are_not_called_held_out(tmp_path, capsys, monkeypatch, holdout, there):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "arm.xml").write_text(driven_arm.text(), encoding="utf-8")
    driven_arm.log(4.0, 50.0).save(tmp_path / "log.csv")
    assert identify.main(["arm.xml", "log.csv", *OPTIONS, "--holdout", holdout]) == 0
    shown = capsys.readouterr().out
    for file in ("report.html", "estimate.json", "table_held_out.md", "table_held_out.tex"):
        shown += (tmp_path / "out" / "x" / file).read_text(encoding="utf-8")
    assert bool(re.search("held[- ]out", shown, re.IGNORECASE)) is there
    assert ("Usable to predict joint torques: fitted residuals" in shown) is not there


@pytest.mark.slow
def test_an_estimate_says_by_what_it_is_judged():
    arm, logs = driven_arm.mechanism(), [driven_arm.log(4.0, 50.0, seed=seed) for seed in range(3)]
    for part, holdout in {"fitted": 0.0, "held-out": 0.4}.items():
        estimate = ident.identify(arm, logs[0], holdout=holdout, known=True)
        assert estimate.held_out.part == estimate.verdict().part == part
    assert ident.identify(arm, logs[0], held_out=logs[1], holdout=0.0, known=True).held_out.part == "held-out"


@pytest.mark.slow
def test_recordings_that_are_each_predicted_from_the_others_are_held_out():
    arm, logs = driven_arm.mechanism(), [driven_arm.log(3.0, 50.0, seed=seed) for seed in range(3)]
    estimate = ident.identify(arm, logs, setup=dict.fromkeys(("delay", "scale"), 0.0), known=True)
    assert estimate.held_out.left_out and estimate.held_out.part == "held-out"
    weighted = ident.identify(arm, logs, estimator="weighted", cutoff=8.0, holdout=0.0)
    assert not weighted.held_out.left_out
