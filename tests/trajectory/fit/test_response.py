"""Rank that a fit takes of the noise, against the normal equations of the same piece."""

from functools import cache

import numpy as np
import pytest
from test_piece import problem

from ident.trajectory.fit.response import response


@cache
def own(seed):
    p = problem(seed)
    return response(p.measurement, p.piece, p.coefficients, p.theta, p.noise)


def close(a, b):
    np.testing.assert_allclose(a, b, rtol=1e-7, atol=1e-7 * np.abs(b).max())


@pytest.mark.parametrize("seed", range(4))
def test_the_rows_of_theta_give_its_precision(seed):
    p, here = problem(seed), own(seed)
    rows = here.rows()
    pulls = [stream.weights(x) for stream, x in zip(here.streams, rows, strict=True)]
    precision = sum(np.einsum("nsp,nsq->pq", x, y) for x, y in zip(rows, pulls, strict=True))
    penalty, _ = p.penalty
    close(precision + here.follows.T @ penalty @ here.follows, p.linearised.schur)


@pytest.mark.parametrize("seed", range(4))
def test_signals_and_their_adjoint_belong_together(seed):
    here, rng = own(seed), np.random.default_rng(seed)
    c, theta = rng.normal(size=(len(here.follows), 2)), rng.normal(size=(here.follows.shape[1], 2))
    forward = here.signals(c, theta)
    y = [rng.normal(size=x.shape) for x in forward]
    of_c, of_theta = here.adjoint(y)
    close(
        (of_c * c).sum(axis=0) + (of_theta * theta).sum(axis=0),
        sum((x * z).sum(axis=(0, 1)) for x, z in zip(forward, y, strict=True)),
    )


@pytest.mark.parametrize("seed", range(4))
def test_residuals_pull_as_the_gradient_says(seed):
    p, here = problem(seed), own(seed)
    pulls = [stream.weights(stream.residual[..., None]) for stream in here.streams]
    c, theta = here.adjoint(pulls)
    penalty, _ = p.penalty
    right = c[:, 0] - penalty @ p.coefficients.ravel()
    close(theta[:, 0] - here.follows.T @ right, p.linearised.gradient)
    close(here.solved(right[:, None])[:, 0], p.linearised.step)


def test_weights_are_symmetric_and_leave_missing_samples_out():
    here, rng = own(1), np.random.default_rng(0)
    for stream in here.streams:
        x, y = rng.normal(size=(2, *stream.residual.shape, 1))
        close((x * stream.weights(y)).sum(axis=0), (y * stream.weights(x)).sum(axis=0))
        assert not stream.weights(x)[stream.weights.scale == 0].any()
