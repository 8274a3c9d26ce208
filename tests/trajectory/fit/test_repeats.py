"""Motions that repeat: the period, and residuals that repeat with it, which count once."""

from dataclasses import replace
from functools import cache
from types import SimpleNamespace

import driven_arm as arm
import numpy as np
import pytest

import ident
from ident.trajectory.fit import noise_colours, sandwich
from ident.trajectory.fit.repeats import RepeatedMotion, lateness, period, repetition, trials
from ident.trajectory.fit.sandwich import with_scatter

PERIOD = 1 / 0.15
"""Period of the arm's sums of sinusoids, s."""


@pytest.fixture
def rng():
    return np.random.default_rng(0)


def motion(rng, seconds, *multiples, noise=0.0, step=0.01):
    """A piece whose joints follow sums of sinusoids of multiples of .3 Hz, and one of which rests."""
    t = step * np.arange(round(seconds / step))
    waves = [np.sin(2 * np.pi * 0.3 * k * t + rng.uniform(0, 6)) for k in multiples]
    q = np.array([np.sum(waves, axis=0), waves[0] - waves[-1], np.zeros(len(t))]).T
    return SimpleNamespace(time=t, states=q + noise * rng.normal(size=q.shape))


@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize(
    ("multiples", "expected"), [((1, 2, 3), 1 / 0.3), ((2, 3, 4.5), 2 / 0.3), ((1, 2**0.5, 3), np.inf)]
)
def test_period_of_a_motion(rng, multiples, expected, noise):
    piece = motion(rng, 30.0, *multiples, noise=noise)
    assert period([piece], np.full(3, noise)) == pytest.approx(expected, abs=0.011)


def test_the_last_of_many_periods_is_in_phase(rng):
    """Also if a period is no number of samples."""
    piece = motion(rng, 200.0, 1, 2, 3, step=0.02)
    T = period([piece], np.zeros(3))
    assert 60 * abs(T - 1 / 0.3) < 0.04
    own = RepeatedMotion({0: 0.0}, T, np.inf, np.ones((2, 1)), np.ones(1))
    piece.log, piece.when = 0, piece.time
    sums = sandwich._Repeated(own, SimpleNamespace(pieces=[piece], theta=np.zeros(1)))
    wave = np.sin(2 * np.pi * 1.5 * piece.time)[:, None]
    sums.add((0, 0, 0), 0, piece.time, np.array([0]), wave)
    assert 58 < sums._sums[0, 0, 0][0].max() < 61


def test_a_motion_repeats_across_pieces_and_gaps(rng):
    whole = motion(rng, 30.0, 1, 2, 3)
    pieces = [SimpleNamespace(time=whole.time[k], states=whole.states[k]) for k in (slice(0, 900), slice(1100, 3000))]
    assert period(pieces, np.zeros(3)) == pytest.approx(1 / 0.3, abs=0.011)


@pytest.mark.parametrize(("multiples", "expected"), [((1, 2, 3), 1 / 0.3), ((1, 2**0.5, 3), np.inf)])
def test_period_of_joints_with_clocks_of_their_own(rng, multiples, expected):
    piece = motion(rng, 30.0, *multiples, step=0.005)
    piece.states[1::2, 0] = piece.states[::2, 1] = np.nan
    assert period([piece], np.zeros(3)) == pytest.approx(expected, abs=0.011)


def test_a_coordinate_that_is_not_there_does_not_matter(rng):
    piece = motion(rng, 30.0, 1, 2, 3)
    piece.states[:, 2] = np.nan
    assert period([piece], np.zeros(3)) == pytest.approx(1 / 0.3, abs=0.011)


def of_period(period):
    return RepeatedMotion({0: 0.0}, period, np.inf, np.zeros((2, 1)), np.ones(1))


@pytest.mark.parametrize("pause", [0.0, 20.0, 3600.0])
def test_pauses_are_no_periods(rng, pause):
    once, t = rng.normal(size=(200, 1)), 0.01 * np.arange(600)
    times, residuals = [t, t + t[-1] + 0.01 + pause], [np.tile(once, (3, 1))] * 2
    correlation, _, factor = repetition(times, residuals, of_period(2.0))
    assert correlation == pytest.approx(1, abs=0.01) and factor == pytest.approx(6, rel=0.01)


