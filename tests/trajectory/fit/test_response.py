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
def test_rows_and_motion_give_the_right_side_of_theta(seed):
    """The right side after the trajectory's step, for any residuals and any motion from which the penalty pulls."""
    p, here, rng = problem(seed), own(seed), np.random.default_rng(seed)
    penalty, _ = p.penalty
    noise, motion = [rng.normal(size=stream.residual.shape) for stream in here.streams], rng.normal(size=p.size)
    of_c, of_theta = here.adjoint(here.weighted([x[..., None] for x in noise]))
    step = here.solved(of_c - (penalty @ motion)[:, None])
    # Misfit's gradient along c(θ) at the motion after the step: `dc/dθ = -F`.
    moved = here.signals(step, np.zeros((len(of_theta), 1)))
    left = [x[..., None] - y for x, y in zip(noise, moved, strict=True)]
    c, theta = here.adjoint(here.weighted(left))
    expected = theta - here.follows.T @ c
    rows = here.weighted(here.rows())
    right = sum(np.einsum("ns,nsp->p", x, y) for x, y in zip(noise, rows, strict=True))
    close(right + here.smoothed.T @ penalty @ motion, expected[:, 0])
    close(here.scatter_of_motion, here.smoothed.T @ penalty @ here.smoothed)


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
    close(theta[:, 0] - here.follows.T @ right - p.linearised.eliminated.pull, p.linearised.eliminated.gradient)
    close(here.solved(right[:, None])[:, 0], p.linearised.eliminated.step)


def test_weights_are_symmetric_and_leave_missing_samples_out():
    here, rng = own(1), np.random.default_rng(0)
    for stream in here.streams:
        x, y = rng.normal(size=(2, *stream.residual.shape, 1))
        close((x * stream.weights(y)).sum(axis=0), (y * stream.weights(x)).sum(axis=0))
        assert not stream.weights(x)[stream.weights.scale == 0].any()
