"""The arm with friction: its bodies are physical, and its file alone states friction and noise."""

import pytest

import scenes

MODEL = scenes.load("arm").compile()


def test_torques_are_measured_to_a_hundredth_of_the_friction():
    for joint in ("turn", "shoulder", "elbow", "wrist"):
        noise = float(MODEL.sensor(f"{joint}_torque").noise[0])
        assert noise == pytest.approx(0.01 * float(MODEL.joint(joint).frictionloss[0]))
        assert MODEL.sensor(f"{joint}_position").noise[0] == pytest.approx(1e-4)
