"""Mechanisms that move freely in a plane, and the components of a wrench that their motion cannot explain."""

import mujoco
import numpy as np
import pytest
import sagittal_walker
import walker
from scipy.spatial.transform import Rotation

import scenes
import sim
from ident.geometry.se3 import pose
from ident.mechanism.mechanism import out_of_plane, plane_normal

AT_REST = np.eye(4)


def read(text, **options):
    return sim.mechanism(mujoco.MjSpec.from_string(text), **options)


def turned(*rpy_deg):
    return pose(Rotation.from_euler("xyz", rpy_deg, degrees=True).as_matrix(), np.array([0.3, 0.1, -0.2]))


def test_a_sagittal_model_cannot_explain_what_is_sideways():
    person = sagittal_walker.mechanism()
    np.testing.assert_allclose(np.abs(plane_normal(person)), [0, 0, 1], atol=1e-12)
    assert out_of_plane(person, AT_REST) == (2, 3, 4)


def test_components_are_those_in_the_sensors_axes():
    person = sagittal_walker.mechanism()
    assert out_of_plane(person, turned(0, 0, 30)) == (2, 3, 4)
    assert out_of_plane(person, turned(90, 0, 0)) == (1, 3, 5)
    assert out_of_plane(person, turned(0, -90, 0)) == (0, 4, 5)
    assert out_of_plane(person, turned(10, 0, 0)) == ()


@pytest.mark.parametrize(
    "person",
    [
        read(sagittal_walker.text(gravity="0 0 -9.81")),
        read(sagittal_walker.text(gravity="0 -9.7 -1")),
        read(sagittal_walker.text(knee="0.1 0 1")),
        read(sagittal_walker.text(), fix={"tx": [0.0]}),
        read(sagittal_walker.text(), fix={"tilt": [0.2]}),
        read(sagittal_walker.text(), base="pelvis"),
        sagittal_walker.mechanism().beyond("foot_r"),
        walker.mechanism(),
        sim.mechanism(scenes.load("double_pendulum"), base="base"),
    ],
    ids=("seen_from_above", "slope", "oblique_knee", "held_in_x", "upright", "posed", "a_foot", "in_space", "arm"),
)
def test_of_all_others_every_component_counts(person):
    assert plane_normal(person) is None and out_of_plane(person, AT_REST) == ()
