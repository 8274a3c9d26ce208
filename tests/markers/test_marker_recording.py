"""Postures as recordings: undetermined frames are interpolated, undetermined joints left out, each with a note."""

import numpy as np
import pytest
from marked import labels_of, marked_person, trial

from sim.markers.marked_model import base_of, marked_model
from sim.markers.trial_fit import fit_trial
from sim.markers.trial_recording import recording


@pytest.fixture(scope="module")
def person():
    spec = marked_person()
    model = spec.compile()
    marked, _ = marked_model(spec, labels_of(model))
    return marked, *trial(model, 30)


def test_frames_without_markers_and_joints_without_any(person):
    marked, time, qpos, x = person
    y = x.copy()
    y[10:13] = np.nan
    y[:, [k for k, label in enumerate(marked.labels) if label.startswith(("left_hand", "left_toes"))]] = np.nan
    base = base_of(marked.model, None)
    angles = recording(fit_trial(marked, y), time, base)
    assert base == "pelvis" and angles.base.shape == (30, 4, 4)
    assert "left_toes_position" not in angles.measured and "left_wrist_flexion_position" not in angles.measured
    assert "The markers do not determine joint 'left_toes', which has no channel." in angles.notes
    assert "Joint 'left_knee' is interpolated in 3 frames that do not determine it." in angles.notes
    assert "The base is interpolated in 3 frames that do not determine it." in angles.notes
    knee = qpos[:, marked.model.joint("left_knee").qposadr[0]]
    there = np.delete(np.arange(30), [10, 11, 12])
    np.testing.assert_allclose(angles["left_knee_position"][there], knee[there], atol=1e-9)
    np.testing.assert_allclose(angles["left_knee_position"][10:13], np.interp([1, 2, 3], [0, 4], knee[[9, 13]]))
    np.testing.assert_allclose(angles.base[there, :3, 3], qpos[there, :3], atol=1e-9)
    assert np.isnan(angles.as_measured("left_knee_position").values).sum() == 3
    assert 0 <= angles.noise["left_knee_position"] < 1e-8
