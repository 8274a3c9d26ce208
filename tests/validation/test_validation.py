"""The study and its report on small simulated recordings in the entries' form, and on a real one where it is there."""

import json
import os
import re
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import driven_arm
import numpy as np
import pytest
from commands import refusal
from registered import TEXT, files_of, recorded, written
from stand_ins import Here

from experiments import validate
from experiments.data.validation import CANDIDATES, ESTIMATE, LEAST_SQUARES, MODEL, Entry, Source, StatedValue, inside
from experiments.reports import validation_report as report
from experiments.reports import validation_tables
from experiments.reports.validation_report import numbers
from experiments.runs import workers
from experiments.studies.validation import files, validation_study
from experiments.studies.validation.files import Places
from experiments.studies.validation.validation_study import of_load, trial_name, trials_of
from ident.errors import InputError
from ident.payload import RigidBody
from sim.models.model_mechanism import mechanism
from sim.models.notes import ModelNote

DATA = Path(os.environ.get("MULTICONTACT_DATA", "")) / "dfki_double_pendulum"
MORE = """
alike = [["Fc(turn)", "Fc(lift)"]]
held_out = { lift = 0.02 }
true_files = ["arm.xml"]
truth = [{ name = "Fc(turn)", value = 0.9, std = 0.01, source = "a scale" }]
"""
PUBLISHED = "".join(
    f'[[published]]\nname = "{name}"\nvalue = {value}\nstd = {std}\nsource = "model"\n'
    for name, value, std in (("Fc(turn)", 0.9, 0.01), ("Fc(bend)", 0.4, 0.01), ("Ia(bend)", 0.05, 0.001))
)


@pytest.fixture(scope="module")
def arm(tmp_path_factory):
    data = tmp_path_factory.mktemp("data")
    recorded(data / "arm")
    entries = tmp_path_factory.mktemp("entries")
    text = TEXT.format(files=files_of(data / "arm"), more=PUBLISHED).replace("\n[source]", f"{MORE}\n[source]", 1)
    return data, files.read_entry(written(entries, text))


@pytest.fixture(scope="module")
def result(arm, tmp_path_factory):
    data, entry = arm
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(workers, "Processes", Here)
        return validation_study.study([entry], Places(data), tmp_path_factory.mktemp("out"), workers.Workers())


def test_an_arm_is_identified_as_by_the_command(result):
    (each,) = result
    assert each.channels == driven_arm.JOINTS and set(each.ratios) == set(CANDIDATES)
    assert (each.ratios[ESTIMATE] < 0.1).all() and each.explained.all()
    assert each.outcome == "usable" and each.samples[0] > each.samples[1] > 0
    assert each.seconds > 0 and each.cutoff > 0 and each.unchecked == ()
    value, std, std_setup = each.values["Fc(turn)"]
    assert abs(value - 0.9) < 4 * std_setup and std <= std_setup
    assert len(each.halves) == len([name for name in each.values.names if "(" not in name])
    assert all(len(x) == len(each.values.names) for x in each.rivals.values())
    k = each.values.names.index("Fc(turn)")
    assert each.rivals[MODEL][k] == pytest.approx(0.9)
    assert each.rivals[LEAST_SQUARES][k] == pytest.approx(0.9, rel=0.1)
    published = each.entry.published[0]
    assert each.published_z(published) == pytest.approx((value - 0.9) / np.hypot(std_setup, 0.01))
    assert each.published_z(replace(published, std=float("nan"))) == pytest.approx((value - 0.9) / std_setup)


def read_again(result):
    entries = {name: truth.entry for name, truth in result.truths.items()}
    entries |= {name: each.entry for name, each in result.validations.items()}
    return validation_study.study_of(json.loads(json.dumps(numbers(result))), entries)


