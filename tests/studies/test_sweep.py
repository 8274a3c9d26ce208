"""Sweeps over the values of an option of a study file."""

import csv
import json

import numpy as np
import pytest
from commands import refusal

from experiments import study
from experiments.data.simulated_study import summary
from experiments.studies import study_entries
from experiments.studies.simulation import simulated


def rows(out, number):
    table = csv.DictReader((out / "table_sweep.csv").read_text().splitlines())
    return [row for row in table if row["number"] == number]


OWN = """
scene = { model = "double_pendulum" }
recording = { samples = 100 }
models = { one = {} }
sweep = { option = "noise_scale", values = [0, 1, 2000], seeds = 2 }
"""


@pytest.mark.usefixtures("undrawn", "here")
def test_a_study_file_states_a_sweep(tmp_path, capsys):
    """It is the study with every value and seed; a refused value is a sentence, and the others are there."""
    own, out = tmp_path / "own.toml", tmp_path / "out"
    own.write_text(OWN, encoding="utf-8")
    assert study.main([str(own), "--formats", "none", "--out", str(out)]) == 0
    sentence = "noise_scale 2000.0, seed 0: The noise scale must be from 0 to 1000, got 2000.0."
    assert f"Refused: {sentence}\n" in capsys.readouterr().err and (out / "summary.json").exists()
    results = json.loads((out / "sweep.json").read_text())["runs"]
    assert [(run["noise_scale"], run["seed"]) for run in results] == [(x, s) for s in (0, 1) for x in (0, 1, 2000)]
    assert results[2] == {"noise_scale": 2000, "seed": 0, "refused": sentence}
    fresh = summary(simulated(study_entries.read(own).with_options(noise_scale=1.0, seed=1)))
    for key in ("condition_number_one", "rank_one", "largest_error_one", "noise"):
        assert results[4][key] == pytest.approx(fresh[key], rel=1e-9, abs=1e-9), key
    exact, noisy, refused = rows(out, "largest_error_one")
    errors = [run["largest_error_one"] for run in results if run["noise_scale"] == 1]
    assert (noisy["noise_scale"], noisy["runs"], refused["runs"], refused["mean"]) == ("1.0", "2", "0", "")
    assert float(noisy["mean"]) == np.mean(errors)
    assert float(noisy["std"]) == pytest.approx(np.std(errors, ddof=1))
    assert [row["mean"] for row in rows(out, "rank_one")] == ["13", "13", ""], "counts have no decimals"
    assert float(exact["mean"]) < 1e-3 * float(noisy["mean"])


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('option = "noise_scale"', 'option = "tilt_deg"', "sweep.option needs one of samples, noise_scale"),
        ('option = "noise_scale"', 'option = "samples"', "sweep.values needs a whole number of at least 1, got 0"),
        ("[0, 2.5]", "[0, -5]", "sweep.values needs a number of at least 0, got -5"),
        ("seeds = 2", "seeds = 0", "sweep.seeds needs a whole number of at least 1, got 0"),
        ("seeds = 2", "more = 1", "[sweep] has no entry 'more'"),
        ("seeds = 2", 'numbers = ["x"]', "sweep.numbers needs names of condition_number_one, rank_one, rows_one"),
    ],
)
def test_wrong_entries_are_refused(tmp_path, capsys, old, new, message):
    text = OWN.replace("[0, 1, 2000]", "[0, 2.5]").replace(old, new)
    (tmp_path / "own.toml").write_text(text, encoding="utf-8")
    assert message in refusal(study.main, [str(tmp_path / "own.toml"), "--out", str(tmp_path / "out")], capsys)
    assert not (tmp_path / "out").exists(), "before anything runs or is written"
