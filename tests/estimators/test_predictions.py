"""Candidates are judged alike: by the same motions, smoothed by channel as fitted samples decide, where joints move."""

from dataclasses import replace

import driven_arm
import numpy as np
import pytest
from mechanisms import by_joint
from recorded_faults import PENDULUM, faulty, shortened

import ident
from ident.estimators import predictions
from ident.setup import PRIORS

EXACT = dict.fromkeys(PRIORS, 0.0)


def spoilt(recording, factor):
    """A recording with its wrench multiplied by a factor."""
    wrench = {name: factor * recording[name] for name in ("ground_force", "ground_torque")}
    return replace(recording, measured=recording.measured | wrench)


def test_smoothing_is_chosen_by_channel_on_what_is_fitted_alone(monkeypatch):
    chosen, of = [], predictions.Predictions.of

    def kept(self, candidate, setup):
        chosen.append((self, candidate, setup, of(self, candidate, setup)))
        return chosen[-1][-1]

    monkeypatch.setattr(predictions.Predictions, "of", kept)
    recording, judge = shortened(faulty(1), 300), shortened(faulty(2), 150)
    for each in (judge, spoilt(judge, -3.0)):
        estimate = ident.identify(PENDULUM, recording, setup=EXACT, held_out=each)
    assert len(chosen) == 6 and len(estimate.held_out.versions) > 1
    for before, after in zip(chosen[:3], chosen[3:], strict=True):
        np.testing.assert_array_equal(before[3].constants, after[3].constants)
    # Each is about the best for its channel, and the shortest of those that are as good.
    own, candidate, setup, predicted = chosen[0]
    constants = predicted.constants[0].tolist()
    assert len(set(constants)) > 1
    left = {T: own._squares(candidate, setup, T)[0] for T in (*constants, *np.geomspace(0.01, 0.5, 40).tolist())}
    least = np.min(list(left.values()), axis=0)
    for k, T in enumerate(constants):
        assert left[T][k] < 1.03**2 * least[k]
        assert own._squares(candidate, setup, T / 1.1)[0, k] > least[k] * predictions.AS_GOOD**2 or T < 0.012


def creeping():
    """The arm's log with its last joint creeping twice for a second, friction there at the other end of its range."""
    t, q, dq, ddq = driven_arm.motion(np.random.default_rng(0))
    rest = sum(np.exp(-(((t - at) / 0.6) ** 8)) for at in (3.0, 9.5))
    speed = 1 - 0.998 * rest
    own, s = np.cumsum(speed) / 100, t[:, None]
    for x in (q, dq, ddq):
        x[:, 2] = np.interp(own, s[:, 0], x[:, 2])
    ddq[:, 2] = ddq[:, 2] * speed**2 + dq[:, 2] * np.gradient(speed, t)
    dq[:, 2] *= speed
    friction = np.array(driven_arm.TRUE["frictionloss"]) * np.tanh(dq / 0.003)
    friction[rest > 0.99, 2] *= -1
    torque = driven_arm.torques(q, dq, ddq) + friction
    rng = np.random.default_rng(1)
    torque, q = torque + 0.02 * rng.normal(size=q.shape), q + 1e-4 * rng.normal(size=q.shape)
    return ident.Recording(t, by_joint(driven_arm.JOINTS, position=q, torque=torque))


@pytest.fixture(scope="module")
def crept():
    return ident.identify(driven_arm.mechanism(), creeping(), setup=EXACT, known=True)


def test_torques_of_joints_that_rub_are_judged_where_they_move(crept):
    held, v0 = crept.held_out, crept.trajectory.reversals.velocity[2]
    assert 0.1 < held.resting[:, 2].mean() < 0.6
    speed = np.abs(held.samples.motion.dq[:, 2])
    assert np.quantile(speed[held.resting[:, 2]], 0.95) < 1.5 * v0 < np.quantile(speed[~held.resting[:, 2]], 0.05)
    throughout = np.sqrt((held.residual**2).mean(axis=0)) / held.samples.measured.std(axis=0)
    assert held.ratio[2] < 0.15 < 0.2 < throughout[2]
    # All candidates alike: least squares have the same friction, and the same excess at rest.
    assert crept.rivals["least squares"][2] < 0.15 < 0.5 < held.ratio_at_rest(held.rivals["least squares"])[2]
    assert crept.verdict().usable and crept.verdict().best == "estimate"


@pytest.mark.slow
def test_each_of_several_logs_is_smoothed_and_judged_by_the_others():
    logs = [shortened(faulty(seed), 160) for seed in range(3)]
    estimate = ident.identify(PENDULUM, logs, setup=EXACT)
    held = estimate.held_out
    assert [part.stop - part.start for part in held.left_out] == [len(held.time) // 3] * 3
    (first, *_) = estimate.in_logs
    assert set(first) == {"estimate", "model", "least squares"} and first["estimate"].shape == (6,)
    wrong = ident.identify(PENDULUM, [spoilt(logs[0], 1.5), *logs[1:]], setup=EXACT).held_out
    # What is predicted of a log depends on the others alone, and so does its smoothing.
    own = held.left_out[0]
    before, after = (each.samples.measured - each.residual for each in (held, wrong))
    assert np.abs(before - after)[own, 1:].max() < 0.2 * np.abs(before)[own, 1:].max()