def test_known_parameters_come_first(result):
    ((truth,), (own,)) = result.truths.values(), result
    assert truth.names == own.values.names and set(truth.rivals) == {MODEL, LEAST_SQUARES}
    k, (value, std, _) = truth.names.index("Fc(turn)"), own.values["Fc(turn)"]
    assert truth.z[k] == pytest.approx((value - 0.9) / np.hypot(std, 0.01))
    np.testing.assert_allclose(truth.rivals[MODEL], truth.true, atol=1e-12)
    assert inside(truth.z) > 0.8 and truth.significant.sum() > 5
    (first, *_), number = report.lines(result), len(truth.names)
    known = f"Arm: of {number} known parameters"
    median = rf"The median is over the {truth.significant.sum()} whose intervals exclude zero\."
    assert re.fullmatch(rf"{known} [\d.]+ % lie in our 95 % intervals, median error [\d.]+ %\. {median}", first)
    unclear = replace(truth, lower=truth.values - 9e9, upper=truth.values + 9e9)
    first_of_unclear, *_ = report.lines(replace(result, truths={"arm": unclear}))
    assert first_of_unclear == f"{known} 100 % lie in our 95 % intervals."
    shown = report.document(result, {})
    assert shown.headline.word == "Validated" and first.startswith(shown.headline.sentence)
    assert shown.pictures[0].count("<circle") == number
    assert f">{(abs(truth.z) <= 1.96).sum()} of {number}<" in shown.pictures[0]
    assert shown.tables["table_truth"].rows[0][:2] == ("Arm", number)
    np.testing.assert_allclose(read_again(result).truths["arm"].z, truth.z, atol=3e-3)
    # Where intervals are too narrow.
    z = np.array([0.1] * 80 + [3.0] * 20)
    assert report.headline(z, "").outcome == "not" and report.headline(z[:81], "").outcome == "usable"


def test_other_software_stands_beside_the_estimate(result):
    (each,) = result
    fast = {"ratios": each.ratios[ESTIMATE] * [0.9, 1.2, 2], "seconds": 11.3}
    peers = {"fast": fast, "absent": "It needs a thing."}
    beside = replace(result, validations={"arm": replace(each, peers=peers)})
    shown, table = report.lines(beside), report.document(beside, {}).tables["table_peers"]
    assert "Beside fast, the estimate predicts worse in 1 of 3 channels of 1 recording." in shown
    assert "No comparison with absent. It needs a thing." in shown
    assert [row[1] for row in table.rows] == ["trajectory estimate", "fast", "absent"]
    assert table.rows[1][4:] == (1, 11.3, None) and table.rows[2][-1] == "It needs a thing."
    assert [row[5] for row in table.texts()][1:] == ["11", ""]
    assert read_again(beside).validations["arm"].peers["absent"] == "It needs a thing."


def test_the_report_has_all_tables_and_figures(result):
    document, (each,) = report.document(result, {}), result
    assert set(document.figures) == {"figure_validation", "figure_held_out", "figure_published"}
    tables = ("truth", "recordings", "held_out", "published", "agreement", "was_published")
    assert set(document.tables) - {"table_outside"} == {f"table_{name}" for name in tables}
    moving, resting = (document.tables["table_held_out"].rows[k::2] for k in range(2))
    assert [row[1] for row in moving] == [row[1].removesuffix(", at rest") for row in resting] == [*driven_arm.JOINTS]
    assert [row[5] for row in moving] == [None, 0.02, None]
    assert [row[4] for row in resting] == each.at_rest[ESTIMATE].tolist()
    assert {row[5:] for row in resting} == {(None, "not judged")}
    text = " ".join(document.text().split())
    assert "of 1 pairs of parameters that are equal by construction 0 differ by at most 1.96 s.d." in text
    # Its verdict is a word of the table, and a sentence that is folded.
    assert document.tables["table_recordings"].rows[0][3] == "usable" and "Usable to predict" not in text
    assert document.folded["Verdicts in words"][0].startswith("Arm: Usable to predict ")


def test_where_it_loses_it_says_so(result):
    (each,) = result
    usual = each.ratios[LEAST_SQUARES]

    def study(*factors):
        ratios = {LEAST_SQUARES: usual, ESTIMATE: usual * np.array(factors), MODEL: 5 * usual}
        return replace(result, validations={"arm": replace(each, ratios=ratios)})

    worse, good = study(0.9, 1.04, 1.5), study(0.9, 1.0, 1.05)
    _, first, *others = report.lines(worse)
    assert first.startswith("In 1 of 3 channels") and "in 1 it is worse by at most 5 %" in first
    assert first.endswith("in 1 by more.")
    assert "Another candidate predicts better by more than 5 % in 1 of 3 channels: Arm (1 of 3)." in others
    ((channel, own, other, best),) = next(iter(worse)).losses
    assert (channel, other) == ("bend", LEAST_SQUARES) and own == pytest.approx(1.5 * best)
    assert validation_tables.table_worse(worse).rows == (("Arm", channel, own, "least squares", best, "50 %"),)
    notes = [row[-1] for row in validation_tables.table_held_out(worse).rows[::2]]
    assert notes == ["best", "as good", "worse by 50 %"]
    table = validation_tables.table_recordings(worse)
    row = dict(zip(table.columns, table.rows[0], strict=True))
    assert (row["channels"], row["best"], row["worse"]) == (3, 1, 1)
    assert not validation_tables.table_worse(good).rows
    assert not any("Another candidate" in line for line in report.lines(good))


