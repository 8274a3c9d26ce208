import csv
import json

import numpy as np
import pytest
from commands import refusal

from experiments import study as own_study
from experiments.data.simulated_study import summary
from experiments.studies.simulation import study
from experiments.sweep import FORMER, main


def run(tmp_path, *more, over=("noise_scale", "0", "1"), seeds=2):
    command = ["multicontact", "--over", *over, "--seeds", str(seeds), "--formats", "png", "--out", str(tmp_path)]
    assert main([*command, *more]) == 0
    return tmp_path / "multicontact" / over[0]


def rows(out, number):
    table = csv.DictReader((out / "table_sweep.csv").read_text().splitlines())
    return [row for row in table if row["number"] == number]


OWN = """
scene = { model = "double_pendulum" }
recording = { samples = 100 }
models = { one = {} }
sweep = { option = "noise_scale", values = [0, 1], seeds = 2, numbers = ["rank_one"] }
"""


@pytest.mark.usefixtures("undrawn", "here")
def test_a_study_file_states_a_sweep(tmp_path, capsys):
    (tmp_path / "own.toml").write_text(OWN, encoding="utf-8")
    given = [str(tmp_path / "own.toml"), "--formats", "none", "--out", str(tmp_path / "out")]
    assert own_study.main(given) == 0
    (tmp_path / "own.toml").write_text(OWN.replace("[0, 1]", "[0, 1, 2.5]"), encoding="utf-8")
    assert own_study.main([*given, "--trials", "0"]) == 0
    assert [row["noise_scale"] for row in rows(tmp_path / "out", "rank_one")] == ["0.0", "1.0", "2.5"]
    assert (tmp_path / "out" / "summary.json").exists()
    for wrong, message in (
        ('option = "tilt_deg"', "sweep.option needs one of samples, noise_scale"),
        ('option = "samples"', "sweep.values needs a whole number of at least 1, got 0"),
        ("values = [-5]", "sweep.values needs a number of at least 0, got -5"),
        ("seeds = 0", "sweep.seeds needs a whole number of at least 1, got 0"),
        ("more = 1", "[sweep] has no entry 'more'"),
    ):
        text = (tmp_path / "own.toml").read_text(encoding="utf-8")
        key = wrong.partition(" ")[0]
        parts = 'option = "noise_scale"', "values = [0, 1, 2.5]", "seeds = 2"
        found = next((part for part in parts if part.startswith(key)), 'numbers = ["rank_one"]')
        (tmp_path / "wrong.toml").write_text(text.replace(found, wrong), encoding="utf-8")
        assert message in refusal(own_study.main, [str(tmp_path / "wrong.toml"), *given[1:]], capsys)


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_sweep_is_the_study_with_every_value_and_seed(tmp_path):
    out = run(tmp_path, "--workers", "2")
    results = json.loads((out / "sweep.json").read_text())["runs"]
    expected = [
        {
            "noise_scale": scale,
            "seed": seed,
            **summary(study("multicontact", noise_scale=scale, seed=seed)),
        }
        for seed in (0, 1)
        for scale in (0.0, 1.0)
    ]
    for one, other in zip(results, expected, strict=True):
        assert one.keys() == other.keys()
        for key in one:
            assert one[key] == pytest.approx(other[key], rel=1e-9, abs=1e-9), key
    exact, noisy = rows(out, "largest_error")
    errors = [run["largest_error"] for run in results if run["noise_scale"] == 1]
    assert (noisy["noise_scale"], noisy["runs"]) == ("1.0", "2")
    assert float(noisy["mean"]) == np.mean(errors)
    assert float(noisy["std"]) == pytest.approx(np.std(errors, ddof=1))
    assert float(exact["mean"]) < 1e-3 * float(noisy["mean"])
    assert not rows(out, "paper_condition_number")
    assert (out / "figure_sweep.png").exists()


@pytest.mark.usefixtures("undrawn", "here")
@pytest.mark.slow
def test_a_refused_value_is_one_sentence_and_the_others_are_there(tmp_path, capsys):
    out = run(tmp_path, over=("noise_scale", "1", "2000"), seeds=1)
    sentence = "noise_scale 2000.0, seed 0: The noise scale must be from 0 to 1000, got 2000.0."
    printed = capsys.readouterr().err
    assert f"Refused: {sentence}\n" in printed and FORMER in printed
    assert json.loads((out / "sweep.json").read_text())["runs"][1]["refused"] == sentence
    one, refused = rows(out, "rank")
    assert (one["runs"], one["mean"]) == ("1", "13.0")
    assert (refused["runs"], refused["mean"]) == ("0", "")


@pytest.mark.usefixtures("here", "undrawn", "no_trajectory")
@pytest.mark.parametrize(
    ("command", "message"),
    [
        (["pendulum", "--over", "samples", "100"], "invalid choice: 'pendulum'"),
        (["multicontact", "--over", "tilt_deg", "5"], "needs one of samples, contact, noise_scale; got tilt_deg"),
        (
            ["multicontact", "--over", "samples", "100", "many"],
            "needs a whole number of at least 1, got many",
        ),
        (["multicontact", "--over", "samples"], "needs one value or more, all different, got []"),
        (["multicontact", "--over", "noise_scale", "1", "1.0"], "all different, got [1.0, 1.0]"),
        (["multicontact", "--over", "samples", "1"], "refuses every run: samples 1, seed 0: "),
        (
            ["multicontact", "--over", "samples", "100", "--numbers", "x"],
            "sweep.numbers needs names of condition_number",
        ),
        (["multicontact", "--over", "samples", "100", "--resume"], "--resume needs the runs of an earlier run"),
    ],
)
def test_bad_input_is_one_sentence(tmp_path, capsys, command, message):
    assert message in refusal(main, [*command, "--seeds", "1", "--out", str(tmp_path)], capsys)
