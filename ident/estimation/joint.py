"""Trajectory, parameters, set-up and noise of a recording at once.

minimise  Σ_m ‖x_m - C_m c‖² / σ_m² + Σ_c ‖w_c - f_c(c, θ)‖² / σ_c² + Σ_j λ_j ∫ x⃛_j² dt + ‖θ - θ_0‖²_prior

over spline coefficients c and parameters θ by Gauss-Newton steps, θ with what its marginal likelihood adds
(`ident.estimation.marginal_likelihood`). After each of them noise and smoothness follow by restricted maximum
likelihood (`ident.estimation.restricted_likelihood`). Ordered by time the curvature is banded, but for a border of θ;
pieces share θ alone, so that their Schur complements add.
"""

import pickle
from collections.abc import Callable, Collection, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, cast

import numpy as np

from ident.estimation.joint_fit import JointFit, Marginal, Prior, Start
from ident.estimation.marginal_likelihood import pull
from ident.estimation.piece import Linearised, Misfit, Noise, Piece, Predictor, linearised, misfit
from ident.estimation.precision import root_of_inverse
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

FARTHEST = 1.0
"""Step of θ, in its standard deviations, that a change of what it adds may ask for at once: it is no straight line."""

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

Report = Callable[[int, float], None]
"""Is called with every round and its largest step of θ, in standard deviations."""


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
    iteration = _Iteration(problem, coloured, kept, explore, start)
    status = iteration.ended(rounds, report)
    at = iteration.at
    # Of what was held as well: it shows by how much that would go if it were not.
    unasked = not len(free) or (explore and status != "interrupted")
    last = [] if unasked else problem.linearised(at, np.arange(len(free)))
    pulls = problem.spread(at.pulls)[: len(last)]
    return JointFit(
        problem.names,
        problem.selections,
        prior,
        at.theta,
        [(part.schur, part.gradient - pulled) for part, pulled in zip(last, pulls, strict=True)],
        free,
        at.noise,
        at.coefficients,
        pieces,
        tuple(iteration.trace),
        status,
        marginal=at.marginal,
    )


