"""Sensors with clipped ranges or coarse steps: named, and their samples left out."""

import numpy as np
import pytest
from coded import coded
from recorded_faults import JOINTS, PENDULUM, TRUTH, angles_and_wrench, faulty, wrench_of
from slow_pendulum import recorded

import ident
from ident.estimation.preparation import prepared


def clipped(share, component=2, seed=0):
    """A recording with a component clipped at the value that this share of it exceeds."""
    recording = faulty(seed)
    wrench = wrench_of(recording)
    limit = np.quantile(wrench[:, component], 1 - share)
    wrench[:, component] = np.minimum(wrench[:, component], limit)
    return angles_and_wrench(recording.time, recording.of_joints(JOINTS, "position"), wrench), limit


def test_a_clipped_force_is_named_and_left_out_where_it_is():
    recording, limit = clipped(0.1)
    estimate = ident.identify(PENDULUM, recording)
    (finding,) = coded(estimate, "clipped_channel")
    values = finding.values
    assert (values["channel"], values["limits"], values["unit"]) == ("Fz", (limit,), "N")
    assert values["share"] == pytest.approx(0.1, abs=0.01) and values["kept"] and values["log"] is None
    assert not finding.doubt and finding.place.channels == ("Fz",)
    assert not estimate.setup
    assert abs(estimate.psi[0] - TRUTH[0]) < 1.96 * estimate.std[0]
    assert (abs(estimate.psi - TRUTH) < 4 * estimate.std_setup).all()
    assert estimate.verdict().usable
    assert estimate.checks.weight.measured == pytest.approx(PENDULUM.mass, rel=0.005)


@pytest.mark.parametrize("steps", [{}, {"forces": 0.01, "moments": 0.01}, {"forces": 3.0, "moments": 0.3}])
def test_nothing_is_clipped_where_ranges_are_large_enough(steps):
    """With fine and with coarse steps."""
    for seed in range(3):
        assert not prepared(PENDULUM, recorded(seed, speed=1, noise=1, **steps)).clipped


def test_steps_that_are_most_of_the_noise_are_named():
    recording = recorded(speed=1, forces=3, moments=0.3, angles=2 * np.pi / 4096, jitter=0, noise=0.2)
    (finding,) = coded(ident.identify(PENDULUM, recording), "coarse_steps")
    assert not finding.doubt
    steps = {each["name"]: (pytest.approx(each["step"], rel=1e-3), each["unit"]) for each in finding.values["steps"]}
    angle = 2 * np.pi / 4096, "rad"
    wanted = {"Fy": (3, "N"), "Fz": (3, "N"), "Mx": (0.3, "N m"), "joint1": angle, "joint2": angle}
    assert {name: steps[name] for name in wanted} == wanted
    fine = recorded(speed=1, forces=0.1, moments=0.01, angles=1e-4, noise=1)
    assert not coded(ident.identify(PENDULUM, fine), "coarse_steps")
