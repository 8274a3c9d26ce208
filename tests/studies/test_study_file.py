"""Study files: all entries take effect, and unknown ones are errors; sweeps over the values of an option."""

import copy
import csv
import functools
import json
import re
import tomllib
from importlib.resources import files

import numpy as np
import pytest
from commands import refusal

import scenes
from experiments import study
from experiments.data.simulated_study import summary
from experiments.studies import study_entries
from experiments.studies.simulation import simulated
from ident.errors import InputError
from sim.motion.excitation import DOUBLE_PENDULUM

OWN = """
title = "Mine"
excitation = "double_pendulum"
[scene]
model = "double_pendulum"
base = "base"
tilt_deg = 3.0
contacts = ["pad"]
[recording]
samples = 300
seed = 5
[recording.noise]
ground_force = 0.01
[models]
drawn = { estimators = ["ordinary", "weighted"] }
known = { axes = "true", parameters = "drawn", ignore = "all" }
[published.error.drawn]
m1 = 0.5
[tables.table_mine]
caption = "Mine"
decimals = 2
groups = [{ model = "drawn", as = "", show = ["true", "error", "paper_error", "error_weighted", "regrouping"] }]
[figures.figure_mine]
kind = "residuals"
curves = { "Drawn" = "drawn", "Known" = "known" }
"""


def written(folder, text):
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("name", study_entries.PACKAGED)
def test_the_studies_of_the_package_are_whole(name):
    file = study_entries.packaged(name)
    assert set(file.trials.values()) <= set(file.models)
    assert file.options["samples"] == 943 and file.options["noise_scale"] == 1
    assert len([*file.tables, *file.figures]) >= 4


def test_options_go_before_the_file():
    file = study_entries.packaged("multicontact", contact="handle", seed=4)
    assert (file.seed, dict(file.scene.contacts)) == (4, {"handle": "contact"})
    assert file.ignored("ignoring") == ("handle",) and file.ignored("contact") == ()
    assert study_entries.packaged("multicontact", contact="handle pad").title.startswith("Several")
    with pytest.raises(InputError, match="no option 'tilt_deg'; it has seed, samples, contact, noise_scale"):
        study_entries.packaged("multicontact", tilt_deg=1.0)


@pytest.mark.usefixtures("undrawn")
def test_a_file_of_ones_own_says_everything(tmp_path, capsys):
    path = written(tmp_path, OWN)
    command = [str(path), "--out", str(tmp_path / "out"), "--formats", "pdf"]
    assert study.main(command) == 0
    out, file = tmp_path / "out", study_entries.read(path)
    own = simulated(file)
    assert np.std(own.recording["ground_force"] - own.recording.true["ground_force"]) == pytest.approx(0.01, rel=0.1)
    with (out / "table_mine.csv").open(encoding="utf-8") as stream:
        rows = list(csv.DictReader(stream))
    np.testing.assert_array_equal([float(row["error"]) for row in rows], own.fit("drawn").error)
    np.testing.assert_array_equal([float(row["error_weighted"]) for row in rows], own.fit("drawn", "weighted").error)
    assert [row["paper_error"] for row in rows] == ["0.5", *[""] * 12] and rows[4]["body"] == "link1"
    tex = (out / "table_mine.tex").read_text()
    assert "Mine" in tex and "link2" in tex and "link1" in tex
    origin = json.loads((out / "provenance.json").read_text())
    assert origin["study"]["file"] == "mine.toml" and origin["options"]["tilt_deg"] == 3
    summary = json.loads((out / "summary.json").read_text())
    assert summary["largest_error_known"] == abs(own.fit("known").error).max()
    assert summary["contact_fraction"] == own.touching["pad"].mean()
    assert "drawn model" in capsys.readouterr().out


def test_axes_and_contacts_are_what_a_model_knows(tmp_path):
    file = study_entries.read(written(tmp_path, OWN.replace('ignore = "all"', 'title = "x"')))
    exact = simulated(file.with_options(noise_scale=0.0))
    assert abs(exact.fit("known").error).max() < 1e-6 < 0.1 < abs(exact.fit("drawn").error).max()