def test_a_recording_that_cannot_be_identified_is_named_and_the_others_are_shown(arm, result, tmp_path):
    data, entry = arm
    other = replace(entry, name="other")
    untried = replace(entry, name="untried", title="Panda", tried=False)
    tasks = validation_study.tasks_of([entry, other], {"arm": data, "other": data})
    trials = [(name, ((f"{log}.csv",),)) for name in ("arm", "other") for log in ("one", "two")]
    assert [(task.entry.name, task.trial) for task in tasks] == [("arm", None), ("other", None), *trials]
    several = replace(entry, fitted=tuple((name,) for name in "abcd"), judged=(("e",),))
    assert [trial_name(trial) for trial in trials_of(several)] == ["a, c, e", "b, d"]
    assert trials_of(replace(entry, fitted=(("a",),))) == []
    (each,) = result
    good, bad = numbers(result)["recordings"]["arm"], {"refused": "No excitation."}
    made = validation_study.collected([entry, other, untried], tasks[:3], [good, bad, bad], {"untried": "Not here."})
    assert list(made.validations) == ["arm"] and made.untried == (untried,)
    np.testing.assert_allclose(next(iter(made)).values.values, each.values.values, rtol=1e-5)
    shown = report.lines(made)
    assert "Not run: other: No excitation." in shown and "Not run: arm: one: No excitation." in shown
    assert "In the registry, but never tried: Panda." in shown
    with pytest.raises(InputError, match="No excitation"):
        validation_study.collected([other], tasks[1:2], [bad])


def test_the_command_asks_for_recordings(tmp_path, capsys, monkeypatch):
    monkeypatch.delenv(validate.VARIABLE, raising=False)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    for given, message in {
        "": "--fetch downloads",
        f"--data {tmp_path}/no": "needs a folder that exists",
        "nobody --fetch": "Recordings are bow",
        f"bow --data {tmp_path}": "has no three_link_human.xml",
    }.items():
        assert message in refusal(validate.main, [*given.split(), "--out", str(tmp_path / "out")], capsys)
    assert not (tmp_path / "out").exists()


def test_an_untried_recording_is_not_run_although_its_files_are_there(tmp_path, capsys, monkeypatch):
    """Not even one that says what would be fitted, and neither from a folder nor from a server."""
    name, entry = next((name, entry) for name, entry in files.registry().items() if not entry.tried and entry.fitted)
    (tmp_path / entry.folder).mkdir()
    for file in entry.files:
        (tmp_path / entry.folder / file.name).write_bytes(b"something")
    monkeypatch.setattr(validation_study, "work", None)
    sentence = f"{name} is untried and is not run: the registry holds no hash, so that nothing says which files"
    for more in (["--data", str(tmp_path)], ["--fetch"]):
        assert sentence in refusal(validate.main, [name, "--out", str(tmp_path / "out"), *more], capsys)


@pytest.mark.slow
@pytest.mark.skipif(not (DATA.parent / "tools").is_dir(), reason="MULTICONTACT_DATA has no tools")
def test_bodies_alone_on_a_sensor_are_compared_with_their_own_files():
    entry = files.registry()["tools"]
    entry = replace(entry, fitted=entry.fitted[3:4], true_files=entry.true_files[3:4])
    task = validation_study.Task(entry, DATA.parent / "tools")
    made = validation_study.collected([entry], [task], [validation_study.work(task)])
    assert list(made.truths) == ["tools 0.05 N", "tools 0.1 N", "tools 0.2 N"]
    low, usual, high = made.truths.values()
    assert (low.upper - low.lower < high.upper - high.lower).all() and inside(made.truth_z) > 0.9
    assert usual.names[:2] == ("hammer mass", "hammer x") and inside(usual.z) == 1
    assert abs(usual.errors(usual.values)[0]) < 0.01 and usual.significant[[0, 2]].all()
    first, _, third, *_ = report.lines(made)
    assert first.startswith("Of 30 known parameters ")
    assert third.startswith("Eight tools, 0.1 N: of 10 known parameters 100 % lie")
    again = validation_study.study_of(json.loads(json.dumps(numbers(made))), {"tools": entry})
    assert [each.title for each in again.truths.values()] == [each.title for each in made.truths.values()]
    document = report.document(made, {})
    assert not document.figures and document.pictures[0].count("<circle") == 30


