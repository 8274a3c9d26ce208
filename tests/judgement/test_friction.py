"""Friction that is likely but was not fitted: distinguished from noise, and reported above thresholds."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import signal
from test_torque_checks import arm, log

import ident
from ident.judgement import torque_findings
from ident.judgement.torque_checks import friction_shares
from ident.judgement.torque_findings import friction_findings
from ident.model.axes import Axes


@cache
def fitted():
    return ident.identify(arm(), log(seconds=6, rate=50), drive=(), estimator="weighted", cutoff=8.0)


def shares_of(residual):
    """Shares for predicted torques and a residual (N, 7)."""
    fit, samples = fitted().fit, fitted().prepared.samples
    right = samples.measured - fit.residual(samples)
    return np.array(list(friction_shares(fit, replace(samples, measured=right + residual)).values()))


@pytest.mark.parametrize(("rho", "most"), [(0.0, 0.01), (0.9, 0.06)])
def test_noise_is_not_taken_for_friction(rho, most):
    """The share that two columns explain by chance is subtracted; it is larger for correlated noise."""
    rng, size = np.random.default_rng(0), fitted().prepared.samples.measured.shape
    shares = np.concatenate(
        [shares_of(signal.lfilter([1], [1, -rho], rng.normal(size=size), axis=0)) for _ in range(6)]
    )
    assert 0.35 < np.mean(shares == 0) < 0.75
    assert shares.mean() < most


def axes(joints, **motors):
    """Axes of joints, and of motors with their rows."""
    rows = np.array(list(motors.values()), float).reshape(-1, len(joints))
    return Axes(joints, tuple(motors), rows, (), np.zeros((0, len(joints))))


def estimate(share, ratio, drives=()):
    """An estimate of two torques, with a share of the second's residual that friction would explain."""
    channels = ("joint1", "joint2")
    return SimpleNamespace(
        fit=SimpleNamespace(equations=SimpleNamespace(drives=drives, axes=axes(channels), channels=channels)),
        channels=channels,
        ratios=dict.fromkeys(channels, ratio),
        friction={"joint1": 0.0, "joint2": share},
        model_error=np.array([0.0, share]),
        trajectory=SimpleNamespace(),
        logs=(),
    )


@pytest.mark.parametrize(
    ("share", "ratio", "worth_it"), [(0.25, 0.025, True), (0.15, 0.025, False), (0.25, 0.015, False)]
)
def test_friction_is_worth_a_word_where_it_explains_much_of_something(share, ratio, worth_it):
    """A residual of a hundredth of the signal may correlate with the velocity."""
    (finding,) = list(friction_findings(estimate(share, ratio))) or [None]
    assert (finding is not None) == worth_it
    if finding:
        assert finding.doubt and finding.code == "friction_not_fitted" and finding.place.channels == ("joint2",)
        assert finding.values == {"shares": {"joint2": share}, "drives": ("viscous", "coulomb")}


def reversals(monkeypatch, *, size=1.0, slip=0.003, at_rest=0.4, **motors):
    """Findings on two torques of which the second's joint, or the first motor, has friction."""
    result = estimate(0.0, 0.1)
    equations = result.fit.equations
    equations.axes = axes(equations.channels, **motors)
    rubs = 2 if motors else 1
    monkeypatch.setattr(torque_findings, "rubbing", lambda equations: (rubs,))
    sizes, velocities, slips = np.zeros(rubs + 1), np.ones(rubs + 1), np.zeros(rubs + 1)
    sizes[rubs], velocities[rubs], slips[rubs] = size, 0.05, slip
    result.trajectory = SimpleNamespace(
        reversals=SimpleNamespace(size=sizes, velocity=velocities, slip=slips, shares=equations.axes.matrix),
        measurement=SimpleNamespace(equations=equations),
    )
    result.mechanism, result.bounded, result.logs = arm(), {}, ()
    result.at_rest = {"joint1": np.nan, "joint2": at_rest}
    return list(torque_findings.drive_findings(result))


def test_slack_of_a_motor_is_a_remark_on_the_joints_that_it_moves(monkeypatch):
    (finding,) = reversals(monkeypatch, left=[1.0, 2.0])
    assert finding.place.joints == ("joint1", "joint2")
    assert finding.values == {"velocities": {"left": 0.05}, "at_rest": {"joint2": 0.4}}
    (finding,) = reversals(monkeypatch, size=0.0, slip=0.05, left=[1.0, 2.0])
    assert finding.code == "smooth_coulomb_friction" and finding.values == {"velocities": {"left": 0.05}}
    assert not reversals(monkeypatch, size=0.0, slip=0.05, left=[10.0, 20.0])


def test_a_drive_at_its_bound_in_one_log_is_of_its_joint():
    result = estimate(0.0, 0.1)
    result.mechanism, result.trajectory, result.bounded = arm(), None, {"Fc(joint2) of log 2": (0.1, 0.05)}
    (finding,) = torque_findings.drive_findings(result)
    assert finding.place.joints == ("joint2",) and finding.values["units"] == {"Fc(joint2) of log 2": "N m"}
