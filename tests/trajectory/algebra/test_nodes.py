"""Channels at Gauss nodes of every interval give what they give at every sample."""

from dataclasses import replace

import numpy as np
import pytest
from measurements import random_measurement

from ident.trajectory.algebra.nodes import NODES, WORTH_IT, lagrange
from ident.trajectory.algebra.spline import Spline
from ident.trajectory.fit import piece as piece_module
from ident.trajectory.fit.piece import Noise, Piece
from ident.trajectory.fit.piece_equations import linearised, misfit
from ident.trajectory.fit.response import response

PER_INTERVAL = 40


def test_polynomials_through_the_nodes():
    """They reproduce polynomials of a degree below the number of nodes, also at the nodes and beyond the ends."""
    places = np.polynomial.legendre.leggauss(NODES)[0] / 2 + 0.5
    u = np.concatenate([places, np.linspace(-0.05, 1.05, 50)])
    coefficients = np.random.default_rng(0).normal(size=NODES)
    np.testing.assert_allclose(lagrange(u) @ np.polyval(coefficients, places), np.polyval(coefficients, u), rtol=1e-9)


def smooth_problem(seed):
    """A piece of a smooth motion with many samples of a wrench in every interval, some missing, some outliers."""
    rng = np.random.default_rng(seed)
    m = random_measurement(rng, 3, ("revolute", "prismatic"), torques=False, contacts=0)
    n, C, p = m.coordinates, len(m.equations.channels), len(m.names)
    spline = Spline(0.0, 0.2, 8)
    time = np.linspace(0.01, 1.59, 8 * PER_INTERVAL)
    middles = spline.step * (np.arange(spline.size) - 2)
    c = np.sin(middles[:, None] * rng.uniform(1, 3, n) + rng.uniform(0, 6, n))
    theta = rng.normal(size=p)
    theta[len(m.equations.names) :] *= 0.01
    noise = Noise(
        states=np.full(n, 0.01),
        channels=rng.uniform(1, 2, size=C),
        jerk=np.full(n, 1e-3),
        states_rho=np.zeros(n),
        channels_rho=np.zeros(C),
        floor_states=np.zeros(n),
        floor_channels=np.zeros(C),
    )
    x = spline.evaluate(c, time)[0] + 0.01 * rng.normal(size=(len(time), n))
    piece = Piece(spline, time, x, time, np.zeros((len(time), C)), np.zeros((len(time), 2, 0)), 0.3)
    exact = m.values(spline.evaluate(c, time)[:3], piece.wrenches, theta).T
    measured = exact + noise.channels * rng.normal(size=exact.shape)
    measured[rng.uniform(size=exact.shape) < 0.05] = np.nan
    measured[rng.uniform(size=exact.shape) < 0.01] += 20
    return m, replace(piece, measured=measured), c, theta, noise


def both(monkeypatch, function):
    """Results by nodes and by samples."""
    by_nodes = function()
    monkeypatch.setattr(piece_module, "WORTH_IT", np.inf)
    return by_nodes, function()


@pytest.mark.parametrize("seed", range(3))
def test_equations_of_a_piece(seed, monkeypatch):
    m, piece, c, theta, noise = smooth_problem(seed)
    assert len(piece.when) > WORTH_IT * NODES * piece.spline.intervals and m.smooth
    root = np.random.default_rng(seed).normal(size=(len(theta), 4)) * 0.1
    one, other = both(monkeypatch, lambda: linearised(m, piece, c, theta=theta, noise=noise, root=root))
    one, other = (part._asdict() | part.eliminated._asdict() for part in (one, other))
    for name in one.keys() - {"eliminated", "factors"}:
        a, b = np.asarray(one[name]), np.asarray(other[name])
        np.testing.assert_allclose(a, b, rtol=1e-9, atol=1e-9 * np.abs(b).max(), err_msg=name)


@pytest.mark.parametrize("seed", range(2))
def test_misfit_and_response(seed, monkeypatch):
    m, piece, c, theta, noise = smooth_problem(seed)

    def results():
        own = misfit(m, piece, c, theta=theta, noise=noise)
        here = response(m, piece, c, theta, noise)
        return [own.cost, own.squares, *map(here.rows, range(len(here.streams))), *here.followed(np.array([0.5, 2.0]))]

    for a, b in zip(*both(monkeypatch, results), strict=True):
        np.testing.assert_allclose(a, b, rtol=1e-8, atol=1e-8 * np.abs(b).max())


def test_contacts_dry_friction_and_slack_are_evaluated_at_samples():
    rng = np.random.default_rng(0)
    assert not random_measurement(rng, 2, torques=False, contacts=1).smooth
    rubs = random_measurement(rng, 2, torques=True, contacts=0)
    assert not rubs.smooth
    without = [name for name in rubs.equations.drives if name.startswith(("Ia", "Fv", "K"))]
    assert replace(rubs, equations=rubs.equations.with_drives(without)).smooth
    piece, still = smooth_problem(0)[1], np.zeros((1, 2), bool)
    assert piece.nodes(piece.when, still) is not None and piece.nodes(piece.when + 0.01, still) is not None
    assert replace(piece, slack=np.ones_like(piece.measured)).nodes(piece.when, still) is None
    few = slice(None, None, 3)
    assert replace(piece, when=piece.when[few]).nodes(piece.when[few], still) is None
