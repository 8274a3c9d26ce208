"""Study files: all entries take effect, and unknown ones are errors; sweeps over the values of an option."""

import copy
import functools
import operator
import tomllib

import numpy as np
import pytest
from commands import entries_of, refusal, rows_of

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

SWEEP = """
scene = { model = "double_pendulum" }
recording = { samples = 100 }
models = { one = {} }
sweep = { option = "noise_scale", values = [0, 1, 2000], seeds = 2 }
"""


def written(folder, text):
    path = folder / "mine.toml"
    path.write_text(text, encoding="utf-8")
    return path


def test_the_studies_of_the_package_are_whole_and_options_go_before_their_files():
    for file in map(study_entries.packaged, study_entries.PACKAGED):
        assert set(file.trials.values()) <= set(file.models) and len([*file.tables, *file.figures]) >= 4
        assert file.options["samples"] == 943 and file.options["noise_scale"] == 1
    file = study_entries.packaged("multicontact", contact="handle", seed=4)
    assert (file.seed, dict(file.scene.contacts)) == (4, {"handle": "contact"})
    assert file.ignored("ignoring") == ("handle",) and file.ignored("contact") == ()
    assert study_entries.packaged("multicontact", contact="handle pad").title.startswith("Several")
    with pytest.raises(InputError, match="no option 'tilt_deg'; it has seed, samples, contact, noise_scale"):
        study_entries.packaged("multicontact", tilt_deg=1.0)


@pytest.mark.usefixtures("undrawn")
def test_a_file_of_ones_own_says_everything(tmp_path, capsys):
    path, out = written(tmp_path, OWN), tmp_path / "out"
    command = [str(path), "--out", str(out), "--formats", "pdf"]
    assert study.main(command) == 0
    own = simulated(study_entries.read(path))
    assert np.std(own.recording["ground_force"] - own.recording.true["ground_force"]) == pytest.approx(0.01, rel=0.1)
    rows = rows_of(out / "table_mine.csv")
    np.testing.assert_array_equal([float(row["error"]) for row in rows], own.fit("drawn").error)
    np.testing.assert_array_equal([float(row["error_weighted"]) for row in rows], own.fit("drawn", "weighted").error)
    assert [row["paper_error"] for row in rows] == ["0.5", *[""] * 12] and rows[4]["body"] == "link1"
    tex = (out / "table_mine.tex").read_text()
    assert "Mine" in tex and "link2" in tex and "link1" in tex
    origin, numbers = (entries_of(out / name) for name in ("provenance.json", "summary.json"))
    assert origin["study"]["file"] == "mine.toml" and origin["options"]["tilt_deg"] == 3
    assert numbers["largest_error_known"] == abs(own.fit("known").error).max()
    assert numbers["contact_fraction"] == own.touching["pad"].mean()
    assert "drawn model" in capsys.readouterr().out
    assert "--trials needs [trials]" in refusal(study.main, [*command, "--trials", "2"], capsys)


