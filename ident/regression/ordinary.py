"""Least-squares parameters with their covariance, and the two checks of Section III.A.

minimise ‖Y ψ - Γ‖²        in one pass and bounded memory, by `ident.estimation.accumulator`,
cov ψ = B⁻¹ M B⁻¹,         B = Yᵀ Y and M = Yᵀ cov(Γ) Y, from the residuals, in one pass or two
"""

from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import partial, reduce
from operator import add

import numpy as np
from scipy.linalg import lapack

from ident.annotations import typed
from ident.errors import ExcitationError, InputError
from ident.estimation import accumulator
from ident.estimation.accumulator import Accumulator, accumulate, contributing
from ident.estimation.equations import Equations
from ident.estimation.noise import Sandwich
from ident.estimation.samples import Samples, even, in_order
from ident.files.table import listed
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.parameters.base_parameters import BaseParameters
from ident.recordings.recording import Recording
from ident.tolerances import SINGULAR, ZERO_COLUMN

Source = Samples | Recording | Iterable[Samples | Recording]
"""One piece, or an iterable of pieces that need not fit into memory together."""

PIECE = 65536
"""Samples per piece of work for one worker."""


@dataclass(frozen=True, eq=False)
class Fit:
    """Coefficients fitted to samples: base parameters ψ first, then those of drives and offsets.

    Attributes:
        equations: Fitted equations of m columns and C channels.
        values: Coefficients, SI units (m,).
        covariance: Their covariance due to noise on the channels (m, m).
        weighted: True if the rows were weighted, as by a covariance. Then the root, its rows, condition number and
            residuals are those of the weighted rows.
        root: Square matrix R with `Yᵀ Y = Rᵀ R` for the columns Y (m, m).
        rows: Number of rows, without channels that no parameter affects.
        samples: Number of samples N.
        residual_norms: `‖Γ_c - Y_c x‖₂` of each channel (C,).
    """

    equations: Equations
    values: np.ndarray
    covariance: np.ndarray
    weighted: bool
    root: np.ndarray
    rows: int
    samples: int
    residual_norms: np.ndarray

    @property
    def parameters(self) -> BaseParameters:
        """Regrouping of the standard parameters into base parameters."""
        return self.equations.parameters

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the coefficients."""
        return self.equations.names

    @property
    def psi(self) -> np.ndarray:
        """Base parameters ψ, SI units (r,)."""
        return self.values[: self.parameters.rank]

    @property
    def std(self) -> np.ndarray:
        """Standard deviation of each coefficient (m,)."""
        return np.sqrt(np.maximum(np.diag(self.covariance), 0))

    @property
    def offsets(self) -> dict[str, tuple[float, float]]:
        """Constant offsets by their channels, with their standard deviations."""
        channels = [self.equations.channels[k] for k in self.equations.offsets]
        last = slice(len(self.values) - len(channels), None)
        numbers = zip(self.values[last].tolist(), self.std[last].tolist(), strict=True)
        return dict(zip(channels, numbers, strict=True))

    def sandwich(self, middle: np.ndarray) -> np.ndarray:
        """Covariance `(Yᵀ Y)⁻¹ M (Yᵀ Y)⁻¹`, symmetric to the last digit also where columns are nearly dependent (m, m).

        Args:
            middle: Covariance M of `Yᵀ` times the noise (m, m).
        """
        inverse = np.linalg.inv(self.root)
        values, vectors = np.linalg.eigh(inverse.T @ middle @ inverse)
        half = inverse @ vectors * np.sqrt(np.maximum(values, 0))
        return half @ half.T

    @property
    def singular_values(self) -> np.ndarray:
        """Singular values of the columns, largest first (m,)."""
        return np.linalg.svd(self.root, compute_uv=False)

    @property
    def condition_number(self) -> float:
        """Condition number of the columns, not scaled (Section III.A)."""
        s = self.singular_values
        return float(s[0] / s[-1])

    @property
    def epsilon(self) -> float:
        """`‖Γ - Y_b ψ‖₂` over all channels (Eq. 5)."""
        return float(np.linalg.norm(self.residual_norms))

    def with_psi(self, psi: np.ndarray) -> "Fit":
        """Fit with other base parameters (r,), and the likeliest drives and offsets given these."""
        values, r, covariance = self.values.copy(), len(psi), self.covariance
        values[r:] += covariance[r:, :r] @ np.linalg.pinv(covariance[:r, :r], hermitian=True) @ (psi - values[:r])
        values[:r] = psi
        return replace(self, values=values)

    def predicted(self, motion: Motion) -> np.ndarray:
        """Channels that the coefficients predict (N, C)."""
        return -self.residual(Samples(motion, np.zeros((len(motion), len(self.equations.channels)))))

    def residual(self, samples: Samples) -> np.ndarray:
        """Measured less predicted channels (N, C)."""
        return self.equations.residual(samples, self.values)


@typed("equations")
def least_squares(
    equations: Equations,
    source: Source,
    *,
    factor: np.ndarray | None = None,
    executor: Executor | None = None,
) -> Fit:
    """Least-squares solution of `Y_b ψ = Γ` (Eq. 4), in one pass and in bounded memory.

    Without a covariance in the samples this is the ordinary least squares of the paper, and the noise of every channel
    is estimated from the residuals, independent between channels. With a covariance the rows are whitened, and the
    noise is taken as known. Either way the standard deviations hold for white noise, independent from sample to sample.
    They are far too small for noise that is correlated over time, as model errors mostly are; `huber_white` corrects
    them in a second pass. Noise on the joint states (errors in variables) is in neither: it biases ψ.

    Args:
        equations: Equations to fit.
        source: Samples or a recording, or an iterable of such pieces.
        factor: Coordinates to start from (`Accumulator.factor`), as of another trial of the same motion; by default
            computed from the first samples.
        executor: Executor for the pieces; by default they are computed here. Pieces in memory are split for it. Its
            workers should use one thread for linear algebra (`OPENBLAS_NUM_THREADS=1`).

    Returns:
        The fit, independent of the division into pieces to rounding; its `epsilon` is the residual of Eq. 5.

    Raises:
        InputError: A piece does not fit the equations or the others, or a covariance is not positive definite.
        ExcitationError: The motion does not separate the parameters.
    """
    parts = _split(pieces(source, equations))
    work = partial(accumulate, equations, checked=True)
    total = work(next(parts), factor=factor)
    # Accumulators in common coordinates add without a change of coordinates.
    if executor is not None:
        total = reduce(add, in_order(executor, partial(work, factor=total.factor), parts), total)
    else:
        for part in parts:
            total += work(part, factor=total.factor)
    return solve(total, equations)


def pieces(source: Source, equations: Equations) -> Iterator[Samples]:
    """Yields the checked pieces of a source, all with the same columns.

    Args:
        source: Samples or a recording, or an iterable of them.
        equations: Equations to fit.

    Raises:
        InputError: A piece does not fit the mechanism or the first one, or there is none.
    """
    first: Samples | None = None
    alone = isinstance(source, Samples | Recording)
    for k, piece in enumerate([source] if alone else source):  # type: ignore[arg-type]
        where = "The samples" if alone else f"Piece {k}"
        if not isinstance(piece, Samples | Recording):
            raise InputError(f"{where} must be Samples or a recording, got {type(piece).__name__}.")
        samples = piece if isinstance(piece, Samples) else _of_recording(piece, equations.mechanism.tree)
        fitting = equations.checked(samples, where)
        if first is not None:
            _compare(samples, first, where)
        first = first or samples
        yield fitting
    if first is None:
        raise InputError("Identification needs at least one piece of samples, got none.")


def _of_recording(recording: Recording, tree: Tree) -> Samples:
    if recording.base is not None:
        raise InputError("A recording of a moving base needs the base's motion: make Samples with it.")
    return Samples(Motion(*recording.joint_states(tree.joints)), recording.total_wrench(tree).in_base)


def _compare(samples: Samples, first: Samples, where: str) -> None:
    optional = {"base": (samples.motion.base, first.motion.base), "covariance": (samples.covariance, first.covariance)}
    for name, (own, other) in optional.items():
        if (own is None) != (other is None):
            raise InputError(f"{where}: either all pieces have '{name}' or none has.")


def _split(stream: Iterable[Samples]) -> Iterator[Samples]:
    for piece in stream:
        yield from (piece[k : k + PIECE] for k in range(0, len(piece), PIECE))


def check_excitation(root: np.ndarray, names: Sequence[str], samples: int) -> None:
    """Raises unless the motion separates all parameters.

    The norms of combinations of unit-norm base columns (the singular values) must exceed rounding.

    Args:
        root: Square matrix R with `Yᵀ Y = Rᵀ R` for the base regressor Y (r, r).
        names: Names of its columns (r,).
        samples: Number of samples N.

    Raises:
        ExcitationError: Some combinations are not excited; it names the base parameters in them.
    """
    norms = np.linalg.norm(root, axis=0)
    still = norms <= ZERO_COLUMN * norms.max(initial=0)
    norms = np.where(still, 1, norms)
    _, lengths, directions = np.linalg.svd(root / norms)
    hidden = directions[lengths <= SINGULAR * lengths.max(initial=0)]
    if len(hidden):
        names = contributing(hidden, names)
        raise ExcitationError(
            f"The motion of {samples} samples does not separate the base parameters {listed(names)}: "
            f"{len(norms) - len(hidden)} of {len(norms)} combinations show above rounding. Record longer, or move the "
            "joints further.",
            names,
        )


def solve(accumulated: Accumulator, equations: Equations) -> Fit:
    """Fit from an accumulator.

    Args:
        accumulated: Accumulator of all samples.
        equations: Equations of the accumulator.

    Raises:
        InputError: The accumulator is of other columns.
        ExcitationError: The motion does not separate the parameters.
    """
    if equations.names != accumulated.names:
        raise InputError(
            f"This was accumulated for {', '.join(accumulated.names)}, not for {', '.join(equations.names)}."
        )
    m, gram = len(accumulated.names), accumulated.gram
    order = accumulated.order[:m]
    P_b, p, scale = accumulated.factor[:m, order], accumulated.factor[:m, m], accumulated.factor[m, m]
    # In the coordinates of P = [[P_b, p], [0, π]] the Gram matrix of Y_b is AᵀA, with A also the factor of a QR.
    A, failed = lapack.dpotrf(gram[:m, :m])
    if failed:
        A = accumulator.triangle_of(accumulator.square_root(gram[:m, :m]))
    natural = order.argsort()
    root = (A @ P_b)[:, natural]
    check_excitation(root, accumulated.names, accumulated.samples)
    inverse = accumulator.inverse_of(A)
    shift = scale * inverse @ (inverse.T @ gram[:m, m])
    # The residual Γ - Y_b ψ in the same coordinates, without the difference of two large numbers.
    residual = np.append(-shift, scale)
    squares = np.maximum(residual @ accumulated.grams @ residual, 0)
    own = accumulated.grams[:, :m, :m]
    measured = (np.diagonal(own, axis1=1, axis2=2) > ZERO_COLUMN**2 * gram[:m, :m].diagonal()).any(axis=1)
    half = (accumulator.inverse_of(P_b) @ inverse)[natural]
    if accumulated.weighted:
        covariance = half @ half.T
    else:
        shares = inverse.T @ own @ inverse
        covariance = half @ np.einsum("c,cij", _variances(squares, shares, accumulated.samples), shares) @ half.T
    return Fit(
        equations=equations,
        values=lapack.dtrtrs(P_b, p + shift)[0][natural],
        covariance=covariance,
        weighted=accumulated.weighted,
        root=root,
        rows=int(measured.sum()) * accumulated.samples,
        samples=accumulated.samples,
        residual_norms=np.sqrt(squares),
    )


def _variances(squares: np.ndarray, shares: np.ndarray, samples: int) -> np.ndarray:
    """Noise variance of each channel, unbiased where the channels' noise is independent (C,).

    Args:
        squares: Sum of squared residuals of each channel (C,).
        shares: Part `W_c` of each channel in the Gram matrix of orthonormal columns, `Σ W_c = 1` (C, m, m).
        samples: Number of samples N.
    """
    # The fit absorbs part of a channel's noise, and adds part of the others': E‖r_c‖² = N σ_c² - 2 tr(W_c) σ_c²
    # + Σ_d tr(W_c W_d) σ_d².
    own = np.diag(samples - 2 * np.trace(shares, axis1=1, axis2=2))
    mixed = np.einsum("cij,dij->cd", shares, shares)
    return np.maximum(lapack.dgelss(own + mixed, squares)[1], 0)


def huber_white(fit: Fit, source: Source, *, steady: bool = False) -> Fit:
    """Fit with standard deviations from the residuals of each sample (sandwich covariance of Huber and White).

    In long recordings they are valid for noise of any size, correlated between channels, varying from sample to
    sample, as with a contact's lever arm, and correlated over time, which is estimated from each channel's residuals
    (`innovations`); but they need a second pass over the samples.

    Args:
        fit: Ordinary fit, or one weighted by a covariance: its residuals are those of the whitened rows, so that only
            the proportions of the covariance need to be right.
        source: The fitted samples. Pieces are assumed to follow one another without a gap; at a border between two
            recordings, samples within a correlation time are treated wrongly.
        steady: True to take the noise of each channel as constant in size and independent of the others', which short
            recordings with slow noise need.

    Returns:
        The fit with another covariance, independent of the division into pieces to rounding.

    Raises:
        InputError: These are not as many samples as the fit was made of, or they are weighted otherwise.
    """
    equations, samples, m = fit.equations, 0, len(fit.names)
    sandwich = Sandwich(m, len(equations.channels))
    # Parts of one size, long enough to estimate the correlation, whatever the pieces are.
    for part in even(pieces(source, equations), PIECE):
        samples += len(part)
        if (part.covariance is not None) != fit.weighted:
            raise InputError(
                "The noise of a weighted fit is taken as known for its weights, so its samples need their covariance; "
                "those of an ordinary one have none."
            )
        residual = np.hstack([r[-1] - np.tensordot(fit.values, r[:-1], axes=1) for r in equations.rows(part)])
        taken = m * len(part) / fit.rows
        if steady:
            sandwich.add_steady(partial(accumulator.remembered_sums, equations, part), residual, taken)
        else:
            sandwich.add((rows[:-1] for rows in equations.rows(part)), residual, taken)
    if samples != fit.samples:
        raise InputError(f"The fit was made of {fit.samples} samples, these are {samples}.")
    return replace(fit, covariance=fit.sandwich(sandwich.middle))
