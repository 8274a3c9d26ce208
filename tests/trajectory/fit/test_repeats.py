"""Motions that repeat: the period, and residuals that repeat with it, which count once."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import driven_arm as arm
import numpy as np
import pytest
from mechanisms import by_joint

import ident
from ident.trajectory.fit import noise_colours, sandwich
from ident.trajectory.fit.repeats import RepeatedMotion, lateness, period, repetition, trials
from ident.trajectory.fit.sandwich import with_scatter

IRRATIONAL, OTHER = (1, 2**0.5, 5**0.5), (1.1, 1.9, 2.3)


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def motion(rng, seconds, *multiples, noise=0.0, step=0.01):
    """A piece whose joints follow sums of sinusoids of multiples of .3 Hz, and one of which rests."""
    t = step * np.arange(round(seconds / step))
    waves = [np.sin(2 * np.pi * 0.3 * k * t + rng.uniform(0, 6)) for k in multiples]
    q = np.array([np.sum(waves, axis=0), waves[0] - waves[-1], np.zeros(len(t))]).T
    return SimpleNamespace(time=t, states=q + noise * rng.normal(size=q.shape))


def part(whole, start, stop, clock=None):
    """Part of a piece, perhaps with times of its own."""
    shift = 0 if clock is None else clock - whole.time[start]
    return SimpleNamespace(time=whole.time[start:stop] + shift, states=whole.states[start:stop])


def lacking(whole, *samples):
    """A piece without some samples of each coordinate."""
    states = whole.states.copy()
    for x, missing in zip(states.T, samples, strict=True):
        x[missing] = np.nan
    return SimpleNamespace(time=whole.time, states=states)


CUTS = {
    "whole": lambda whole: [whole],
    "pieces with a gap": lambda whole: [part(whole, 0, 900), part(whole, 1100, 3000)],
    "joints on their own clocks": lambda whole: [lacking(whole, slice(1, None, 2), slice(0, None, 2), slice(0))],
    "a joint is not there": lambda whole: [lacking(whole, slice(0), slice(0), slice(None))],
}


@pytest.mark.parametrize("cut", CUTS)
@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize(
    ("multiples", "expected"), [((1, 2, 3), 1 / 0.3), ((2, 3, 4.5), 2 / 0.3), (IRRATIONAL, np.inf)]
)
def test_period_of_a_motion(rng, multiples, expected, noise, cut):
    pieces = CUTS[cut](motion(rng, 30.0, *multiples, noise=noise))
    assert period(pieces, np.full(3, noise)) == pytest.approx(expected, abs=0.011)
    assert period([motion(rng, 6.0, 1, 2, 3)], np.zeros(3)) == np.inf


def of_period(period):
    return RepeatedMotion({0: 0.0}, period, np.inf, np.zeros((2, 1)), np.ones(1))


def summed(time, period, wave):
    """Sums of a wave over a motion's periods."""
    piece = SimpleNamespace(time=time, when=time, log=0)
    sums = sandwich._Repeated(of_period(period), SimpleNamespace(pieces=[piece], theta=np.zeros(1)))
    sums.add((0, 0, 0), 0, time, np.array([0]), wave)
    return sums._sums[0, 0, 0][sandwich.ALL]


def test_the_last_of_many_periods_is_in_phase(rng):
    """Also if a period is no number of samples."""
    piece = motion(rng, 200.0, 1, 2, 3, step=0.02)
    T = period([piece], np.zeros(3))
    assert 60 * abs(T - 1 / 0.3) < 0.04
    assert 58 < summed(piece.time, T, np.sin(2 * np.pi * 1.5 * piece.time)[:, None]).max() < 61


def test_sums_of_clocks_that_nearly_coincide_are_no_longer_than_samples_need():
    t = np.sort(np.concatenate([0.02 * np.arange(500), 0.02 * np.arange(500) + 2e-6]))
    assert len(summed(t, 2.0, np.ones((1000, 1)))) < 1000


def test_sums_of_a_recording_go_into_those_of_all_at_its_end(rng):
    """They take gigabytes otherwise, of twenty recordings at 1 kHz."""
    time, rows = 0.01 * np.arange(300), rng.normal(size=(2, 300, 2))
    motion = RepeatedMotion({0: 0.0, 1: 10.0}, 1.0, 10.0, np.array([[0.7], [0.4]]), np.ones(1))
    pieces = [SimpleNamespace(time=time, when=time, log=log) for log in (0, 1)]
    sums = sandwich._Repeated(motion, SimpleNamespace(pieces=pieces, theta=np.zeros(2)))
    white = SimpleNamespace(times=np.zeros(1), amplitudes=np.ones((2, 1, 1)))
    for log in (0, 1):
        sums.add((0, 0, 0), log, time, np.arange(2), rows[log])
        sums.end(log, white)
        assert sums._sums[0, 0, 0].keys() == {sandwich.ALL}
    across, within = sums.scatters(white)
    one, other = rows.reshape(2, 3, 100, 2).sum(axis=1)
    np.testing.assert_allclose(across, 0.4 * (one + other).T @ (one + other))
    for log, own in enumerate((one, other)):
        np.testing.assert_allclose(within[log], 0.3 * own.T @ own)