@pytest.fixture(scope="module")
def surgical_arm():
    model = files.columns_file("surgical_arm.xml", "models")
    motors = ("yaw", "pitch", "insertion", "roll", "motor_5", "motor_6", "motor_7")
    with pytest.warns(ModelNote, match="joints without a column follow"):
        arm = mechanism(model, "base")
    return model, motors, arm.closed([joint for joint in arm.tree.joints if joint not in motors])


def test_the_surgical_arms_instrument_passes_through_its_remote_centre(surgical_arm):
    """The parallelograms keep a point of the instrument where it is, and bars in their directions."""
    _, motors, arm = surgical_arm
    assert arm.tree.joints == motors
    q = np.random.default_rng(0).uniform(-0.7, 0.7, (5, 7))
    poses = arm.tree.poses(q)
    yaw, front, back, end = (poses[:, arm.tree.names.index(name)] for name in ("yaw", "front", "back", "insertion"))
    centre = end[:, :3, 3] + (0.4318 - q[:, 2:3]) * end[:, :3, 2]
    np.testing.assert_allclose(centre, np.tile(-0.516 * yaw[0, :3, 2], (5, 1)), atol=1e-12)
    np.testing.assert_allclose(front[:, :3, 0], -yaw[:, :3, 2], atol=1e-12)
    # Gravity along the instrument, upwards from the base.
    np.testing.assert_allclose(back[:, 2, 0], np.cos(q[:, 0]) * np.cos(q[:, 1]), atol=1e-12)


def test_a_weighed_load_is_compared_with_that_of_logs_with_and_without_it(surgical_arm, tmp_path, monkeypatch):
    model, *_ = surgical_arm
    head = ",".join([*(f"q{k}" for k in range(1, 8)), *(f"tau{k}" for k in range(1, 8))])
    rows = 0.1 * np.sin(np.arange(100)[:, None] / 9 + np.arange(14))
    for name in ("empty.csv", "other.csv", "full.csv"):
        np.savetxt(tmp_path / name, rows, delimiter=",", header=head, comments="")
    entry = Entry(
        *("arm", "An arm", "With and without.", "arm", True, Source("someone/arm"), ()),
        model=model.name,
        body="front",
        truth=(StatedValue("mass", 0.105, 0.0005),),
        options={"columns": "surgical_arm.toml", "base": "base"},
        empty=(("empty.csv",), ("other.csv",)),
        loaded=(("full.csv",),),
    )
    values, ends = np.arange(10.0), 0.1 + np.arange(10.0)[:, None] + [-0.02, 0.03]

    def identified(robot, without, loaded, *, body):
        assert (len(without), len(loaded), body) == (2, 1, "front") and body in robot.bodies
        np.testing.assert_allclose(loaded[0]["motor_7_torque"], rows[:, 13], atol=1e-12)
        return SimpleNamespace(in_frame=lambda: RigidBody(0.1 + values, values, 0.01 + values, values > 0, ends))

    monkeypatch.setattr(validation_study, "identify_load", identified)
    with pytest.warns(ModelNote):
        known = of_load(entry, {entry.model: model, **{path.name: path for path in tmp_path.iterdir()}})
    expected = {"names": ["mass"], "units": ["kg"], "true": [0.105], "values": [0.1], "tolerance": [0.0005]}
    expected |= {"lower": [0.08], "upper": [0.13]}
    assert {key: known[key] for key in expected} == expected


@pytest.mark.slow
@pytest.mark.skipif(not (DATA / "c0_00.csv").is_file(), reason="MULTICONTACT_DATA has no dfki_double_pendulum")
def test_the_pendulum_in_steel_has_the_published_inertias():
    entry = files.registry()["double_pendulum"]
    task = validation_study.Task(entry, DATA)
    (each,) = validation_study.collected([entry], [task], [validation_study.work(task)])
    assert each.unchecked == () and each.channels == ("Joint1", "Joint2") and each.outcome == "usable"
    for published in entry.published:
        if published.name in ("m2rz2", "m3rz3", "Ixx2", "Ixx3", "Ia(Joint2)"):
            assert abs(each.published_z(published)) < 1.96, published.name
            assert each.values[published.name][2] < 0.3 * abs(published.value), published.name
    assert (each.ratios[ESTIMATE] < 0.5).all() and (each.ratios[MODEL] > 0.9).all()