def test_a_model_of_ones_own_moves_as_the_packages_does(tmp_path):
    spec = scenes.load("double_pendulum", contact="pad")
    spec.compile()
    (tmp_path / "own.xml").write_text(spec.to_xml())
    excitation = {key: np.asarray(x).tolist() for key, x in vars(DOUBLE_PENDULUM).items()}
    named = '"double_pendulum"\n[scene]\nmodel = "double_pendulum"'
    text = OWN.replace(named, f'{{ {toml(excitation)} }}\n[scene]\nmodel = "own.xml"')
    text = text.replace('contacts = ["pad"]', 'contacts = { pad = "contact" }')
    own, theirs = (simulated(study_entries.read(written(tmp_path, each))) for each in (text, OWN))
    np.testing.assert_allclose(own.fit("drawn").error, theirs.fit("drawn").error, rtol=1e-4, atol=1e-5)


def toml(values):
    return ", ".join(f"{key} = {value}" for key, value in values.items())


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('title = "Mine"', 'titel = "x"', "the study has no entry 'titel'; valid are excitation, figures"),
        ("tilt_deg", "tilt", r"\[scene\] has no entry 'tilt'; valid are model, base, tilt_deg"),
        ('model = "double_pendulum"', 'model = "crane"', r"needs one of double_pendulum, bowing, humanoid, arm; got"),
        ('model = "double_pendulum"', 'model = "arm.xml"', "scene.model 'arm.xml' does not exist"),
        ('["pad"]', '["wall"]', "scene.contacts needs one of pad, handle; got wall"),
        ('ignore = "all"', 'ignore = ["all"]', 'models.known.ignore needs "all" as a text, not in a list'),
        ("samples = 300", "samples = 1.5", "recording.samples needs a whole number of at least 1, got 1.5"),
        ("ground_force", "force", "The scene has no sensor 'force' to be noisy; it has ground_force"),
        ('axes = "true"', 'axes = "guessed"', "axes needs one of drawn, recovered, true, searched; got guessed"),
        ('"weighted"]', '"best"]', "models.drawn.estimators needs one of ordinary, weighted, trajectory; got best"),
        ('["ordinary", "weighted"]', '["weighted", "weighted"]', "needs different estimators, got weighted, w"),
        ('["ordinary", "weighted"]', '"weighted"', "a list of entries, each one of ordinary, weighted, trajectory"),
        ("groups = [", "groups = 3 #", "tables.table_mine.groups needs a list of tables, got 3"),
        ('parameters = "drawn"', 'parameters = "known"', "models.known.parameters needs one of drawn, got known"),
        ('"true", "error"', '"truth"', "groups.show needs one of true, true_scene"),
        ('["ordinary", "weighted"]', '["ordinary"]', "shows error_weighted, but drawn has no estimator 'weighted'"),
        ('"residuals"', '"residual"', "figures.figure_mine.kind needs one of wrenches, wrench errors, residuals"),
        ('"Known" = "known"', '"Known" = "other"', "curves.Known needs one of drawn, known; got other"),
        ("drawn = {", "True = {", "models.True needs another name: curves of wrenches call true, measured, ground"),
        ("tables.table_mine", "tables.mine", "tables.mine: names of files here begin with table_"),
        ('"double_pendulum"\n[scene]', '"wild"\n[scene]', "excitation needs one of double_pendulum, bowing; got wild"),
        ("[models]", "[models", "a study needs to be TOML in UTF-8"),
        ("m1 = 0.5", 'm1 = "a"', "published.error.drawn.m1 needs a number"),
    ],
)
def test_what_nobody_would_read_is_refused_in_one_sentence(tmp_path, capsys, old, new, message):
    assert old in OWN
    path = written(tmp_path, OWN.replace(old, new, 1))
    error = refusal(study.main, [str(path), "--out", str(tmp_path / "out")], capsys)
    assert error.count("\n") == 1
    assert re.search(message, error)


