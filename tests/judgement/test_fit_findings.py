"""Findings on residuals, convergence and joint ranges: their thresholds, and those of doubts."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from recorded_faults import JOINTS, PENDULUM

from ident.judgement.fit_findings import (
    course_findings,
    posture_findings,
    quality_findings,
    setup_remarks,
    slow_residual_findings,
)
from ident.mechanism.motion import Motion


def joint(**fit):
    return SimpleNamespace(trajectory=SimpleNamespace(fit=SimpleNamespace(**fit)))


@pytest.mark.parametrize(
    ("status", "steps", "text"),
    [
        ("converged", [5.0, 0.01], None),
        ("converged", [5.0, 0.5], None),
        ("rounds", [5.0, 0.25], None),
        ("rounds", [5.0, 0.35], "did not settle after 2 rounds;"),
        ("stuck", [0.35], "found no better step after 1 round;"),
        ("interrupted", [5.0, 1.0, 0.01], "was interrupted after 3 rounds;"),
    ],
)
def test_an_estimate_that_did_not_settle_is_a_doubt(status, steps, text):
    found = list(course_findings(joint(status=status, trace=steps)))
    assert [finding.doubt for finding in found] == [True] * (text is not None)
    assert not text or text in found[0].text


def test_nothing_is_said_of_a_course_or_slow_residuals_without_a_trajectory_estimate():
    assert not list(course_findings(SimpleNamespace(trajectory=None)))
    assert not list(slow_residual_findings(SimpleNamespace(trajectory=None)))


@pytest.mark.parametrize("setup", [(), (SimpleNamespace(text="late", place=None),)])
def test_a_set_up_that_explains_nothing_is_a_doubt_beside_what_was_found(setup):
    search = SimpleNamespace(incredible=True)
    *found, doubt = setup_remarks(SimpleNamespace(setup=setup, trajectory=SimpleNamespace(search=search)))
    assert [(finding.text, finding.doubt) for finding in found] == [("late", False)] * len(setup)
    assert doubt.doubt and ("nothing else of it was changed" in doubt.text) == bool(setup)


def slow(times, floor=0.0):
    """Findings on two channels with a given ratio of total to fast noise."""
    fast = np.random.default_rng(0).normal(size=(4000, 2))
    noise = SimpleNamespace(channels=np.array(times, float), floor_channels=np.full(2, floor))
    result = joint(noise=noise, pieces=[SimpleNamespace(measured=fast[:2000]), SimpleNamespace(measured=fast[2000:])])
    result.channels = ("Fx", "Fz")
    return list(slow_residual_findings(result))


def test_more_than_a_sensors_noise_is_a_remark_from_three_times_on():
    assert not slow([2.7, 2.7])
    (found,) = slow([2.7, 5.0])
    assert not found.doubt and found.place.channels == ("Fz",) and "sensors: Fz 5 times." in found.text
    assert "In all channels" in slow([4.0, 5.0])[0].text and "4 to 5 times." in slow([4.0, 5.0])[0].text
    assert "over 100 times." in slow([300.0, 500.0])[0].text
    # Noise at its lower bound does not indicate an imperfect model.
    assert not slow([2.7, 5.0], floor=2.0)
    assert slow([2.7, 5.0], floor=1.5)


def test_residuals_over_signals_are_sorted_by_what_they_mean():
    found = list(quality_findings({"a": 0.2, "b": 0.6, "c": 0.97, "d": 1.7, "e": 0.61}, "held-out"))
    assert [(finding.doubt, finding.place.channels) for finding in found] == [
        (True, ("d",)),
        (False, ("c",)),
        (False, ("b", "e")),
    ]
    assert "held-out residual over standard deviation in brackets: b (0.6), e (0.61)." in found[2].text


def postures(q):
    """Findings on the first joint, whose range is ±1."""
    mechanism = replace(PENDULUM, ranges={JOINTS[0]: (-1.0, 1.0)})
    q = np.stack([q, 9 * np.ones(len(q))], axis=1)
    samples = SimpleNamespace(motion=Motion(q, 0 * q, 0 * q))
    return list(posture_findings(SimpleNamespace(prepared=SimpleNamespace(mechanism=mechanism, samples=samples))))


@pytest.mark.parametrize("sign", [1, -1])
def test_postures_beyond_a_joints_range_are_a_doubt_but_for_rare_and_small_ones(sign):
    inside = np.linspace(-1, 1, 1000)
    assert not postures(inside)
    assert not postures(np.where(np.arange(1000) < 500, sign * 1.08, inside))
    assert not postures(np.where(np.arange(1000) < 8, sign * 2, inside))
    (found,) = postures(np.where(np.arange(1000) < 20, sign * 1.12, inside))
    assert found.doubt and found.place.joints == (JOINTS[0],) and f"{JOINTS[0]} (2% of the samples)" in found.text
