"""Plates with delays of a tenth of a second and more, as in laboratories for lifting."""

from dataclasses import replace
from types import SimpleNamespace

import lifting
import numpy as np
import pytest
from recorded_faults import PENDULUM, faulty

import ident
from ident.estimation.measurement import Measurement
from ident.estimation.preparation import prepared
from ident.estimation.setup_parameters import SetupParameter
from ident.model.regressor import base_wrench_regressor
from ident.trajectory.cut_pieces import cut
from ident.trajectory.fit.fitted import Prior
from ident.trajectory.late_start import likely_delay

pytestmark = pytest.mark.slow

LIFTS = (lifting.SQUAT, 0.35), (lifting.STOOP, 0.4)


def later(recording, start):
    """A recording on a clock with another origin."""
    streams = {name: (x.time + start, x.values) for name, x in recording.streams.items()}
    return replace(recording, time=recording.time + start, streams=streams)


def lifts(who, seed, begin, seconds=3.0):
    """Recordings of lifts on a clock with another origin."""
    recordings = [lifting.recorded(who, *lift, seed + k, seconds=seconds) for k, lift in enumerate(LIFTS)]
    return [later(each, start) for each, start in zip(recordings, begin, strict=True)]


def only_finding(log, **options):
    (finding,) = ident.identify(lifting.table(), log, known=True, holdout=0.2, **options).setup
    assert finding.name == "delay(ground)"
    return finding


@pytest.mark.parametrize(("seed", "late"), [(1, -0.08), (0, 0.15)])
def test_plates_that_are_far_from_the_angles_clock_are_found(seed, late, monkeypatch):
    monkeypatch.setattr(lifting, "LATE", late)
    finding = only_finding(lifts(lifting.lifter(seed), 10 * seed, (1000.0, 1100.0)))
    assert finding.value == pytest.approx(late, abs=0.004)
    assert ("ms late" if late > 0 else "ms early") in finding.text


def test_lifts_that_were_selected_of_one_long_recording(monkeypatch):
    """Far from the clock's origin, a rate error resembles a delay."""
    monkeypatch.setattr(lifting, "LATE", 0.13)
    who, lows = lifting.lifter(2), (*LIFTS, (lifting.SQUAT, 0.5))
    parts = [lifting.recorded(who, *lift, 20 + k, seconds=6 if k else 1) for k, lift in enumerate(lows)]
    parts = [later(each, start) for each, start in zip(parts, (1000.0, 1014.0, 1024.0), strict=True)]
    time = np.concatenate([part.time for part in parts])
    streams = {name: (time, np.concatenate([part[name] for part in parts])) for name in parts[0].measured}
    judge = lifting.recorded(who, (lifting.SQUAT + lifting.STOOP) / 2, 0.45, 25)
    finding = only_finding(ident.Recording.from_streams(streams, sensors=parts[0].sensors), held_out=judge)
    assert finding.value == pytest.approx(0.13, abs=0.004)


def test_a_clock_that_is_fast_is_no_delay():
    """Over forty seconds a fast clock amounts to a tenth of a second."""
    who, rng, fast, time = lifting.lifter(0), np.random.default_rng(0), 0.003, np.arange(0, 40, 0.04)
    motion, before = (lifting.motion(t, lifting.SQUAT, 0.35, 0) for t in (time, (1 - fast) * time))
    wrench = base_wrench_regressor(who.tree, *before.states, gravity=who.gravity) @ who.known
    wrench += lifting.FORCE * np.array([1, 1, 1, 0.2, 0.2, 0.2]) * rng.normal(size=wrench.shape)
    wrench[:, [1, 3, 5]] = np.nan
    channels = {"ground_force": wrench[:, :3], "ground_torque": wrench[:, 3:]}
    angles = motion.q + 0.002 * rng.normal(size=motion.q.shape)
    channels |= {f"{joint}_position": x for joint, x in zip(lifting.JOINTS, angles.T, strict=True)}
    (finding,) = ident.identify(lifting.table(), ident.Recording(time, channels), known=True).setup
    assert finding.name == "clock(ground)" and finding.value == pytest.approx(-fast, abs=1e-4)


def test_plates_on_the_angles_clock_are_left_there(monkeypatch):
    monkeypatch.setattr(lifting, "LATE", 0.0)
    assert not ident.identify(lifting.table(), lifts(lifting.lifter(1), 10, (0.0, 0.0)), known=True).setup


def likely_delay_of_pendulum(std, *, missing=0, late=0.0, samples=600):
    """Likely delay of the pendulum's ground for a prior standard deviation, with its first samples missing."""
    recording = faulty(0, delay=late)
    ready = prepared(PENDULUM, recording)
    at, delay = len(ready.equations.names), SetupParameter("delay", "ground", None, std)
    measurement = Measurement(ready.equations, ready.frame, tuple(range(6)), {}, (delay,))
    pieces = cut(ready, measurement, slice(0, samples), 0.05)
    for piece in pieces:
        piece.measured[piece.when < recording.time[missing]] = np.nan
    theta = np.append(ready.equations.parameters.regroup(PENDULUM.known), 0.0)
    prior = Prior(np.zeros(at + 1), np.diag(np.append(np.zeros(at), std**-2.0)))
    fit = SimpleNamespace(theta=theta, prior=prior, pieces=pieces, selections=[np.arange(at + 1)] * len(pieces))
    return likely_delay(measurement, at, fit)


@pytest.mark.parametrize("std", [10.0, 1e6, np.inf])
def test_delays_that_are_longer_than_a_recording_are_no_candidates(std):
    assert likely_delay_of_pendulum(std, late=0.1) == pytest.approx(0.1)
