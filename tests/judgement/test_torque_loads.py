"""A load that the model lacks and torques in another unit, told apart on the arm of the scenes."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from coded import coded

import ident
import scenes
import sim
from sim.motion.excitation import Trapezoids

OF_TORQUES = ("torque_sign", "torque_scale", "body_not_carried")


@cache
def arm():
    return sim.mechanism(scenes.load("arm"), base="base")


@cache
def recording():
    """Angles, torques and the plate's wrench."""
    motion = Trapezoids.drawn(np.random.default_rng(0), 4, 8)
    return sim.simulate(scenes.load("arm"), motion, samples=700)


def identified(*, light=False, factor=1.0):
    """Estimate with a model whose last body has half of its mass, and with torques times a factor."""
    known = arm().known.reshape(-1, 10).copy()
    known[-1] *= 0.5 if light else 1.0
    log = recording()
    measured = {name: (factor if name in torques() else 1.0) * x for name, x in log.measured.items()}
    return ident.identify(replace(arm(), prior=known.ravel()), replace(log, measured=measured))


def torques():
    return [f"{joint}_torque" for joint in arm().tree.joints]


@pytest.mark.slow
def test_right_torques_of_a_model_with_too_light_a_tool_are_no_finding():
    estimate = identified(light=True)
    assert estimate.verdict().usable and not coded(estimate, *OF_TORQUES, "setup_gain")
    (mass,) = [each for each in estimate.parameters if each.name == "m1"]
    assert mass.estimate == pytest.approx(14.8, abs=0.05)


@pytest.mark.slow
def test_torques_that_are_a_seventh_too_large_are_a_finding_beside_a_plate():
    estimate = identified(light=True, factor=1.15)
    gains = {each.place.channels[0]: each.values["value"] for each in coded(estimate, "setup_gain")}
    assert set(gains) <= {"turn", "shoulder", "elbow", "wrist"} and len(gains) >= 2
    assert all(0.08 < gain < 0.18 for gain in gains.values()) and not coded(estimate, *OF_TORQUES)
