"""Gradient of the marginal likelihood of θ, the trajectory integrated out by Laplace's approximation.

    -2 log L(θ) = min_c cost(c, θ) + log |A(θ)|,        A = Jᵀ W J + Σ λ_j P_j

A is the curvature of the cost by the spline coefficients c. Without the second term θ is biased, by several standard
deviations where noise is autocorrelated or strong: slightly smaller motion with slightly larger inertia fits as well
and has a smaller jerk penalty (Wolfinger, Biometrika 80, 1993, doi:10.1093/biomet/80.4.791). Half the second term's
gradient is

    h = tr(A⁻¹ Jᵀ W dJ/dθ) = E[(J z)ᵀ W (dJ/dθ) z],        z ~ N(0, A⁻¹)

where c depends on θ. With many samples a few draws of z suffice.
"""

import numpy as np

from ident.trajectory.fit.piece import Noise, Piece, Predictor
from ident.trajectory.fit.piece_equations import no_wrenches
from ident.trajectory.fit.response import Response, Stream

SMALL = 1e-3
"""Part of a random trajectory taken as the step of a finite difference along it."""


def pull(
    here: Response,
    measurement: Predictor,
    noise: Noise,
    piece: Piece,
    coefficients: np.ndarray,
    theta: np.ndarray,
    columns: np.ndarray,
    draws: int,
    random: np.random.Generator,
) -> np.ndarray:
    """Half the gradient of `log |A|` by entries of θ, for a piece at its likeliest trajectory (k,).

    Args:
        here: Linear response of the piece with these entries as columns.
        measurement: Channels and parameters.
        noise: Standard deviations, correlation and smoothness.
        piece: Measured samples.
        coefficients: Spline coefficients (size, n).
        theta: Parameters (p,).
        columns: Indices of the entries, ascending (k,).
        draws: Number of random trajectories.
        random: Source of the random trajectories.
    """
    z = _trajectories(here, piece, noise, random, draws)
    by_theta, by_c = np.zeros(len(columns)), np.zeros(len(z))
    for stream, moved in zip(here.streams, here.signals(z, np.zeros((len(columns), draws))), strict=True):
        if stream.by_states is None or stream.by_theta is None:
            continue
        own = stream.gathered(stream.weights(moved))
        by_states, by_columns = _along(measurement, piece, stream, coefficients, z, theta, columns)
        by_theta += np.einsum("cpkm,mck->p", by_columns, own, optimize=True)
        pulled = np.einsum("cdjkm,mck->dmj", by_states, own, optimize=True)
        by_c += sum((basis.T @ each).ravel() for basis, each in zip(stream.bases, pulled, strict=True))
    return (by_theta - here.follows.T @ by_c) / draws


def _trajectories(here: Response, piece: Piece, noise: Noise, rng: np.random.Generator, draws: int) -> np.ndarray:
    """Random z ~ N(0, A⁻¹) (size n, draws): errors of the trajectory due to noise and to a motion of the prior."""
    scores = [stream.weights.scores(rng.normal(size=(*stream.residual.shape, draws))) for stream in here.streams]
    return here.solved(here.adjoint(scores)[0] + piece.spline.penalty_scores(rng, noise.jerk, draws))


def _along(
    measurement: Predictor,
    piece: Piece,
    stream: Stream,
    coefficients: np.ndarray,
    z: np.ndarray,
    theta: np.ndarray,
    columns: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Derivatives along z of channels' derivatives by states (c, 3, n, draws, M) and by θ (c, k, draws, M)."""
    (size, n), draws = coefficients.shape, z.shape[1]
    c = (coefficients[..., None] + SMALL * z.reshape(size, n, draws)).transpose(0, 2, 1).reshape(size, -1)
    x = np.stack([(basis @ c).reshape(-1, draws, n).swapaxes(0, 1).reshape(-1, n) for basis in stream.bases])
    wrenches = no_wrenches(x) if stream.nodes else np.tile(piece.wrenches, (draws, 1, 1))
    out = []
    for new, old in zip(measurement.derivatives(x, wrenches, theta, columns)[1:], _at(stream), strict=True):
        whole = new[stream.which].reshape(*old.shape[:-1], draws, -1)
        out.append((whole - old[..., None, :]) / SMALL)
    # Derivatives by a delay and a clock follow from those by the states.
    out[1][:, np.isin(columns, list(measurement.shifts))] = 0
    return out[0], out[1]


def _at(stream: Stream) -> tuple[np.ndarray, np.ndarray]:
    assert stream.by_states is not None and stream.by_theta is not None
    return stream.by_states, stream.by_theta