def places(entries, path=()):
    """Paths of all entries, tables and leaves."""
    for key, value in entries.items() if isinstance(entries, dict) else enumerate(entries):
        yield (*path, key)
        if isinstance(value, dict | list):
            yield from places(value, (*path, key))


@pytest.mark.parametrize("text", [OWN, "several_contacts"])
def test_whatever_stands_in_a_file_is_understood_or_refused(text, tmp_path):
    folder = files("experiments.studies")
    whole = tomllib.loads(text if text == OWN else folder.joinpath(f"{text}.toml").read_text(encoding="utf-8"))
    refused = 0
    for path in places(whole):
        for wrong in (-1, 2.5, float("nan"), "x", True, [], ["x"], [[1]], {}, {"x": 1}, None):
            entries = copy.deepcopy(whole)
            place = functools.reduce(lambda entry, key: entry[key], path[:-1], entries)
            if wrong is None:
                del place[path[-1]]
            else:
                place[path[-1]] = wrong
            try:
                study_entries.from_entries(entries, tmp_path)
            except InputError:
                refused += 1
    assert refused > 400


def test_trials_need_models(capsys, tmp_path):
    path = str(written(tmp_path, OWN))
    assert "--trials needs [trials]" in refusal(study.main, [path, "--trials", "2", "--out", str(tmp_path)], capsys)


def rows_of(out, number):
    table = csv.DictReader((out / "table_sweep.csv").read_text().splitlines())
    return [row for row in table if row["number"] == number]


SWEEP = """
scene = { model = "double_pendulum" }
recording = { samples = 100 }
models = { one = {} }
sweep = { option = "noise_scale", values = [0, 1, 2000], seeds = 2 }
"""


@pytest.mark.usefixtures("undrawn", "here")
def test_a_study_file_states_a_sweep(tmp_path, capsys):
    """It is the study with every value and seed; a refused value is a sentence, and the others are there."""
    own, out = tmp_path / "own.toml", tmp_path / "out"
    own.write_text(SWEEP, encoding="utf-8")
    assert study.main([str(own), "--formats", "none", "--out", str(out)]) == 0
    sentence = "noise_scale 2000.0, seed 0: The noise scale must be from 0 to 1000, got 2000.0."
    printed = capsys.readouterr()
    assert f"Refused: {sentence}\n" in printed.err and "\ncondition number, one " in printed.out
    assert (out / "summary.json").exists()
    results = json.loads((out / "sweep.json").read_text())["runs"]
    assert [(run["noise_scale"], run["seed"]) for run in results] == [(x, s) for s in (0, 1) for x in (0, 1, 2000)]
    assert results[2] == {"noise_scale": 2000, "seed": 0, "refused": sentence}
    fresh = summary(simulated(study_entries.read(own).with_options(noise_scale=1.0, seed=1)))
    for key in ("condition_number_one", "rank_one", "largest_error_one", "noise"):
        assert results[4][key] == pytest.approx(fresh[key], rel=1e-9, abs=1e-9), key
    exact, noisy, refused = rows_of(out, "largest_error_one")
    errors = [run["largest_error_one"] for run in results if run["noise_scale"] == 1]
    assert (noisy["noise_scale"], noisy["runs"], refused["runs"], refused["mean"]) == ("1.0", "2", "0", "")
    assert float(noisy["mean"]) == np.mean(errors)
    assert float(noisy["std"]) == pytest.approx(np.std(errors, ddof=1))
    assert [row["mean"] for row in rows_of(out, "rank_one")] == ["13", "13", ""], "counts have no decimals"
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
    text = SWEEP.replace("[0, 1, 2000]", "[0, 2.5]").replace(old, new)
    (tmp_path / "own.toml").write_text(text, encoding="utf-8")
    assert message in refusal(study.main, [str(tmp_path / "own.toml"), "--out", str(tmp_path / "out")], capsys)
    assert not (tmp_path / "out").exists(), "before anything runs or is written"
