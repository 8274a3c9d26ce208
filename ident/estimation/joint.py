"""Trajectory, parameters, set-up and noise of a recording at once.

minimise  Σ_m ‖x_m - C_m c‖² / σ_m² + Σ_c ‖w_c - f_c(c, θ)‖² / σ_c² + Σ_j λ_j ∫ x⃛_j² dt + ‖θ - θ_0‖²_prior

over spline coefficients c and parameters θ by Gauss-Newton steps, θ with what its marginal likelihood adds
(`ident.estimation.marginal_likelihood`). After each of them noise and smoothness follow by
restricted maximum likelihood (`ident.estimation.restricted_likelihood`). Ordered by time the curvature is banded, but
for a border of θ; pieces share θ alone, so that their Schur complements add.
"""

import pickle
from collections.abc import Callable, Collection, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from typing import Any, NamedTuple, cast

import numpy as np
from scipy import linalg

from ident.errors import ExcitationError
from ident.estimation.marginal_likelihood import pull
from ident.estimation.piece import Linearised, Misfit, Noise, Piece, Predictor, linearised, misfit
from ident.estimation.restricted_likelihood import TINIEST, Stride, hastened, renewed

ROUNDS = 60
"""Rounds after which the iteration gives up."""

SETTLED, SETTLED_NOISE, SETTLED_MOTION = 0.02, 0.02, 0.1
"""Steps of θ, in its standard deviations, relative changes of the noise's, and steps of coefficients, in those of the
coordinates, that end it."""

SETTLED_EXPLORING = 0.005
"""Change of the channels' noise, of its geometric mean, that ends an exploring fit: knots are judged by thrice that."""

NEAR = 0.1
"""Steps of θ, in its standard deviations, from which it is smoothness that is waited for."""

DRIFTED, DRIFTED_NOISE = 0.5, 0.1
"""Change of θ, in its standard deviations, and of a logarithm of the noise's, from which what the marginal likelihood
adds is found anew."""

DRAWN = 2000
"""Samples of random trajectories that tell what the marginal likelihood adds, to a tenth of a standard deviation."""


COLOURED = 3
"""Round from which noise that was white at the start may be correlated, or where θ rests before: while the fit is bad
all residuals are."""

SMOOTHEST = 1e7
"""Largest λ over `h⁶ rate / σ²`: then samples of some fifteen knots are averaged. With ten times as much rounding may
turn steps of coordinates that rest around."""

CYCLE = 0.5
"""Size of a step that leads back, over that of the step before, from which noise and parameters chase each other."""

SMALLEST_STEP = 1 / 64
"""Part of a step; where that does not lower the cost none does."""

LEAST_SCATTER = 0.05
"""Least variance over that of the working model, in any direction: where noise is found to be less it is by chance."""

Report = Callable[[int, float], None]
"""Is called with every round and its largest step of θ, in standard deviations."""


class Prior(NamedTuple):
    """What is known of θ beforehand.

    Attributes:
        mean: Mean (p,).
        precision: Precision as it counts in the fit, zero where nothing is known (p, p).
        weight: How many times over it counts there: residuals that are slow tell less than a fit takes them for.
    """

    mean: np.ndarray
    precision: np.ndarray
    weight: float = 1.0

    @property
    def known(self) -> np.ndarray:
        """Precision as it is known (p, p)."""
        return self.precision / self.weight

    def weighted(self, weight: float) -> "Prior":
        """The same with another weight."""
        return Prior(self.mean, weight * self.known, weight)


@dataclass(frozen=True, eq=False)
class Start:
    """Where an iteration begins.

    Attributes:
        theta: Parameters (p,).
        noise: Standard deviations, correlation and smoothness.
        coefficients: Spline coefficients of every piece (size, n).
        marginal: What θ's marginal likelihood adds, None for not known yet.
    """

    theta: np.ndarray
    noise: Noise
    coefficients: Sequence[np.ndarray]
    marginal: "Marginal | None" = None


class Marginal(NamedTuple):
    """What the marginal likelihood of θ adds to the gradient.

    Attributes:
        pulls: Of every piece, to be subtracted from its right side (p,).
        theta: Parameters that they were found for (p,).
        noise: Noise that they were found with.
    """

    pulls: Sequence[np.ndarray]
    theta: np.ndarray
    noise: Noise