class _Iteration:
    """Gauss-Newton steps of trajectory and parameters, and what they remember of each other.

    Attributes:
        at: Where it is.
        trace: Largest step of θ in standard deviations of every round.
    """

    def __init__(self, problem: "_Problem", coloured: bool, kept: Collection[str], explore: bool, start: Start) -> None:
        self.at, self.trace = start, list[float]()
        self._problem, self._coloured, self._kept, self._explore = problem, coloured, kept, explore
        self._was_coloured, self._now_coloured = False, bool(start.noise.channels_rho.any())
        self._step, self._stride = np.zeros_like(start.theta), cast("Stride | None", None)
        self._leads_back, self._stalled = False, 0

    def ended(self, rounds: int, report: Report | None) -> str:
        """Goes on until it ends, and returns why, as `JointFit.status` has it."""
        fitted, root = np.flatnonzero(self._problem.free), None
        try:
            for _ in range(rounds):
                parts = self._problem.linearised(self.at, fitted, root)
                root = self._problem.root(parts)
                quiet = self._round(parts, root)
                if quiet or self._stalled > 1:
                    return "converged" if quiet else "stuck"
                if report:
                    report(len(self.trace) - 1, self.trace[-1])
        except KeyboardInterrupt:
            return "interrupted"
        return "stopped"

    def _round(self, parts: Sequence[Linearised], root: np.ndarray) -> bool:
        """Takes one step, and returns whether nothing moves any more that matters."""
        problem, free, at = self._problem, self._problem.free, self.at
        if not self._explore and problem.drifted(at, root):
            at = replace(at, marginal=problem.marginal(at, root, part=0.5 if self._leads_back else 1.0))
        step = problem.step(at, parts, root)
        moves = [part.step - part.by_theta @ step[free] for part in parts]
        self.trace.append(float(np.max(np.abs(step[free]) / np.linalg.norm(root, axis=1), initial=0)))
        moved, misfits = problem.lower(at, step, moves, parts)
        noise = self._noise(at.noise, parts, misfits)
        self._stalled = 0 if moved is not at else self._stalled + 1
        self._leads_back = _leads_back(step[free], self._step[free], problem.precision(parts))
        self.at, self._step = replace(moved, noise=noise.midway(at.noise) if self._leads_back else noise), step
        if self._explore and len(self.trace) > 1 and _found(noise, at.noise):
            return True
        return (self._was_coloured or not self._coloured) and _quiet(problem.pieces, at, self.trace[-1], moves, noise)

    def _noise(self, before: Noise, parts: Sequence[Linearised], misfits: Sequence[Misfit]) -> Noise:
        """The noise after a step, its smoothness hastened where it is that which is waited for."""
        near, self._was_coloured = self.trace[-1] < NEAR, self._now_coloured
        self._now_coloured = self._coloured and (self._was_coloured or near or len(self.trace) > COLOURED)
        noise = renewed(before, parts, misfits, coloured=self._now_coloured)
        last, self._stride = self._stride, Stride(np.log(before.jerk), np.log(noise.jerk / before.jerk))
        jerk = hastened(last, self._stride) if near else noise.jerk
        noise = replace(noise, jerk=np.minimum(jerk, self._problem.smoothest(noise)))
        return replace(noise, **{name: getattr(before, name) for name in self._kept})


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
        pulled = -self.prior.precision @ (at.theta - self.prior.mean) - sum(self.spread(at.pulls))
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
        of_theta = off @ self.prior.precision @ off + 2 * off @ sum(self.spread(at.pulls))
        return sum(each.cost for each in parts) + float(of_theta)

    def drifted(self, at: Start, root: np.ndarray) -> bool:
        """True where θ and the noise have left those for which its marginal likelihood was found, or none was.

        Args:
            at: Where they are.
            root: A root of the covariance of what is fitted (k, k).
        """
        if not len(self.free) or not len(at.noise.channels):
            return False
        if at.marginal is None or not at.marginal.whole or at.noise.change(at.marginal.noise) > DRIFTED_NOISE:
            return True
        moved = np.abs(at.theta - at.marginal.theta)[self.free] / np.linalg.norm(root, axis=1)
        return bool(moved.max(initial=0) > DRIFTED)

    def marginal(self, at: Start, root: np.ndarray, part: float) -> Marginal:
        """Terms that the marginal likelihood of θ adds to the gradient.

        Args:
            at: Where.
            root: A root of the covariance of what is fitted (k, k).
            part: Part of the way there from what it was taken to add before; less of it where θ would move far.
        """
        draws = -(-DRAWN // sum(len(piece.when) for piece in self.pieces))
        work = partial(pull, self.measurement, at.noise, draws)
        pulls = self.run(work, self.pieces, at.coefficients, self._own(at.theta), range(len(self.pieces)))
        old = at.pulls or [np.zeros(len(own)) for own in self.selections]
        changes = [new - was for new, was in zip(pulls, old, strict=True)]
        change = np.sum(self.spread(changes), axis=0)[self.free]
        far = np.abs(root @ (root.T @ change)) / np.linalg.norm(root, axis=1)
        part *= min(1.0, FARTHEST / max(far.max(initial=0), TINIEST))
        pulls = [was + part * each for was, each in zip(old, changes, strict=True)]
        return Marginal(pulls, at.theta, at.noise, part == 1)

    def spread(self, pulls: Sequence[np.ndarray]) -> list[np.ndarray]:
        """Every piece's pulls where its parameters stand in θ, zero where there are none yet (p,)."""
        out = [np.zeros(len(self.free)) for _ in self.pieces]
        for whole, own, pulled in zip(out, self.selections, pulls, strict=False):
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