@pytest.mark.parametrize("pause", [0.0, 20.0, 3600.0])
def test_pauses_are_no_periods(rng, pause):
    once, t = rng.normal(size=(200, 1)), 0.01 * np.arange(600)
    times, residuals = [t, t + t[-1] + 0.01 + pause], [np.tile(once, (3, 1))] * 2
    correlation, _, factor = repetition(times, residuals, of_period(2.0))
    assert correlation == pytest.approx(1, abs=0.01) and factor == pytest.approx(6, rel=0.01)


@pytest.mark.parametrize("share", [0.0, 0.5, 1.0])
def test_variance_of_sums_of_residuals_that_repeat(rng, share):
    """Against sums over draws: a column that repeats, times residuals of which a share repeats."""
    periods, number = 5, 200
    column, t = np.tile(rng.normal(size=number), periods), 0.01 * np.arange(periods * number)
    same = np.tile(rng.normal(size=(400, number)), (1, periods))
    e = np.sqrt(share) * same + np.sqrt(1 - share) * rng.normal(size=same.shape)
    counted = np.mean((e @ column) ** 2) / (column @ column)
    correlation, across, factors = repetition([t], [e.T], of_period(0.01 * number))
    assert not across.any()
    assert factors.mean() == pytest.approx(counted, rel=0.25)
    assert factors.mean() == pytest.approx(1 + share * (periods - 1), abs=0.15)
    np.testing.assert_allclose(factors, 1 + correlation * (periods - 1))


def fit_of(*pieces):
    """A fit of recordings of one piece each, as far as `trials` reads it."""
    noises = [SimpleNamespace(states=np.zeros(pieces[0].states.shape[1]))] * len(pieces)
    pieces = [SimpleNamespace(log=log, **vars(piece)) for log, piece in enumerate(pieces)]
    return SimpleNamespace(pieces=pieces, noises=noises, coordinate_noise=noises[0].states, channel_noise=np.zeros(1))


@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize(("late", "clock"), [(0, 0.0), (120, 0.0), (-120, 50.0)])
def test_lateness_of_a_recording_of_the_same_motion(rng, late, clock, noise):
    whole = motion(rng, 20.0, *IRRATIONAL)
    first, other = part(whole, 200, 1200, 0.0), part(whole, 200 - late, 1200 - late, clock)
    for each in (first, other):
        each.states = each.states + noise * rng.normal(size=each.states.shape)
    assert lateness([first], [other], np.full(3, noise), 10.0) == pytest.approx(0.01 * late + clock, abs=0.011)


def test_other_motions_are_no_trials_of_one(rng):
    """Nor are logs that share a long rest alone."""
    a, b = motion(rng, 10.0, *IRRATIONAL), motion(rng, 10.0, *OTHER)
    assert lateness([a], [b], np.zeros(3), 10.0) == np.inf
    assert [list(each.starts) for each in trials(fit_of(a, b, a, b, a))] == [[0, 2, 4], [1, 3]]
    rest, (one, other) = np.zeros((600, 3)), (motion(rng, 4.0, *ratios).states for ratios in (IRRATIONAL, OTHER))
    start = np.sin(np.linspace(0, np.pi, 400))[:, None] ** 2
    logs = np.vstack([rest, start * one]), np.vstack([start * other, rest])
    logs = [SimpleNamespace(time=np.arange(1000) / 100, states=x) for x in logs]
    assert lateness(logs[:1], logs[1:], np.zeros(3), 10.0) == np.inf


def test_trials_in_a_row_are_periods_of_one_recording(rng):
    """In phase, also where the motion repeats within each of them."""
    whole, starts = motion(rng, 30.0, 1, 2, 3), np.array([0, 70, 1234])
    (own,) = trials(fit_of(*(part(whole, start, start + 1500, 0.0) for start in starts)))
    assert own.lag == own.period == pytest.approx(1 / 0.3, abs=0.011)
    phases, expected = ((x + 0.5) % 1 - 0.5 for x in (np.array([*own.starts.values()]) / own.period, 3e-3 * starts))
    assert phases == pytest.approx(expected, abs=0.02)
    assert min(np.diff(list(own.starts.values()))) > 15