@dataclass(frozen=True, eq=False)
class JointFit:
    """Trajectory, parameters and noise.

    Attributes:
        names: Names of θ.
        selections: Which entries of θ each piece has.
        prior: What was known of θ beforehand.
        theta: Parameters θ = [ψ, drives, offsets, set-up] (p,).
        shares: Precision of θ and its right side of every piece, trajectory eliminated: (p, p) and (p,).
        free: Which parameters were fitted (p,).
        noise: Standard deviations, correlation and smoothness.
        coefficients: Spline coefficients of every piece (size, n).
        pieces: What was measured.
        trace: Largest step of θ in standard deviations of every round.
        status: `converged`, `stopped` after so many rounds, `stuck` where no step lowers the cost, or `interrupted`.
        scatters: Covariance of every piece's right side under the noise that is really there (p, p); None for that of
            the working model, which is its precision.
        bounded: Parameters that are held at a bound (p,), None for none.
        marginal: What the marginal likelihood of θ adds; the shares have it.
    """

    names: Sequence[str]
    selections: Sequence[np.ndarray]
    prior: Prior
    theta: np.ndarray
    shares: Sequence[tuple[np.ndarray, np.ndarray]]
    free: np.ndarray
    noise: Noise
    coefficients: Sequence[np.ndarray]
    pieces: Sequence[Piece]
    trace: tuple[float, ...]
    status: str
    scatters: Sequence[np.ndarray] | None = None
    bounded: np.ndarray | None = None
    marginal: Marginal | None = None

    @property
    def end(self) -> Start:
        """Where it ended, for another fit of the same pieces to begin."""
        return Start(self.theta, self.noise, self.coefficients, self.marginal)

    @property
    def counted(self) -> np.ndarray:
        """Mask of what counts as fitted: also what is held at a bound (p,)."""
        return self.free if self.bounded is None else self.free | self.bounded

    @property
    def scatter_shares(self) -> Sequence[np.ndarray]:
        """Covariance of every piece's right side, by the working model where no other is known (p, p) each."""
        return [schur for schur, _ in self.shares] if self.scatters is None else self.scatters

    @cached_property
    def scatter(self) -> np.ndarray:
        """Covariance of the gradient, the priors' included (p, p)."""
        return sum(self.scatter_shares, start=self.prior.weight * self.prior.precision)

    @cached_property
    def precision(self) -> np.ndarray:
        """Precision of θ, priors included (p, p)."""
        return sum((schur for schur, _ in self.shares), start=self.prior.precision)

    @cached_property
    def gradient(self) -> np.ndarray:
        """Right side of the equations at θ, zero for what was fitted (p,)."""
        pull = -self.prior.precision @ (self.theta - self.prior.mean)
        return sum((right for _, right in self.shares), start=pull)

    @cached_property
    def covariance(self) -> np.ndarray:
        """Covariance of θ from the noise, zero for what was not fitted (p, p).

        What is held at a bound counts as fitted: what trades with it is known no better for that.
        """
        taken = self.counted
        own = np.ix_(taken, taken)
        names = [name for name, one in zip(self.names, taken, strict=True) if one]
        return embedded(sandwich(self.precision[own], self.scatter[own], names), taken)

    def scores(self, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far θ would go in directions that were not fitted, the others refitted, and the standard deviations.

        Args:
            directions: Directions, one in each row, zero in what was fitted (k, p).

        Returns:
            Distances and their standard deviations, infinite where nothing tells (k,).
        """
        free = self.free
        inside = inverse_of_precision(self.precision[np.ix_(free, free)])
        across = directions @ self.precision
        regressed = across[:, free] @ inside
        curvature = ((across - regressed @ self.precision[free]) * directions).sum(axis=1)
        pull = directions @ self.gradient - regressed @ self.gradient[free]
        told = curvature > 0
        curvature = np.where(told, curvature, 1.0)
        alone = directions.copy()
        alone[:, free] -= regressed
        variance = np.maximum(((alone @ self.scatter) * alone).sum(axis=1), LEAST_SCATTER * curvature)
        return np.where(told, pull / curvature, 0.0), np.where(told, np.sqrt(variance) / curvature, np.inf)


def fit(
    measurement: Predictor,
    pieces: Sequence[Piece],
    start: Start,
    *,
    prior: Prior,
    free: np.ndarray,
    names: Sequence[str] = (),
    selections: Sequence[np.ndarray] | None = None,
    coloured: bool = True,
    kept: Collection[str] = (),
    explore: bool = False,
    executor: Executor | None = None,
    rounds: int = ROUNDS,
    report: Report | None = None,
) -> JointFit:
    """Iterates from a start.

    An interrupt (Ctrl-C) ends it with what it has.

    Args:
        measurement: Channels and parameters.
        pieces: What was measured.
        start: Where to begin.
        prior: What is known of θ.
        free: Which entries of θ to fit (p,).
        names: Names of θ, by default those of the measurement.
        selections: Which entries of θ each piece has as its own parameters; by default all have all.
        coloured: Whether noise may be correlated over time.
        kept: What of the noise is kept as at the start, out of `states`, `channels` and `jerk`; by default nothing.
        explore: True to end as soon as the channels' noise is found; nobody asks for the shares of the pieces then.
        executor: Where pieces are worked on, by default here.
        rounds: Rounds after which to give up.
        report: Called with every round.

    Raises:
        ExcitationError: The motion leaves parameters undetermined.
    """
    every = [np.arange(len(free))] * len(pieces)
    run = map if executor is None else executor.map
    shared = measurement if executor is None else cast(Predictor, _Sent(measurement))
    problem = _Problem(shared, pieces, prior, free, names or measurement.names, selections or every, run)
    at, trace, status, stalled = start, list[float](), "stopped", 0
    fitted = np.flatnonzero(free)
    before, stride, back = np.zeros_like(start.theta), None, False
    was_coloured, now_coloured = False, bool(start.noise.channels_rho.any())
    parts = problem.linearised(at, fitted)
    try:
        for round_ in range(rounds):
            root = problem.root(parts)
            if not explore and problem.drifted(at, root):
                at = replace(at, marginal=problem.marginal(at, midway=back))
            step = problem.step(at, parts, root)
            moves = [part.step - part.by_theta @ step[fitted] for part in parts]
            trace.append(float(np.max(np.abs(step[free]) / np.linalg.norm(root, axis=1), initial=0)))
            moved, misfits = problem.lower(at, step, moves, parts)
            was_coloured = now_coloured
            now_coloured = coloured and (was_coloured or round_ >= COLOURED or trace[-1] < NEAR)
            noise = renewed(at.noise, parts, misfits, coloured=now_coloured)
            last, stride = stride, Stride(np.log(at.noise.jerk), np.log(noise.jerk / at.noise.jerk))
            jerk = hastened(last, stride) if trace[-1] < NEAR else noise.jerk
            noise = replace(noise, jerk=np.minimum(jerk, problem.smoothest(noise)))
            noise = replace(noise, **{name: getattr(at.noise, name) for name in kept})
            quiet = (was_coloured or not coloured) and _quiet(pieces, at, trace[-1], moves, noise)
            quiet = quiet or (explore and round_ > 0 and _found(noise, at.noise))
            stalled = 0 if moved is not at else stalled + 1
            back = _leads_back(step[free], before[free], problem.precision(parts))
            at, before = replace(moved, noise=noise.midway(at.noise) if back else noise), step
            if quiet or stalled > 1:
                status = "converged" if quiet else "stuck"
                break
            if report:
                report(round_, trace[-1])
            parts = problem.linearised(at, fitted, root)
    except KeyboardInterrupt:
        status = "interrupted"
    # Of what was held as well: it shows by how much that would go if it were not.
    unasked = not len(free) or (explore and status != "interrupted")
    last = [] if unasked else problem.linearised(at, np.arange(len(free)))
    shares = [
        (part.schur, part.gradient - pulled)
        for part, pulled in zip(last, problem.spread(at.marginal), strict=not unasked)
    ]
    return JointFit(
        problem.names,
        problem.selections,
        prior,
        at.theta,
        shares,
        free,
        at.noise,
        at.coefficients,
        pieces,
        tuple(trace),
        status,
        marginal=at.marginal,
    )


class _Sent:
    """A measurement for other processes, which unpack it once: its programs may be large. In threads it is itself."""

    def __init__(self, measurement: Predictor) -> None:
        self._measurement, self._packed = measurement, pickle.dumps(measurement)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._measurement, name)

    def __reduce__(self) -> tuple[Callable[[bytes], Predictor], tuple[bytes]]:
        return _unpacked, (self._packed,)


@lru_cache(maxsize=1)
def _unpacked(packed: bytes) -> Predictor:
    return cast(Predictor, pickle.loads(packed))


@dataclass(frozen=True, eq=False)
class _Problem:
    """What is minimised."""

    measurement: Predictor
    pieces: Sequence[Piece]
    prior: Prior
    free: np.ndarray
    names: Sequence[str]
    selections: Sequence[np.ndarray]
    run: Callable[..., Iterable[Any]]

    def linearised(self, at: Start, wanted: np.ndarray, root: np.ndarray | None = None) -> list[Linearised]:
        """Every piece, its trajectory eliminated, as a function of some entries of θ (k,), the others held.

        Args:
            at: Where.
            wanted: These entries.
            root: A root of their covariance (k, k), as far as it is known.
        """
        work = partial(_linearised, self.measurement, at.noise, wanted, root)
        return list(self.run(work, self.pieces, at.coefficients, self._own(at.theta), self.selections))

    def _own(self, theta: np.ndarray) -> list[np.ndarray]:
        """Parameters of each piece."""
        return [theta[own] for own in self.selections]

    def root(self, parts: Sequence[Linearised]) -> np.ndarray:
        """A root of the covariance of what is fitted (k, k)."""
        names = [name for name, fitted in zip(self.names, self.free, strict=True) if fitted]
        return root_of_inverse(self.precision(parts), names)

    def step(self, at: Start, parts: Sequence[Linearised], root: np.ndarray) -> np.ndarray:
        """A Gauss-Newton step of θ (p,), by a root of the covariance of what is fitted (k, k)."""
        pulled = -self.prior.precision @ (at.theta - self.prior.mean) - sum(self.spread(at.marginal))
        gradient = sum((part.gradient for part in parts), start=pulled[self.free])
        step = np.zeros_like(at.theta)
        step[self.free] = root @ (root.T @ gradient)
        return step

    def precision(self, parts: Sequence[Linearised]) -> np.ndarray:
        """Precision of what is fitted, the prior's included (k, k)."""
        return sum((part.schur for part in parts), start=self.prior.precision[np.ix_(self.free, self.free)])

    def smoothest(self, noise: Noise) -> np.ndarray:
        """The largest λ with which the equations can be solved (n,): coordinates that rest ask for infinite ones."""
        scales = [piece.spline.step**6 * len(piece.time) / float(np.ptp(piece.time)) for piece in self.pieces]
        return SMOOTHEST * min(scales) / noise.states[0] ** 2

    def lower(
        self, at: Start, step: np.ndarray, moves: Sequence[np.ndarray], parts: Sequence[Linearised]
    ) -> tuple[Start, list[Misfit]]:
        """Where a step leads that lowers the cost: the whole, or a half of it as often as needed; here if none does."""
        before = self._whole(parts, at)
        size = 1.0
        while size >= SMALLEST_STEP:
            moved = _moved(at, size, step, moves)
            misfits = self._misfits(moved)
            if self._whole(misfits, moved) <= before * (1 + 1e-12):
                return moved, misfits
            size /= 2
        return at, self._misfits(at)

    def _misfits(self, at: Start) -> list[Misfit]:
        """Of all pieces."""
        work = partial(_misfit, self.measurement, at.noise)
        return list(self.run(work, self.pieces, at.coefficients, self._own(at.theta)))

    def _whole(self, parts: Sequence[Misfit | Linearised], at: Start) -> float:
        """The cost of all pieces and of θ."""
        off = at.theta - self.prior.mean
        of_theta = off @ self.prior.precision @ off + 2 * off @ sum(self.spread(at.marginal))
        return sum(each.cost for each in parts) + float(of_theta)

    def drifted(self, at: Start, root: np.ndarray) -> bool:
        """True where θ and the noise have left those for which its marginal likelihood was found, or none was.

        Args:
            at: Where they are.
            root: A root of the covariance of what is fitted (k, k).
        """
        if not len(self.free) or not len(at.noise.channels):
            return False
        if at.marginal is None or at.noise.change(at.marginal.noise) > DRIFTED_NOISE:
            return True
        moved = np.abs(at.theta - at.marginal.theta)[self.free] / np.linalg.norm(root, axis=1)
        return bool(moved.max(initial=0) > DRIFTED)

    def marginal(self, at: Start, *, midway: bool) -> Marginal:
        """What the marginal likelihood of θ adds, or midway between that and what it was taken to add before."""
        draws = -(-DRAWN // sum(len(piece.when) for piece in self.pieces))
        work = partial(pull, self.measurement, at.noise, draws)
        pulls = self.run(work, self.pieces, at.coefficients, self._own(at.theta), range(len(self.pieces)))
        if midway and at.marginal is not None:
            pulls = [(new + old) / 2 for new, old in zip(pulls, at.marginal.pulls, strict=True)]
        return Marginal(list(pulls), at.theta, at.noise)

    def spread(self, marginal: Marginal | None) -> list[np.ndarray]:
        """What it adds of every piece, zero where that is not known (p,)."""
        out = [np.zeros(len(self.free)) for _ in self.pieces]
        for whole, own, pulled in zip(out, self.selections, marginal.pulls if marginal else (), strict=False):
            whole[own] = pulled
        return out


def _misfit(measurement: Predictor, noise: Noise, piece: Piece, coefficients: np.ndarray, theta: np.ndarray) -> Misfit:
    return misfit(measurement, piece, coefficients, theta=theta, noise=noise)


def _linearised(
    measurement: Predictor,
    noise: Noise,
    wanted: np.ndarray,
    root: np.ndarray | None,
    piece: Piece,
    coefficients: np.ndarray,
    theta: np.ndarray,
    own: np.ndarray,
) -> Linearised:
    """A piece, its derivatives by its own parameters put where they stand among those that are wanted."""
    columns = np.flatnonzero(np.isin(own, wanted))
    place = np.searchsorted(wanted, own[columns])
    root = None if root is None else root[place]
    part = linearised(measurement, piece, coefficients, theta=theta, noise=noise, columns=columns, root=root)
    if len(columns) == len(wanted):
        return part
    schur, gradient = np.zeros((len(wanted), len(wanted))), np.zeros(len(wanted))
    by_theta = np.zeros((len(part.by_theta), len(wanted)))
    schur[np.ix_(place, place)], gradient[place], by_theta[:, place] = part.schur, part.gradient, part.by_theta
    return part._replace(schur=schur, gradient=gradient, by_theta=by_theta)


def _moved(at: Start, size: float, step: np.ndarray, moves: Sequence[np.ndarray]) -> Start:
    places = [c + size * move.reshape(c.shape) for c, move in zip(at.coefficients, moves, strict=True)]
    return replace(at, theta=at.theta + size * step, coefficients=places)


def _quiet(pieces: Sequence[Piece], at: Start, step: float, moves: Sequence[np.ndarray], noise: Noise) -> bool:
    """True where nothing moves any more that matters: beyond the samples a trajectory is free to."""
    std = at.noise.states[0]
    motion = 0.0
    for piece, move in zip(pieces, moves, strict=True):
        inside = piece.spline.within(piece.time[0], piece.time[-1])
        motion = max(motion, float(np.max(np.abs(move.reshape(-1, len(std))[inside]) / std, initial=0)))
    return step < SETTLED and motion < SETTLED_MOTION and noise.change(at.noise) < SETTLED_NOISE


def _found(noise: Noise, before: Noise) -> bool:
    """True where the channels' noise hardly changes any more, all together."""
    return bool(abs(np.log(noise.channels / before.channels).mean()) < SETTLED_EXPLORING)


def _leads_back(step: np.ndarray, before: np.ndarray, precision: np.ndarray) -> bool:
    """Whether a step undoes at least so much of the one before (k,): renewed noise alternates with it, and no further.

    Noise midway between the two, of which each is that of the other's parameters, ends such a cycle.
    """
    return bool(step @ precision @ before < -CYCLE * (before @ precision @ before) < 0)


def inverse_of_precision(precision: np.ndarray, names: Sequence[str] = ()) -> np.ndarray:
    """Inverse of a precision matrix.

    Raises:
        ExcitationError: It is not positive definite; the error has the names.
    """
    root = root_of_inverse(precision, names)
    return root @ root.T


def sandwich(precision: np.ndarray, scatter: np.ndarray, names: Sequence[str] = ()) -> np.ndarray:
    """Covariance `P⁻¹ M P⁻¹` by a precision P and the scatter M of the right side (k, k).

    Raises:
        ExcitationError: The precision is not positive definite; the error has the names.
    """
    root = root_of_inverse(precision, names)
    values, vectors = np.linalg.eigh(root.T @ scatter @ root)
    wider = root @ vectors * np.sqrt(np.maximum(values, LEAST_SCATTER))
    return np.asarray(wider @ wider.T)


def root_of_inverse(precision: np.ndarray, names: Sequence[str] = ()) -> np.ndarray:
    """A root R of the inverse of a precision matrix, R Rᵀ; the matrix is brought to unit diagonal first.

    Raises:
        ExcitationError: It is not positive definite; the error has the names.
    """
    scale = np.sqrt(np.maximum(np.diag(precision), TINIEST))
    try:
        factor = linalg.cholesky(precision / np.outer(scale, scale))
    except linalg.LinAlgError:
        raise ExcitationError("The recording does not determine all parameters.", tuple(names)) from None
    return np.asarray(linalg.solve_triangular(factor, np.eye(len(scale)))) / scale[:, None]


def embedded(matrix: np.ndarray, free: np.ndarray) -> np.ndarray:
    """A matrix over some entries of θ, zero elsewhere (p, p)."""
    out = np.zeros((len(free), len(free)))
    out[np.ix_(free, free)] = matrix
    return out
