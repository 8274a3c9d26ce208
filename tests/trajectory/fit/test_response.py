"""Rows of θ and what a trajectory follows, against the normal equations of the same piece."""

from functools import cache

import numpy as np
import pytest
from test_piece import problem

from ident.trajectory.algebra.sampling import Sampling
from ident.trajectory.algebra.spline import LOCAL, Spline
from ident.trajectory.fit.piece import Point
from ident.trajectory.fit.response import Response, Stream, Weights, response


@cache
def own(seed):
    p = problem(seed)
    return response(p.measurement, Point(p.piece, p.coefficients, p.theta, p.noise))


def close(a, b):
    np.testing.assert_allclose(a, b, rtol=1e-7, atol=1e-7 * np.abs(b).max())


@pytest.mark.parametrize("seed", range(2))
def test_rows_and_motion_give_the_right_side_of_theta(seed):
    """The right side with the trajectory eliminated, from the residuals and the motion that the penalty smooths."""
    p, here = problem(seed), own(seed)
    penalty, _ = p.penalty
    right = here.smoothed.T @ penalty @ p.coefficients.ravel()
    for k, stream in enumerate(here.streams):
        right += np.einsum("ns,nsp->p", stream.residual, stream.weights(here.rows(k)))
    close(right, p.linearised.eliminated.gradient)
    close(here.scatter_of_motion, here.smoothed.T @ penalty @ here.smoothed)


@pytest.mark.parametrize("inertia", [0.01, 0.1, lambda time: 0.05 * (time % 5 < 2.5)])
def test_a_trajectory_follows_what_elimination_says(inertia):
    """An inertia that turns, perhaps only seen at times: shares of sinusoids of the angle and of the torque."""
    samples, spline, every = 1000, Spline(0.0, 0.1, 100), np.arange(1000) / 100 + 0.005
    std, jerk, at = np.array([0.01, 0.1]), 1e-7, Sampling(spline, every)
    inertia = np.broadcast_to(inertia(every[:, None]) if callable(inertia) else inertia, (samples, 1))
    functions = np.zeros((3, samples, spline.size))
    functions[:, range(samples), at.local.interval + np.arange(LOCAL)[:, None]] = at.local.basis[:3].swapaxes(1, 2)
    angle, torque = functions[0], inertia * functions[2]
    scales = [np.full((samples, 1), 1 / each) for each in std]
    by_states = inertia[..., None] * [0.0, 0.0, 1.0]
    streams = [
        Stream(every, at, None, Weights(scale, 0 * scale), 0 * scale, scale > 0, *rest)
        for scale, rest in (
            (scales[0], (std[:1], None)),
            (scales[1], (std[1:], None, (by_states, np.zeros((samples, 1, 0))))),
        )
    ]
    here = Response(streams, {}, None, spline, np.array([jerk]))
    penalty = jerk * (spline.roots.T @ spline.roots).toarray()
    A = angle.T @ angle / std[0] ** 2 + torque.T @ torque / std[1] ** 2 + penalty
    frequency = np.array([1.0, 1.5, 2.0, 3.0])
    for rows, size, share in zip((angle, torque), std, here.followed(frequency), strict=True):
        waves = np.exp(2j * np.pi * every[:, None] * frequency)
        pulled = rows.T @ waves / size
        exact = (pulled.conj() * np.linalg.solve(A, pulled)).sum(axis=0).real / samples
        assert share.mean(axis=0)[:, 0] == pytest.approx(exact, abs=0.03)
