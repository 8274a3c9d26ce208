"""The study of a person, very small: intervals cover the truth, errors of the prior are corrected."""

from fnmatch import fnmatch

import numpy as np
import persons
import pytest
from commands import entries_of, refusal, rows_of
from pages import replayed
from same_recording import assert_same_recording

from experiments.human import main
from experiments.reports import human_report
from experiments.studies import person_on_plates
from ident.judgement.residuals import fast_noise
from ident.recordings.recording import Recording
from ident.trajectory.left_out import prediction_errors


@pytest.mark.slow
@pytest.mark.usefixtures("undrawn")
def test_a_person_from_a_wrong_prior(tmp_path, capsys, monkeypatch):
    """With the estimate of the person without a rail in place of both."""
    monkeypatch.setattr(person_on_plates, "study", lambda *_, **__: persons.briefly())
    out = tmp_path / "person"
    small = ["--seconds", "2", "--rate", "50", "--noise", "0.2", "--activities", "squats", "arm swings"]
    assert main([*small, "--workers", "1", "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "trajectory estimate" in printed and "recording_2_arm_swings.npz" in printed
    assert f'ident.Recording.load("{out / "recording_1_squats.npz"}")' in " ".join(printed.split())
    person, saved = persons.briefly(), sorted(out.glob("recording_*"))
    for file, activity, recording in zip(saved, person.activities, person.recordings, strict=True):
        assert any(fnmatch(file.name, pattern) for pattern in human_report.OUTPUTS)
        assert_same_recording(Recording.load(file), recording)
        assert recording.setup and recording.provenance["activity"] == activity
    assert replayed(out / "report.html")["estimated"]
    numbers = entries_of(out / "summary.json")["plates_and_rail"]
    assert numbers["coverage_of_determined"] > 0.85 and numbers["rms_z"] < 1.4 and numbers["determined"] >= 10
    (late,) = (each for each in numbers["set_up"] if each["name"].startswith("delay"))
    assert abs(late["value"] - 0.02) < 3 * late["std"]
    prior, joint = (numbers["errors"][name] for name in ("prior", "trajectory estimate"))
    assert sum(joint.values()) < 0.6 * sum(prior.values())
    assert numbers["growth"][0] == [1, 1, 1] and (np.diff(numbers["growth"], axis=0) <= 0).all()
    for curve in numbers["foretold"].values():
        assert all(np.diff(curve["deviation"]) < 0) and curve["deviation"][0] < 1
    every, squats = (np.array(numbers["foretold"][name]["deviation"]) for name in ("all", "squats"))
    assert (every < squats).all()
    rows = {row["segment"]: row for row in rows_of(out / "table_segments.csv")}
    for name, each in numbers["segments"].items():
        for which in ("true", "prior", "estimate", "std"):
            assert float(rows[name][f"mass_{which}"]) == pytest.approx(each[which][0], rel=1e-3, abs=1e-3)
            shown = pytest.approx(float(rows[name][f"inertia_{which}"]), rel=1e-3, abs=1e-3)
            assert any(x == shown for x in each[which][4:7])


@pytest.mark.slow
@pytest.mark.usefixtures("here", "undrawn")
def test_an_interrupted_count_of_persons_goes_on_where_it_ended(tmp_path, capsys, monkeypatch):
    asked = []

    def quick(seconds, *, seed, laboratory, activities):
        if seed == 7 and 7 not in asked:
            asked.append(seed)
            raise KeyboardInterrupt
        asked.append((seed, laboratory.rail, activities))
        return persons.briefly()

    monkeypatch.setattr(person_on_plates, "study", quick)
    command = ["--persons", "3", "--seed", "5", "--no-rail", "--activities", "squats", "--workers", "1"]
    command += ["--out", str(tmp_path)]
    assert main(command) == 130 and main([*command, "--resume"]) == 0
    first, *_, last = asked
    assert (first, last) == ((5, False, ["squats"]), (7, False, ["squats"])) and asked.count(first) == 1
    first, *others, every = rows_of(tmp_path / "table_coverage.csv")
    person = persons.briefly()
    assert len(others) == 2 and int(every["determined"]) == 3 * int(first["determined"]) == 3 * person.determined.sum()
    assert float(every["hold"]) == pytest.approx(person.coverage)
    assert float(first["rms_z"]) == pytest.approx(np.sqrt(np.mean(person.distances[1][person.determined] ** 2)))
    better = person.errors["prior"] / person.errors["trajectory estimate"]
    assert float(first["times_better"]) == pytest.approx(better.min())
    assert 0.3 < float(first["noise_of_angles"]) < 0.7 and not every["noise_of_angles"]
    assert "laboratory" in refusal(main, [c for c in command if c != "--no-rail"] + ["--resume"], capsys)


@pytest.mark.slow
def test_noise_and_left_out_pieces_of_somebody_on_plates_alone_have_the_size_of_what_the_plates_carry():
    """Nothing else carries, so that the sum of all wrenches is zero."""
    estimate = persons.briefly().estimate
    joint = estimate.trajectory
    errors = prediction_errors(joint.measurement, joint.fit, np.full(6, np.inf))
    assert (errors < 0.5).any()
    noise = fast_noise(joint, range(6))
    # Moments have that of the pelvis's place besides, about which they are.
    assert ((noise[:3] > 1.5) & (noise[:3] < 3)).all() and ((noise[3:] > 0.15) & (noise[3:] < 3)).all()
    assert not any(each.code == "residual_above_fast_noise" for each in estimate.findings)