@pytest.mark.parametrize(("same", "factor"), [(True, 3.0), (False, 1.0)])
def test_residuals_of_trials_count_once(rng, same, factor):
    whole = motion(rng, 10.0, *IRRATIONAL)
    logs = whole, part(whole, 0, 1000, 7.0), whole
    (own,) = trials(fit_of(*logs))
    errors = rng.normal(size=(1 if same else 3, 1000, 20))
    times = [piece.time + own.starts[log] for log, piece in enumerate(logs)]
    *_, factors = repetition(times, [*errors] * (3 // len(errors)), own)
    assert factors.mean() == pytest.approx(factor, abs=0.1)


PERIOD = 1 / 0.15  # Of the arm's sums of sinusoids, s.
PRIOR = {"known": None}  # Options that let bodies be a prior.


@cache
def estimated(periods, size, known=False, heavier=1.0, logs=1, own=()):
    """Estimate of the arm in some periods of a motion, with torques of a size that repeat with it and have no cause.

    In each of several logs, with other noise.
    """
    rng, draws = np.random.default_rng(3), np.random.default_rng(4)
    t, *states = arm.motion(rng, periods * PERIOD, 50.0)
    torque = arm.torques(*states) + np.array(arm.TRUE["frictionloss"]) * np.tanh(states[1] / 0.003)
    angle, sizes = 2 * np.pi / PERIOD * np.outer(t, np.arange(1, 21)), rng.normal(size=(3, 2, 20))
    torque += size * np.einsum("tkw,jkw->tj", np.stack([np.sin(angle), np.cos(angle)], axis=1), sizes)
    recordings = []
    for _ in range(logs):
        noise = draws.normal(size=(2, *torque.shape))
        channels = by_joint(arm.JOINTS, torque=torque + 0.02 * noise[0], position=states[0] + 1e-4 * noise[1])
        recordings.append(ident.Recording(t, channels))
    model = replace(arm.mechanism(), prior=heavier * arm.mechanism().prior)
    return ident.identify(model, recordings, known=known, holdout=0, own=own)


def std_of(fit):
    """Standard deviations of the first base parameters."""
    return np.diag(fit.covariance)[:9] ** 0.5


@pytest.mark.parametrize(("size", "given", "least", "most"), [(0.0, PRIOR, 0.6, 0.8), (0.02, {}, 0.9, 1.5)])
def test_more_periods_tell_more_unless_what_is_not_explained_repeats(size, given, least, most):
    few, many = estimated(2.5, size), estimated(5, size, **given)
    # Twice the periods would make them .71 as large; widths of friction near rest differ between the two.
    assert least < np.median(std_of(many.trajectory.fit) / std_of(few.trajectory.fit)) < most


def test_two_trials_of_a_motion_tell_no_more_than_one_if_what_is_not_explained_repeats():
    few, many = (estimated(1.5, 0.02, logs=number) for number in (1, 2))
    assert 0.9 < np.median(std_of(many.trajectory.fit) / std_of(few.trajectory.fit)) < 1.1
    assert [each.values["logs"] for each in many.findings if each.code == "logs_repeat"] == [(1, 2)]


def test_what_repeats_counts_once_for_what_logs_share_alone(monkeypatch):
    """Friction of each log for itself is told by that log alone."""
    joint = estimated(1.5, 0.02, logs=3, own=("friction",)).trajectory
    monkeypatch.setattr(sandwich, "repetitions", lambda measurement, fit: trials(fit))
    alone = with_scatter(joint.measurement, joint.fit)
    ratio = np.sqrt(np.diag(joint.fit.covariance) / np.maximum(np.diag(alone.covariance), 1e-300))
    rubs = np.array([name.startswith(("Fv(", "Fc(")) for name in joint.fit.names])
    assert np.median(ratio[:9]) > 1.5 and np.median(ratio[rubs]) < 1.15


def test_what_repeats_is_counted_in_all_pieces(monkeypatch):
    """Also if the noise is estimated from a third of them, of which none is a period after another."""
    joint = estimated(5, 0.02).trajectory
    monkeypatch.setattr(noise_colours, "ENOUGH", 500)
    some = std_of(with_scatter(joint.measurement, joint.fit))
    assert np.median(some / std_of(joint.fit)) > 0.9


@pytest.mark.parametrize(
    ("size", "given", "taken"), [(0.0, PRIOR, False), (0.02, PRIOR, True), (0.02, PRIOR | {"heavier": 2.5}, False)]
)
def test_bodies_are_a_prior_where_pieces_repeat_their_errors_unless_they_are_wrong(size, given, taken):
    estimate = estimated(5, size, **given)
    assert estimate.trajectory.known == taken
    repeats = [each.values["periods"] for each in estimate.findings if each.code == "motion_repeats"]
    assert repeats == [(pytest.approx(PERIOD, abs=0.021),)] * bool(size)
