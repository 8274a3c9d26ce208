"""Least squares at the best of several cut-offs, the rival of an estimate."""

from functools import cache
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
import wrist
from fits import sampled

import ident
import sim
from ident.estimation.preparation import Part, filtered, prepared
from ident.estimation.samples import Samples
from ident.estimators.predictions import Candidate
from ident.regression.conventional import _Sums, filtered_least_squares
from ident.regression.held_out import HeldOut


def predicted(log, part, fit, k=0):
    """Channels that least squares predict from states filtered at their own cut-off."""
    motion = filtered(log, fit.cutoffs[k])[0].motion[log.taken(part)]
    zero = Samples(motion, np.zeros((len(motion), len(log.equations.channels))))
    return -Candidate(log.equations, fit.values[[k]]).residuals(zero)[0]


@cache
def arm():
    return sim.mechanism(mujoco.MjSpec.from_string(wrist.model()))


def rubbing(seconds=10.0, seed=0):
    """Angles and torques of an arm with friction of 2 N m that sticks for 20 ms at each reversal."""
    mechanism, (t, q, dq, ddq) = arm(), wrist.motion(seconds, 100.0)
    rng = np.random.default_rng(seed)
    torque = ident.joint_torque_regressor(mechanism.tree, q, dq, ddq, gravity=mechanism.gravity) @ mechanism.known
    torque += 2 * np.where(np.abs(dq) < 0.05, rng.uniform(-1, 1, dq.shape), np.sign(dq))
    torque += 0.02 * rng.normal(size=q.shape)
    channels = {
        f"{joint}_position": x for joint, x in zip(wrist.JOINTS, q.T + 1e-4 * rng.normal(size=q.T.shape), strict=True)
    }
    return ident.Recording(t, channels | {f"{j}_torque": x for j, x in zip(wrist.JOINTS, torque.T, strict=True)})


def test_samples_near_reversals_are_left_alone(monkeypatch):
    log = prepared(arm(), rubbing(), drive=("viscous", "coulomb"))
    rank, fitted, judged = log.equations.parameters.rank, slice(0, 600), slice(600, 970)
    known = np.zeros(rank), np.zeros((rank, rank))
    moving = np.abs(wrist.motion(10.0, 100.0)[2][judged]) > 0.2
    errors = []
    for slow in (0.1, 0.0):
        monkeypatch.setattr("ident.regression.conventional.SLOW", slow)
        fit = filtered_least_squares([Part(log, fitted)], [Part(log, judged)], log.equations, known)
        error = log.recording.torques(arm().tree.joints)[judged] - predicted(log, judged, fit)
        errors.append(np.sqrt((error[moving] ** 2).mean()))
    assert errors[0] < 0.8 * errors[1]


def test_signals_and_residuals_of_sums_are_those_of_their_samples():
    """For `[Y | low-passed | raw]` in two parts, with one more raw channel than low-passed ones."""
    rng = np.random.default_rng(0)
    Y, low, x = rng.normal(size=(2, 50, 3)), rng.normal(size=(2, 50)) + 3, np.array([1.0, -2, 0.5])
    raw = low + 2 * rng.normal(size=(2, 50))
    stacked = np.concatenate([Y, low[..., None], raw[..., None]], axis=2)

    def sums(part):
        rows = stacked[:, part]
        return _Sums(rows.transpose(0, 2, 1) @ rows, np.full(2, rows.shape[1]), rows[..., -1].sum(axis=1), ("Fx", "Fz"))

    both = sums(slice(0, 20)) + sums(slice(20, None))
    np.testing.assert_allclose(both.scales, raw.std(axis=1))
    np.testing.assert_allclose(both.residual(x, -1), np.sqrt(((raw - Y @ x) ** 2).mean(axis=1)))
    np.testing.assert_allclose(both.residual(x, -2), np.sqrt(((low - Y @ x) ** 2).mean(axis=1)))


rng = np.random.default_rng(0)
MEASURED, RESIDUAL = rng.normal(size=(100, 3)) + 5, 0.1 * rng.normal(size=(100, 3))


FIT = SimpleNamespace(equations=SimpleNamespace(channels=("hip", "knee", "foot")))


def held(resting, versions=(MEASURED,), chosen=None, residual=RESIDUAL, **more):
    samples = tuple(sampled(*(np.full((100, 2), k) for k in range(3)), x) for x in versions)
    chosen = np.zeros(residual.shape, int) if chosen is None else chosen
    return HeldOut(np.arange(100.0), (0,), samples, chosen, FIT, residual, resting, **more)


def rests(*spans):
    """Mask of the samples at which each channel rests, by its last one."""
    return np.arange(100)[:, None] < np.array(spans)


def test_a_residual_at_rest_is_no_part_of_the_ratio_of_any_candidate():
    resting = rests(0, 30, 0)
    wrong = np.where(resting, 9.0, RESIDUAL)
    judged = held(resting, residual=wrong, rivals={"model": 2 * wrong})
    moving = slice(30, None)
    signal = MEASURED[moving, 1].std()
    assert judged.signal[1] == pytest.approx(signal) and judged.signal[0] == pytest.approx(MEASURED[:, 0].std())
    assert judged.ratio[1] == pytest.approx(np.sqrt((RESIDUAL[moving, 1] ** 2).mean()) / signal)
    assert judged.ratio_of(judged.rivals["model"]) == pytest.approx(2 * judged.ratio)
    assert judged.relative_rms[1] == pytest.approx(judged.rms[1] / np.sqrt((MEASURED[moving, 1] ** 2).mean()))
    assert judged.ratio_at_rest(wrong)[1] == pytest.approx(9 / signal)
    assert np.isnan(judged.ratio_at_rest(wrong)[[0, 2]]).all()
