"""Recordings of a person: all contacts add up to MuJoCo's inverse dynamics; the prior is wrong."""

from dataclasses import replace

import numpy as np
import pytest
import random_models
from scipy.spatial.transform import Rotation

import scenes
from experiments.reports.human_report import measured
from experiments.studies.person_recordings import BASE, SENSORS, Faults, Laboratory, drawn, humanoid, moved, recorded
from ident.recordings.wrench import transform_wrench
from sim.models.model_mechanism import mechanism

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
    assert measured(Laboratory()) == "Angles have noise of 0.5°, white."
