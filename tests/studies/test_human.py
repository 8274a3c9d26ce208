"""The study of a person: recordings add up to MuJoCo's inverse dynamics, and correct the errors of a prior."""

from dataclasses import replace
from fnmatch import fnmatch

import numpy as np
import persons
import pytest
import random_models
from commands import entries_of, refusal, rows_of
from pages import replayed
from same_recording import assert_same_recording
from scipy.spatial.transform import Rotation

import scenes
from experiments.human import main
from experiments.reports import human_report
from experiments.reports.human_report import measured
from experiments.studies import person_on_plates
from experiments.studies.person_recordings import BASE, SENSORS, Faults, Laboratory, drawn, humanoid, moved, recorded
from ident.judgement.residuals import fast_noise
from ident.recordings.recording import Recording
from ident.recordings.wrench import transform_wrench
from ident.trajectory.left_out import prediction_errors
from sim.models.model_mechanism import mechanism


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


EXACT = Laboratory(angle_deg=0, position=0, force=0, late=0, rate=50)
HINGES = [f"{body.joint}_position" for body in humanoid().tree.bodies if body.coordinates == 1]


@pytest.mark.parametrize("rail", [True, False])
def test_contacts_together_give_what_the_motion_needs(rail):
    recording = recorded("squats", 1.0, 3, replace(EXACT, rail=rail))
    assert set(recording.sensors) == ({"left", "right", "rail"} if rail else {"left", "right"})
    total = sum(transform_wrench(SENSORS[name].pose, recording.wrench(name).values) for name in recording.sensors)
    model, h = random_models.humanoid(), 1e-4
    for i in (5, 30):
        motion = moved("squats", recording.time[i] + h * np.arange(-1, 2), 3, rail=rail)
        R, p = motion.base.T[:, :3, :3], motion.base.T[:, :3, 3]
        q = np.hstack([p, Rotation.from_matrix(R).as_quat(canonical=True, scalar_first=True), motion.q])
        forces = random_models.forces_between(model, *q, h)
        np.testing.assert_allclose(total[i, :3], forces[:3], atol=0.02)
        about_pelvis = total[i, 3:] - np.cross(p[1], total[i, :3])
        np.testing.assert_allclose(R[1].T @ about_pelvis, forces[3:6], atol=0.02)


def test_what_is_not_as_stated_is_what_sensors_and_joints_read():
    """Readings divided by gains, moved from the sensors' frames, equal those without set-up errors."""
    wrong = dict.fromkeys(("origin", "rotation", "gain", "zero"), 0.05)
    faults = drawn(humanoid(), SENSORS, wrong, np.random.default_rng(0))
    own, exact = (recorded("squats", 1.0, 3, EXACT, each) for each in (faults, Faults()))
    for name in SENSORS:
        moved_back = transform_wrench(faults.frames[name], own.wrench(name).values / faults.gains[name])
        np.testing.assert_allclose(moved_back, exact.wrench(name).values, atol=1e-9, err_msg=name)
    for joint, zero in faults.zeros.items():
        off = own[f"{joint}_position"] - exact[f"{joint}_position"]
        np.testing.assert_allclose(off, zero, atol=1e-12)
    drawn_values = np.array([*faults.zeros.values(), *(g - 1 for x in faults.gains.values() for g in x)])
    assert drawn_values.std() == pytest.approx(0.05, rel=0.25)


def test_axes_and_gravity_are_as_mujoco_has_them_tilted():
    faults = drawn(humanoid(), (), {"axis": 0.2, "gravity": 0.2}, np.random.default_rng(0))
    spec = scenes.load("humanoid")
    for joint, tilt in faults.tilts.items():
        spec.joint(joint).axis = tilt.as_matrix() @ spec.joint(joint).axis
    own, expected = faults.true(humanoid()), mechanism(spec, BASE)
    q = moved("squats", np.linspace(0, 1, 5), 0).q
    np.testing.assert_allclose(own.tree.poses(q), expected.tree.poses(q), atol=1e-12)
    assert np.linalg.norm(own.gravity) == pytest.approx(9.81) and 0.01 < abs(own.gravity[0] / 9.81) < 0.8


def test_noise_is_as_large_as_it_is_said_to_be():
    noisy, exact = (recorded("standing", 4.0, 1, each) for each in (Laboratory(late=0), Laboratory(0, 0, 0, 0, 0)))
    assert np.degrees((noisy[HINGES[0]] - exact[HINGES[0]]).std()) == pytest.approx(0.5, rel=0.2)
    assert (noisy.base - exact.base)[:, :3, 3].std() == pytest.approx(0.002, rel=0.2)
    for name, std in (("left_force", 1.5), ("rail_force", 0.5)):
        assert (noisy[name] - exact[name]).std() == pytest.approx(std, rel=0.2)


@pytest.mark.parametrize(
    ("skin", "z", "noise", "off"), [(0.0, (0.9, 1.1), (0.0019, 0.0021), 0.005), (0.004, (0, 1.3), (0.004, 1), 0.03)]
)
def test_angles_from_markers_are_as_good_as_they_are_said_to_be(skin, z, noise, off):
    """For white noise of the markers; moving skin makes angles worse, and increases their stated noise."""
    exact = recorded("squats", 1.0, 1, EXACT)
    marked = recorded("squats", 1.0, 1, replace(EXACT, force=1.5, markers=True, skin=skin))
    assert set(marked.sensors) == {"left", "right", "rail"}
    distances = [(marked[name] - exact[name]) / marked.noise[name] for name in HINGES]
    assert z[0] < np.sqrt(np.mean(np.square(distances))) < z[1]
    assert noise[0] < marked.provenance["sigma_m"] < noise[1]
    assert np.abs(marked.base - exact.base)[:, :3, 3].max() < off


def test_noise_of_angles_is_not_stated_of_markers():
    assert measured(Laboratory(markers=True)).endswith("markers, with noise of 2 mm, on skin that moves by 4 mm.")
    assert measured(Laboratory(2.0, 0.9)) == "Angles have noise of 2°, correlated at 0.9 from sample to sample."
