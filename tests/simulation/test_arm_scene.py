"""The arm with friction: its bodies are physical, and its file alone states friction and noise."""

import numpy as np
import pytest

import scenes
import sim
from ident.geometry.inertia import pseudo_inertia

MODEL = scenes.load("arm").compile()


def test_its_bodies_are_physical_and_geoms_weigh_nothing():
    arm = sim.mechanism(MODEL, base="base")
    assert arm.tree.joints == ("turn", "shoulder", "elbow", "wrist")
    assert (np.linalg.eigvalsh(pseudo_inertia(arm.known.reshape(-1, 10))) > 0).all()
    np.testing.assert_allclose(arm.known[::10], [5, 4, 3, 2, 0.8])


def test_torques_are_measured_to_a_hundredth_of_the_friction():
    for joint in ("turn", "shoulder", "elbow", "wrist"):
        noise = float(MODEL.sensor(f"{joint}_torque").noise[0])
        assert noise == pytest.approx(0.01 * float(MODEL.joint(joint).frictionloss[0]))
        assert MODEL.sensor(f"{joint}_position").noise[0] == pytest.approx(1e-4)