def test_less_than_two_periods_are_none(rng):
    assert period([motion(rng, 6.0, 1, 2, 3)], np.zeros(3)) == np.inf


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


@pytest.mark.parametrize(("step", "told"), [(0.5, True), (0.6, False), (1.9, False), (4.5, False)])
def test_channels_that_are_slower_than_the_motion_tell_no_phases(rng, step, told):
    """A residual of 2 s, sampled less than four times in a period."""
    t = step * np.arange(400)
    correlation, _, factor = repetition([t], [np.sin(np.pi * t + 0.3)[:, None]], of_period(2.0))
    assert (correlation > 0.5, factor > 1.5) == (told, told)


def test_sums_of_clocks_that_nearly_coincide_are_no_longer_than_samples_need(rng):
    t = np.sort(np.concatenate([0.02 * np.arange(500), 0.02 * np.arange(500) + 2e-6]))
    piece = SimpleNamespace(time=t, when=t, log=0)
    sums = sandwich._Repeated(of_period(2.0), SimpleNamespace(pieces=[piece], theta=np.zeros(1)))
    sums.add((0, 0, 0), 0, t, np.array([0]), np.ones((1000, 1)))
    assert len(sums._sums[0, 0, 0][0]) < 1000


def fit_of(*pieces):
    """A fit of recordings of one piece each, as far as `trials` reads it."""
    noises = [SimpleNamespace(states=np.zeros(pieces[0].states.shape[1]))] * len(pieces)
    pieces = [SimpleNamespace(log=log, **vars(piece)) for log, piece in enumerate(pieces)]
    return SimpleNamespace(pieces=pieces, noises=noises, coordinate_noise=noises[0].states, channel_noise=np.zeros(1))


def part(whole, start, stop, clock=0.0):
    """Part of a piece, with times of its own."""
    return SimpleNamespace(time=whole.time[start:stop] - whole.time[start] + clock, states=whole.states[start:stop])


@pytest.mark.parametrize("noise", [0.0, 0.1])
@pytest.mark.parametrize(("late", "clock"), [(0, 0.0), (120, 0.0), (-120, 50.0)])
def test_lateness_of_a_recording_of_the_same_motion(rng, late, clock, noise):
    whole = motion(rng, 20.0, 1, 2**0.5, 5**0.5)
    first, other = part(whole, 200, 1200), part(whole, 200 - late, 1200 - late, clock)
    for each in (first, other):
        each.states = each.states + noise * rng.normal(size=each.states.shape)
    assert lateness([first], [other], np.full(3, noise), 10.0) == pytest.approx(0.01 * late + clock, abs=0.011)


def test_other_motions_are_no_trials_of_one(rng):
    one, other = motion(rng, 10.0, 1, 2**0.5, 5**0.5), motion(rng, 10.0, 1.1, 1.9, 2.3)
    assert lateness([one], [other], np.zeros(3), 10.0) == np.inf
    assert [each.starts for each in trials(fit_of(one, other))] == [{0: 0.0}, {1: 0.0}]


def test_logs_that_share_a_long_rest_alone_are_no_trials_of_one(rng):
    moves = [motion(rng, 4.0, *ratios).states for ratios in ((1, 2**0.5, 5**0.5), (1.1, 1.9, 2.3))]
    rest, start = np.zeros((600, 3)), np.sin(np.linspace(0, np.pi, len(moves[0])))[:, None] ** 2
    one, other = np.vstack([rest, start * moves[0]]), np.vstack([start * moves[1], rest])
    logs = [SimpleNamespace(time=np.arange(len(x)) / 100, states=x) for x in (one, other)]
    assert lateness(logs[:1], logs[1:], np.zeros(3), 10.0) == np.inf


def test_trials_of_two_motions(rng):
    a, b = motion(rng, 10.0, 1, 2**0.5, 5**0.5), motion(rng, 10.0, 1.1, 1.9, 2.3)
    assert [list(each.starts) for each in trials(fit_of(a, b, a, b, a))] == [[0, 2, 4], [1, 3]]


def test_trials_in_a_row_are_periods_of_one_recording(rng):
    """In phase, also where the motion repeats within each of them."""
    whole = motion(rng, 30.0, 1, 2, 3)
    (own,) = trials(fit_of(*(part(whole, start, start + 1500) for start in (0, 70, 1234))))
    assert own.lag == own.period == pytest.approx(1 / 0.3, abs=0.011)
    phases = [(start / own.period + 0.5) % 1 - 0.5 for start in own.starts.values()]
    expected = [(0.01 * start * 0.3 + 0.5) % 1 - 0.5 for start in (0, 70, 1234)]
    assert phases == pytest.approx(expected, abs=0.02)
    assert min(np.diff(list(own.starts.values()))) > 15


