"""Words for the samples that a fit is judged by."""

import re

import driven_arm
import pytest

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