def test_a_model_of_ones_own_moves_as_the_packages_does_and_axes_and_contacts_are_what_a_model_knows(tmp_path):
    spec = scenes.load("double_pendulum", contact="pad")
    spec.compile()
    (tmp_path / "own.xml").write_text(spec.to_xml())
    excitation = ", ".join(f"{key} = {np.asarray(x).tolist()}" for key, x in vars(DOUBLE_PENDULUM).items())
    text = OWN
    for old, new in (
        ('excitation = "double_pendulum"', f"excitation = {{ {excitation} }}"),
        ('model = "double_pendulum"', 'model = "own.xml"'),
        ('contacts = ["pad"]', 'contacts = { pad = "contact" }'),
    ):
        text = text.replace(old, new)
    own, theirs = (simulated(study_entries.read(written(tmp_path, each))) for each in (text, OWN))
    np.testing.assert_allclose(own.fit("drawn").error, theirs.fit("drawn").error, rtol=1e-4, atol=1e-5)
    file = study_entries.read(written(tmp_path, OWN.replace('ignore = "all"', 'title = "x"')))
    exact = simulated(file.with_options(noise_scale=0.0))
    assert abs(exact.fit("known").error).max() < 1e-6 < 0.1 < abs(exact.fit("drawn").error).max()


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('title = "Mine"', 'titel = "x"', "the study has no entry 'titel'; valid are excitation, figures"),
        ('model = "double_pendulum"', 'model = "crane"', "needs one of double_pendulum, bowing, humanoid, arm; got"),
        ('model = "double_pendulum"', 'model = "arm.xml"', "scene.model 'arm.xml' does not exist"),
        ('ignore = "all"', 'ignore = ["all"]', 'models.known.ignore needs "all" as a text, not in a list'),
        ("samples = 300", "samples = 1.5", "recording.samples needs a whole number of at least 1, got 1.5"),
        ("ground_force", "force", "The scene has no sensor 'force' to be noisy; it has ground_force"),
        ('["ordinary", "weighted"]', '["weighted", "weighted"]', "needs different estimators, got weighted, w"),
        ('["ordinary", "weighted"]', '["ordinary"]', "shows error_weighted, but drawn has no estimator 'weighted'"),
        ("groups = [", "groups = 3 #", "tables.table_mine.groups needs a list of tables, got 3"),
        ('"true", "error"', '"truth"', "groups.show needs one of true, true_scene"),
        ('"Known" = "known"', '"Known" = "other"', "curves.Known needs one of drawn, known; got other"),
        ("drawn = {", "True = {", "models.True needs another name: curves of wrenches call true, measured, ground"),
        ("tables.table_mine", "tables.mine", "tables.mine: names of files here begin with table_"),
        ('option = "noise_scale"', 'option = "tilt_deg"', "sweep.option needs one of samples, noise_scale"),
        ("seeds = 2", 'numbers = ["x"]', "sweep.numbers needs names of condition_number_one, rank_one, rows_one"),
    ],
)
def test_what_nobody_would_read_is_refused_in_one_sentence(tmp_path, capsys, old, new, message):
    text = OWN if old in OWN else SWEEP
    assert old in text
    path = written(tmp_path, text.replace(old, new, 1))
    error = refusal(study.main, [str(path), "--out", str(tmp_path / "out")], capsys)
    assert error.count("\n") == 1 and message in error
    assert not (tmp_path / "out").exists(), "before anything runs or is written"


def places(entries, path=()):
    for key, value in entries.items() if isinstance(entries, dict) else enumerate(entries):
        yield (*path, key)
        if isinstance(value, dict | list):
            yield from places(value, (*path, key))


def test_whatever_stands_in_a_file_is_understood_or_refused(tmp_path):
    whole, refused = tomllib.loads(OWN), 0
    for *path, last in places(whole):
        for wrong in (-1, 2.5, float("nan"), "x", True, [], ["x"], [[1]], {}, {"x": 1}, None):
            entries = copy.deepcopy(whole)
            place = functools.reduce(operator.getitem, path, entries)
            place[last] = wrong
            if wrong is None:
                del place[last]
            try:
                study_entries.from_entries(entries, tmp_path)
            except InputError:
                refused += 1
    assert refused >= 448, refused


@pytest.mark.usefixtures("undrawn", "here")
def test_a_study_file_states_a_sweep(tmp_path, capsys):
    """It is the study with every value and seed; a refused value is a sentence, and the others are there."""
    own, out = written(tmp_path, SWEEP), tmp_path / "out"
    assert study.main([str(own), "--formats", "none", "--out", str(out)]) == 0
    sentence = "noise_scale 2000.0, seed 0: The noise scale must be from 0 to 1000, got 2000.0."
    printed = capsys.readouterr()
    assert f"Refused: {sentence}\n" in printed.err and "\ncondition number, one " in printed.out
    assert (out / "summary.json").exists()
    results, table = entries_of(out / "sweep.json")["runs"], rows_of(out / "table_sweep.csv")
    assert [(run["noise_scale"], run["seed"]) for run in results] == [(x, s) for s in (0, 1) for x in (0, 1, 2000)]
    assert results[2] == {"noise_scale": 2000, "seed": 0, "refused": sentence}
    fresh = summary(simulated(study_entries.read(own).with_options(noise_scale=1.0, seed=1)))
    for key in ("condition_number_one", "rank_one", "largest_error_one", "noise"):
        assert results[4][key] == pytest.approx(fresh[key], rel=1e-9, abs=1e-9), key
    exact, noisy, refused = (row for row in table if row["number"] == "largest_error_one")
    errors = [run["largest_error_one"] for run in results if run["noise_scale"] == 1]
    assert (noisy["noise_scale"], noisy["runs"], refused["runs"], refused["mean"]) == ("1.0", "2", "0", "")
    assert float(noisy["mean"]) == np.mean(errors) and float(exact["mean"]) < 1e-3 * float(noisy["mean"])
    assert float(noisy["std"]) == pytest.approx(np.std(errors, ddof=1))
    assert [row["mean"] for row in table if row["number"] == "rank_one"] == ["13", "13", ""], "counts have no decimals"