@pytest.mark.parametrize(("same", "factor"), [(True, 3.0), (False, 1.0)])
def test_residuals_of_trials_count_once(rng, same, factor):
    whole = motion(rng, 10.0, 1, 2**0.5, 5**0.5)
    (own,) = trials(fit_of(whole, part(whole, 0, 1000, 7.0), whole))
    errors = rng.normal(size=(1 if same else 3, 1000, 20))
    times = [piece.time + own.starts[log] for log, piece in enumerate((whole, part(whole, 0, 1000, 7.0), whole))]
    *_, factors = repetition(times, [*errors] * (3 // len(errors)), own)
    assert factors.mean() == pytest.approx(factor, abs=0.1)


@cache
def estimated(periods, size, known=False, heavier=1.0, logs=1, own=()):
    """Estimate of the arm in some periods of a motion, with torques of a size that repeat with it and have no cause.

    In each of several logs, with other noise.
    """
    rng = np.random.default_rng(3)
    t, *states = arm.motion(rng, periods * PERIOD, 50.0)
    torque = arm.torques(*states) + np.array(arm.TRUE["frictionloss"]) * np.tanh(states[1] / 0.003)
    waves = 2 * np.pi / PERIOD * np.outer(t, np.arange(1, 21))
    torque += size * np.einsum(
        "tkw,jkw->tj", np.stack([np.sin(waves), np.cos(waves)], axis=1), rng.normal(size=(3, 2, 20))
    )
    draws, recordings = np.random.default_rng(4), []
    for _ in range(logs):
        noise = draws.normal(size=(2, *torque.shape))
        measured = (torque + 0.02 * noise[0]).T, (states[0] + 1e-4 * noise[1]).T
        channels = {f"{joint}_torque": x for joint, x in zip(arm.JOINTS, measured[0], strict=True)}
        channels |= {f"{joint}_position": x for joint, x in zip(arm.JOINTS, measured[1], strict=True)}
        recordings.append(ident.Recording(t, channels))
    model = replace(arm.mechanism(), prior=heavier * arm.mechanism().prior)
    return ident.identify(model, recordings, known=known, holdout=0, own=own)


@pytest.mark.parametrize(("size", "least", "most"), [(0.0, 0.65, 0.8), (0.02, 0.9, 1.5)])
def test_more_periods_tell_more_unless_what_is_not_explained_repeats(size, least, most):
    few, many = (np.diag(estimated(periods, size).trajectory.fit.covariance)[:9] ** 0.5 for periods in (2.5, 5))
    assert least < np.median(many / few) < most


@pytest.mark.parametrize(("size", "logs"), [(0.0, 3), (0.02, 2)])
def test_trials_of_a_motion_tell_more_than_one_unless_what_is_not_explained_repeats(size, logs):
    few, many = (estimated(1.5, size, logs=number) for number in (1, logs))
    few_std, many_std = (np.diag(each.trajectory.fit.covariance)[:9] ** 0.5 for each in (few, many))
    ratio = np.median(many_std / few_std)
    assert (0.9 < ratio < 1.1) if size else (0.5 < ratio < 0.65)
    expected = [tuple(range(1, logs + 1))] * bool(size)
    assert [each.values["logs"] for each in many.findings if each.code == "logs_repeat"] == expected


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
    some = with_scatter(joint.measurement, joint.fit).covariance
    assert np.median(np.diag(some)[:9] / np.diag(joint.fit.covariance)[:9]) > 0.8


@pytest.mark.parametrize(("size", "heavier", "taken"), [(0.0, 1.0, False), (0.02, 1.0, True), (0.02, 2.5, False)])
def test_bodies_are_a_prior_where_pieces_repeat_their_errors_unless_they_are_wrong(size, heavier, taken):
    estimate = estimated(5, size, None, heavier)
    assert estimate.trajectory.known == taken
    found = [each.values["periods"] for each in estimate.findings if each.code == "motion_repeats"]
    assert found == ([] if not size else [(pytest.approx(PERIOD, abs=0.021),)])
