"""Least-squares base parameters with their uncertainty, and the two checks of Section III.A."""

from collections.abc import Iterable, Iterator
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial, reduce
from itertools import chain
from operator import add

import numpy as np
from scipy.linalg import lapack

from ident.errors import InputError
from ident.estimation.accumulator import (
    PROBE,
    Accumulator,
    accumulate,
    chunk_rows,
    inverse_of,
    square_root,
    triangle_of,
)
from ident.estimation.excitation import check_excitation, noise_rows
from ident.estimation.in_order import in_order
from ident.estimation.robust import innovations, remembered
from ident.estimation.samples import Samples, Source, even, pieces
from ident.mechanism.mechanism import checked_gravity
from ident.mechanism.motion import BaseMotion
from ident.mechanism.tree import Tree
from ident.model.regressor import CHUNK, base_wrench_regressor
from ident.parameters.base_parameters import ZERO_COLUMN, BaseParameters, structural_base_parameters
from ident.parameters.structure import Sensors

PIECE = 65536
"""Samples of one piece in memory that one worker takes."""


@dataclass(frozen=True, eq=False)
class Estimate:
    """Estimated base parameters.

    Attributes:
        parameters: The regrouping that the parameters belong to.
        psi: Their estimates ψ, SI units (r,).
        std: Standard deviation of each estimate due to noise on the wrench (r,).
        covariance: Covariance behind `std` (r, r).
        weighted: Whether a covariance weighted the samples. Then the base regressor, its rows, condition number and
            residuals are those of the whitened rows.
        triangle: Triangular factor of the base regressor, `Y_bᵀ Y_b = Rᵀ R` (r, r).
        rows: Rows of the base regressor; wrench components that no parameter can produce are left out.
        samples: Number of samples N.
        residual_norms: `‖Γ_i - Y_b,i ψ‖₂` of each wrench component (6,).
        method: How it was solved.
        noise: Which noise `std` holds for: "white from sample to sample", or "correlated over time or not".
    """

    parameters: BaseParameters
    psi: np.ndarray
    std: np.ndarray
    covariance: np.ndarray
    weighted: bool
    triangle: np.ndarray
    rows: int
    samples: int
    residual_norms: np.ndarray
    method: str
    noise: str

    @property
    def singular_values(self) -> np.ndarray:
        """Singular values of the base regressor, largest first (r,)."""
        return np.linalg.svd(self.triangle, compute_uv=False)

    @property
    def condition_number(self) -> float:
        """Condition number of the base regressor, not scaled (Section III.A)."""
        s = self.singular_values
        return float(s[0] / s[-1])

    @property
    def epsilon(self) -> float:
        """`‖Γ - Y_b ψ‖₂` over all components (Eq. 5)."""
        return float(np.linalg.norm(self.residual_norms))

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the r base parameters."""
        return self.parameters.names


def identify(
    tree: Tree,
    source: Source,
    *,
    gravity: np.ndarray,
    parameters: BaseParameters | None = None,
    state_noise: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None,
    executor: Executor | None = None,
    ahead: int | None = None,
) -> Estimate:
    """Least-squares solution of `Y_b ψ = Γ` (Eq. 4), in one pass and in bounded memory.

    Without a covariance in the samples this is the ordinary least squares of the paper, and the noise of every wrench
    component is taken from the residuals, independent of the others'. With a covariance the rows are whitened, which
    weights them, and the noise is taken as known. Either way the standard deviations are those of white noise,
    independent from sample to sample, and far too small for noise that is correlated over time, as what a model leaves
    unexplained mostly is; `huber_white` needs a second pass and knows better. Noise on the joint states (errors in
    variables) is in neither: it biases ψ.

    Args:
        tree: The mechanism of b bodies.
        source: Samples, a recording whose wrench `ground` is the total one, or an iterable of such pieces.
        gravity: Acceleration of gravity as `base_wrench_regressor` takes it, m/s² (3,).
        parameters: Regrouping of the mechanism's parameters; by default its structural one.
        state_noise: Standard deviations of the noise on the columns of q, dq and ddq. With them a joint that rests but
            whose sensors are noisy does not pass for excited.
        executor: Where pieces are worked on, by default here. Pieces in memory are split for it. Its workers are best
            held to one thread for linear algebra (`OPENBLAS_NUM_THREADS=1`).
        ahead: Number of pieces to submit ahead, more than there are workers; by default as `in_order`.

    Returns:
        The estimate, the same to rounding in whatever pieces the samples come.

    Raises:
        InputError: A piece does not fit the mechanism or the others, or a covariance is not positive definite.
        ExcitationError: The motion does not separate the base parameters.
    """
    stream = pieces(source, tree)
    first = next(stream)
    if parameters is None:
        down = tuple(checked_gravity(gravity).tolist())
        parameters = structural_base_parameters(tree, down, sensors=Sensors(moving_base=first.base is not None))
    noise = None if state_noise is None else noise_rows(tree, first, gravity, parameters, state_noise)
    if executor is None:
        found = accumulate(tree, first, gravity=gravity, parameters=parameters)
        for piece in stream:
            found = accumulate(tree, piece, gravity=gravity, parameters=parameters, start=found)
    else:
        # In common coordinates accumulators add without a change of them.
        factor = accumulate(tree, first.part(slice(PROBE)), gravity=gravity, parameters=parameters).factor
        work = partial(accumulate, tree, gravity=gravity, parameters=parameters, factor=factor)
        found = reduce(add, in_order(executor, work, _split(chain([first], stream)), ahead=ahead))
    return solve(found, parameters, noise)


def _split(stream: Iterable[Samples]) -> Iterator[Samples]:
    for piece in stream:
        yield from (piece.part(slice(k, k + PIECE)) for k in range(0, len(piece), PIECE))


def solve(found: Accumulator, parameters: BaseParameters, noise: np.ndarray | None = None) -> Estimate:
    """The estimate from what was accumulated.

    Args:
        found: Accumulator of all samples.
        parameters: Regrouping that it was made with.
        noise: The regressor's own noise, as `check_excitation` takes it.

    Raises:
        InputError: The accumulator is of other parameters.
        ExcitationError: The motion does not separate the base parameters.
    """
    if parameters.names != found.names:
        raise InputError(f"This was accumulated for {', '.join(found.names)}, not for {', '.join(parameters.names)}.")
    rank, gram = parameters.rank, found.gram
    P_b, p, scale = found.factor[:rank, :rank], found.factor[:rank, rank], found.factor[rank, rank]
    # In the coordinates of P = [[P_b, p], [0, π]] the Gram matrix of Y_b is AᵀA, and its Cholesky factor that of QR.
    try:
        A = np.linalg.cholesky(gram[:rank, :rank]).T
    except np.linalg.LinAlgError:
        A = triangle_of(square_root(gram[:rank, :rank]))
    R = A @ P_b
    check_excitation(R, parameters, found.samples, noise)
    inverse = inverse_of(A)
    shift = scale * inverse @ (inverse.T @ gram[:rank, rank])
    # The residual Γ - Y_b ψ in the same coordinates, without the difference of two large numbers.
    residual = np.append(-shift, scale)
    squares = np.maximum(residual @ found.grams @ residual, 0)
    own = found.grams[:, :rank, :rank]
    seen = np.trace(own, axis1=1, axis2=2) > ZERO_COLUMN**2 * np.trace(gram[:rank, :rank])
    half = inverse_of(P_b) @ inverse
    if found.weighted:
        covariance = half @ half.T
    else:
        shares = inverse.T @ own @ inverse
        covariance = half @ np.tensordot(_variances(squares, shares, found.samples), shares, axes=1) @ half.T
    return Estimate(
        parameters=parameters,
        psi=lapack.dtrtrs(P_b, p + shift)[0],
        std=np.sqrt(np.diag(covariance)),
        covariance=covariance,
        weighted=found.weighted,
        triangle=R,
        rows=int(seen.sum()) * found.samples,
        samples=found.samples,
        residual_norms=np.sqrt(squares),
        method=f"one pass in QR coordinates, {found.factored} of {found.chunks} chunks by stacked QR",
        noise="white from sample to sample",
    )


def _variances(squares: np.ndarray, shares: np.ndarray, samples: int) -> np.ndarray:
    """Noise variance of each wrench component, unbiased where the components' noise is independent (6,).

    Args:
        squares: Sum of squared residuals of each component (6,).
        shares: Part `W_c` of each component in the Gram matrix of orthonormal columns, `Σ W_c = 1` (6, r, r).
        samples: Number of samples N.
    """
    # The fit takes part of a component's noise, and puts part of the others' in: E‖r_c‖² = N σ_c² - 2 tr(W_c) σ_c²
    # + Σ_d tr(W_c W_d) σ_d².
    own = np.diag(samples - 2 * np.trace(shares, axis1=1, axis2=2))
    mixed = np.einsum("cij,dij->cd", shares, shares)
    return np.maximum(np.linalg.lstsq(own + mixed, squares, rcond=None)[0], 0)


def predicted_wrench(
    tree: Tree,
    estimate: Estimate,
    q: np.ndarray,
    dq: np.ndarray,
    ddq: np.ndarray,
    *,
    gravity: np.ndarray,
    base: BaseMotion | None = None,
) -> np.ndarray:
    """Total wrench that an estimate predicts, `Y_b ψ` (N, 6); arguments as for `base_wrench_regressor`."""
    kept = estimate.parameters.kept
    return base_wrench_regressor(tree, q, dq, ddq, gravity=gravity, base=base, columns=kept) @ estimate.psi


def huber_white(tree: Tree, estimate: Estimate, source: Source, *, gravity: np.ndarray) -> Estimate:
    """The estimate with standard deviations from the residuals of each sample (Huber and White's sandwich).

    In long recordings they hold whatever the noise of the components, the correlation between them, its change from
    sample to sample, as a contact's lever makes it, and its correlation over time, of which each component's residuals
    tell (`innovations`); but they need a second pass over the samples.

    Args:
        tree: The mechanism; arguments as for `identify`.
        estimate: Ordinary estimate, or a weighted one: its residuals are those of the whitened rows, so that only the
            proportions of the covariance need to be right.
        source: The samples it was made of. Pieces are taken to follow one another without a gap; a border between two
            recordings counts as many samples wrongly as the noise remembers.
        gravity: Acceleration of gravity, m/s² (3,).

    Returns:
        The estimate with another covariance, the same to rounding in whatever pieces the samples come.

    Raises:
        InputError: These are not as many samples as the estimate was made of, or they are weighted otherwise.
    """
    rank, channels, samples = estimate.parameters.rank, estimate.rows / estimate.samples, 0
    middle, before = np.zeros((rank, rank)), np.zeros((6, rank))
    # Parts of one size, long enough to tell of the correlation, whatever the pieces are.
    for part in even(pieces(source, tree), PIECE):
        samples += len(part)
        if (part.covariance is not None) != estimate.weighted:
            raise InputError(
                "The noise of a weighted estimate is taken as known for its weights, so its samples need their "
                "covariance; those of an ordinary one have none."
            )
        chunks = partial(chunk_rows, tree, part, gravity=gravity, parameters=estimate.parameters)
        residual = np.hstack([rows[-1] - np.tensordot(estimate.psi, rows[:-1], axes=1) for rows in chunks()])
        decay, size = innovations(residual, rank / channels * len(part) / estimate.samples)
        for rows, u in zip(chunks(), np.split(size, range(CHUNK, len(part), CHUNK), axis=1), strict=True):
            z = [remembered(rows[:-1, c], decay[c], before[c]) for c in range(6)]
            before = np.array([each[:, -1] for each in z])
            # Each sample pulls at ψ by its residual.
            pulls = sum(each * pull for each, pull in zip(z, u, strict=True))
            middle += pulls @ pulls.T
    if samples != estimate.samples:
        raise InputError(f"The estimate was made of {estimate.samples} samples, these are {samples}.")
    inverse = inverse_of(estimate.triangle)
    bread = inverse @ inverse.T
    covariance = bread @ middle @ bread
    std = np.sqrt(np.maximum(np.diag(covariance), 0))
    return replace(estimate, covariance=covariance, std=std, noise="correlated over time or not")
