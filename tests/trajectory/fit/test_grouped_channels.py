"""Equations of channels grouped by what they depend on, against those of all channels with all coordinates and θ."""

from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np
import pytest
from measurements import random_measurement, random_noise

from ident.estimation.measurement import Measurement
from ident.trajectory.algebra import groups
from ident.trajectory.algebra.spline import Spline
from ident.trajectory.fit.piece import Piece, Point
from ident.trajectory.fit.piece_equations import linearised


@dataclass(frozen=True, eq=False)
class Dense:
    """A measurement whose channels are taken to depend on everything."""

    measurement: Measurement

    def __getattr__(self, name):
        return getattr(self.measurement, name)

    def dependence(self, theta, columns):
        of_states, of_theta = self.measurement.dependence(theta, columns)
        return np.ones_like(of_states), np.ones_like(of_theta)


@contextmanager
def split(monkeypatch):
    """Groups and components as small as they can be, whatever their calls cost."""
    with monkeypatch.context() as patched:
        for name in ("CALLED", "CALLED_OF_COMPONENT", "MOVED"):
            patched.setattr(groups, name, 0.0)
        forget()
        yield
    forget()


def forget():
    groups._groups.cache_clear()
    groups._components.cache_clear()


def problem(seed, **kinds):
    """A measurement of a random tree, and the arguments that linearise a piece of samples with gaps."""
    rng = np.random.default_rng(seed)
    m = random_measurement(rng, 8, ("revolute", "prismatic"), **kinds)
    n, C, p = m.coordinates, len(m.equations.channels), len(m.names)
    time = np.cumsum(rng.uniform(0.02, 0.06, 40))
    time[25:] += 0.4
    when = time[0] + np.cumsum(rng.uniform(0.02, 0.05, 45))
    spline = Spline.over(time[0] - 0.2, time[-1] + 0.2, 0.2)
    coefficients, theta = rng.normal(size=(spline.size, n)), rng.normal(size=p)
    theta[len(m.equations.names) :] *= 0.01
    noise = random_noise(rng, n, C)
    noise.channels_rho[:] *= seed % 2
    states, channels = rng.normal(size=(len(time), n)), 10 * rng.normal(size=(len(when), C))
    states[rng.uniform(size=states.shape) < 0.1] = channels[rng.uniform(size=channels.shape) < 0.1] = np.nan
    wrenches = rng.normal(size=(len(when), 2, 6 * len(m.contacts)))
    piece = Piece(spline, time, states, when, channels, wrenches, 0.3, len(m.components))
    return m, piece, coefficients, theta, noise


KINDS = (
    {"wrench": False, "contacts": 0, "setup": False},
    {"wrench": False, "contacts": 0, "setup": True},
    {"wrench": False, "contacts": 1},
    {"wrench": True, "contacts": 1},
    {"wrench": True, "contacts": 0, "torques": False},
    {"wrench": True, "contacts": 0, "moving": True},
)


@pytest.mark.parametrize("kinds", KINDS)
@pytest.mark.parametrize("seed", range(1))
def test_groups_give_what_all_channels_at_once_give(seed, kinds, monkeypatch):
    m, piece, c, theta, noise = problem(seed, **kinds)
    root = np.triu(np.random.default_rng(seed).normal(size=(len(theta), len(theta))))
    columns = np.flatnonzero(np.random.default_rng(seed).uniform(size=len(theta)) < 0.9)
    at, given = Point(piece, c, theta, noise), {"columns": columns, "root": root[np.ix_(columns, columns)]}
    expected = linearised(Dense(m), at, **given)
    for own in (linearised(m, at, **given), grouped(monkeypatch, m, at, given)):
        for name, value in arrays(own).items():
            other = arrays(expected)[name]
            np.testing.assert_allclose(value, other, rtol=0, atol=1e-9 * np.abs(other).max(), err_msg=name)


def arrays(part):
    every = part._asdict() | part.eliminated._asdict()
    return {name: value for name, value in every.items() if name not in ("eliminated", "factors")}


def grouped(monkeypatch, m, at, given):
    with split(monkeypatch):
        return linearised(m, at, **given)


@pytest.mark.parametrize("kinds", KINDS)
def test_channels_do_not_depend_on_what_is_left_out(kinds):
    m, piece, c, theta, _ = problem(3, **kinds)
    x = piece.spline.evaluate(c, piece.when)[:3]
    of_states, of_theta = m.dependence(theta, np.arange(len(theta)))
    values = m.values(x, piece.wrenches, theta)
    for j in range(m.coordinates):
        moved = x.copy()
        moved[..., j] += 0.1
        changed = (m.values(moved, piece.wrenches, theta) != values).any(axis=1)
        assert (of_states[:, j] >= changed).all()
    for k in range(len(theta)):
        moved = theta.copy()
        moved[k] += 0.1
        changed = (m.values(x, piece.wrenches, moved) != values).any(axis=1)
        assert (of_theta[:, k] >= changed).all()
