import numpy as np
import pytest
from mechanisms import LENGTH_1, tilted_axis

import scenes
from ident.geometry.inertia import parameters_from_com, pseudo_inertia
from sim.models.mujoco_model import parameters_from_model

MODEL = scenes.load("double_pendulum").compile()


def test_bodies_are_physical_and_geoms_weigh_nothing():
    phi = parameters_from_model(MODEL, "base")
    expected = [
        parameters_from_com(4.0, [0, 0, 0], np.diag([0.0044, 0.0044, 0.0072])),
        parameters_from_com(3.7, [0, 0, 0.2], np.diag([0.0103, 0.0103, 0.0067])),
        parameters_from_com(13.2939, [0.1, 0, 0.2], np.diag([0.41, 0.41, 0.05])),
    ]
    np.testing.assert_allclose(phi, np.concatenate(expected), atol=1e-12)
    assert (np.linalg.eigvalsh(pseudo_inertia(phi.reshape(3, 10))) > 0).all()
    assert MODEL.body_pos[3, 2] == LENGTH_1


@pytest.mark.parametrize(("tilt", "azimuth"), [(5, 120), (5, -30), (40, 0)])
def test_tilt_turns_both_axes(tilt, azimuth):
    tilted = scenes.load("double_pendulum", tilt_deg=tilt, azimuth_deg=azimuth).compile()
    np.testing.assert_allclose(tilted.jnt_axis, [tilted_axis(tilt, azimuth)] * 2, atol=1e-12)
    for name in ("body_pos", "body_mass", "sensor_noise", "jnt_range", "actuator_gainprm"):
        np.testing.assert_array_equal(getattr(tilted, name), getattr(MODEL, name))


@pytest.mark.parametrize(("tilt", "azimuth"), [(-1, 0), (90, 0), (np.nan, 0), (5, np.inf)])
def test_senseless_tilts_are_refused(tilt, azimuth):
    with pytest.raises(ValueError, match="from 0° to below 90°"):
        scenes.load("double_pendulum", tilt_deg=tilt, azimuth_deg=azimuth)
