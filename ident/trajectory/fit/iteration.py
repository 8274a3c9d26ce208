"""Simultaneous estimate of trajectory, parameters, set-up and noise of a recording.

minimise  Σ_m ‖x_m - C_m c‖² / σ_m² + Σ_c ‖w_c - f_c(c, θ)‖² / σ_c² + Σ_j λ_j ∫ x⃛_j² dt + ‖θ - θ_0‖²_prior

over spline coefficients c by Gauss-Newton steps, and over parameters θ the same without the third term, along the
trajectories that minimise all (generalised profiling, `ident.trajectory.algebra.arrow`). After each step, noise and
smoothness are updated by restricted maximum likelihood (`ident.trajectory.fit.restricted_likelihood`). Ordered by time
the curvature is banded, with a border for θ; pieces share only θ, so that their precisions add.
"""

import pickle
from collections.abc import Callable, Collection, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from typing import Any, NamedTuple, cast

import numpy as np

from ident.estimation.measurement import Measurement
from ident.trajectory.algebra.arrow import joined
from ident.trajectory.fit.fitted import Prior, Start, TrajectoryFit, share
from ident.trajectory.fit.piece import Noise, Piece, Point
from ident.trajectory.fit.piece_equations import Linearised, Misfit, linearised, misfit, normal_equations
from ident.trajectory.fit.precision import root_of_inverse
from ident.trajectory.fit.restricted_likelihood import renewed

ROUNDS = 60
"""Largest number of rounds of the iteration."""


class Tolerance(NamedTuple):
    """Largest last steps of θ, in its standard deviations, and of coefficients, in those of the coordinates."""

    theta: float
    motion: float

    def holds(self, theta: float, motion: float) -> bool:
        """True if these steps are smaller."""
        return theta < self.theta and motion < self.motion


SETTLED = Tolerance(0.02, 0.1)
"""Tolerance of convergence."""

NEAR = Tolerance(0.1, 0.5)
"""Tolerance of fits that only decide: what they decide does not change any more from there on."""

SETTLED_NOISE = 0.02
"""Largest last change of the noise, relative for standard deviations."""

SETTLED_EXPLORING = 0.005
"""Relative change of the geometric mean of the channels' noise that ends an exploring fit: a third of the difference
by which knots are chosen."""

SMOOTHEST = 1e7
"""Largest λ over `h⁶ rate / σ²`, which averages samples over some fifteen knots. With ten times as much, rounding may
reverse steps of resting coordinates."""

SMALLEST_STEP = 1 / 64
"""Least step length: if it does not lower the cost, no step is taken."""

Report = Callable[[int, float], None]
"""Callback with the number of each round and its largest step of θ, in standard deviations."""


def fit(
    measurement: Measurement,
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
    shares: bool = True,
    settled: Tolerance = SETTLED,
    executor: Executor | None = None,
    rounds: int = ROUNDS,
    report: Report | None = None,
) -> TrajectoryFit:
    """Fits trajectory, parameters and noise from a starting point.

    An interrupt (Ctrl-C) ends the iteration and returns its current state.

    Args:
        measurement: Channels and parameters.
        pieces: Measured samples.
        start: Starting point.
        prior: Prior of θ, unless the start has one.
        free: Mask of the entries of θ to fit (p,).
        names: Names of θ, by default those of the measurement.
        selections: Indices in θ of each piece's parameters; by default all entries for every piece.
        coloured: True if noise may be correlated over time.
        kept: Parts of the noise kept as at the start, out of `states`, `channels` and `jerk`; by default none.
        explore: True to end as soon as the channels' noise has converged.
        shares: True for the shares of the pieces, which an interrupted fit has anyway.
        settled: Tolerance with which the fit ends.
        executor: Executor for the pieces; by default they are computed here.
        rounds: Largest number of rounds.
        report: Called with every round.

    Raises:
        ExcitationError: The motion leaves parameters undetermined.
    """
    every, prior = [np.arange(len(free))] * len(pieces), start.prior or prior
    run = map if executor is None else executor.map
    sent = measurement if executor is None else cast(Measurement, _Sent(measurement))
    indices = names or measurement.names, selections or every
    problem = _Problem(sent, pieces, prior, free, *indices, run, coloured, kept, explore, settled)
    iteration = _Iteration(problem, start)
    status = iteration.ended(rounds, report)
    at = iteration.at
    wanted = problem.shares(at) if len(free) and (shares or status == "interrupted") else []
    ended = at.noises, at.coefficients, pieces, tuple(iteration.trace), status
    return TrajectoryFit(problem.names, problem.selections, prior, at.theta, wanted, free, *ended)


class _Iteration:
    """Gauss-Newton iteration of trajectory and parameters, with the state kept between steps.

    Attributes:
        at: Current point.
        trace: Largest step of θ of every round, in standard deviations.
    """

    def __init__(self, problem: "_Problem", start: Start) -> None:
        self.at, self.trace, self._problem = start, list[float](), problem
        self._stalled = 0

    def ended(self, rounds: int, report: Report | None) -> str:
        """Iterates to the end, and returns the `TrajectoryFit.status`."""
        fitted, root = np.flatnonzero(self._problem.free), None
        try:
            for _ in range(rounds):
                parts = self._problem.linearised(self.at, fitted, root)
                root = self._problem.root(parts)
                status = self._round(parts, root)
                if report:
                    report(len(self.trace) - 1, self.trace[-1])
                if status or self._stalled > 1:
                    return status or "stuck"
        except KeyboardInterrupt:
            return "interrupted"
        return "stopped"

    def _round(self, parts: Sequence[Linearised], root: np.ndarray) -> str:
        """Takes one step, and returns `converged` or `near` if the iteration ends, or nothing."""
        problem, free, at = self._problem, self._problem.free, self.at
        step = problem.step(at, parts, root)
        moves = [part.eliminated.step - part.eliminated.by_theta @ step[free] for part in parts]
        self.trace.append(float(np.max(np.abs(step[free]) / np.linalg.norm(root, axis=1), initial=0)))
        moved, misfits = problem.lower(at, step, moves, parts)
        noises = self._renewed(at.noises, parts, misfits)
        self._stalled = 0 if moved is not at else self._stalled + 1
        both = list(zip(noises, at.noises, strict=True))
        self.at = replace(moved, noises=noises)
        if problem.explore and len(self.trace) > 1 and all(_noise_converged(*pair) for pair in both):
            return "near"
        changed = max(new.change(old) for new, old in both)
        last = self.trace[-1], _motion(problem.pieces, at, moves)
        if not changed < SETTLED_NOISE or not problem.settled.holds(*last):
            return ""
        return "converged" if SETTLED.holds(*last) else "near"

    def _renewed(self, before: Sequence[Noise], parts: Sequence[Linearised], misfits: Sequence[Misfit]) -> list[Noise]:
        """Noise of every recording updated after a step."""
        out = list[Noise]()
        for log, old in enumerate(before):
            own = [k for k, piece in enumerate(self._problem.pieces) if piece.log == log]
            new = renewed(old, [parts[k] for k in own], [misfits[k] for k in own], coloured=self._problem.coloured)
            new = replace(new, jerk=np.minimum(new.jerk, self._problem.smoothest(new, log)))
            out.append(replace(new, **{name: getattr(old, name) for name in self._problem.kept}))
        return out


class _Sent:
    """Measurement for other processes, which unpickle it once: its programs may be large. Threads use it directly."""

    def __init__(self, measurement: Measurement) -> None:
        self._measurement = measurement

    @cached_property
    def _packed(self) -> bytes:
        return pickle.dumps(self._measurement)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._measurement, name)

    def __reduce__(self) -> tuple[Callable[[bytes], Measurement], tuple[bytes]]:
        return _unpacked, (self._packed,)


@lru_cache(maxsize=1)
def _unpacked(packed: bytes) -> Measurement:
    return cast(Measurement, pickle.loads(packed))


@dataclass(frozen=True, eq=False)
class _Problem:
    """Minimisation problem over all pieces, and what `fit` is asked for."""

    measurement: Measurement
    pieces: Sequence[Piece]
    prior: Prior
    free: np.ndarray
    names: Sequence[str]
    selections: Sequence[np.ndarray]
    run: Callable[..., Iterable[Any]]
    coloured: bool
    kept: Collection[str]
    explore: bool
    settled: Tolerance

    def linearised(self, at: Start, wanted: np.ndarray, root: np.ndarray | None) -> list[Linearised]:
        """Normal equations of every piece for some entries of θ, trajectories eliminated, other entries fixed.

        Args:
            at: Point of linearisation.
            wanted: Indices of these entries (k,).
            root: Root of their covariance (k, k), if known.
        """
        return list(self._run(partial(_linearised, self.measurement, wanted, root), at, self.selections))

    def shares(self, at: Start) -> list[tuple[np.ndarray, np.ndarray]]:
        """Precision and right side of θ from every piece, of fixed parameters as well: score tests need them."""
        every = self._run(partial(_share, self.measurement), at)
        pairs = zip(every, self.selections, strict=True)
        return [share(schur, right, own, len(self.free)) for (schur, right), own in pairs]

    def _run(self, work: Callable[..., Any], at: Start, *more: Iterable[Any]) -> Iterable[Any]:
        """Results of a function of each piece's point, and more."""
        return self.run(work, at.points(self.pieces, self.selections), *more)

    def root(self, parts: Sequence[Linearised]) -> np.ndarray:
        """Root of the covariance of the fitted parameters (k, k)."""
        names = [name for name, fitted in zip(self.names, self.free, strict=True) if fitted]
        known = self.prior.precision[np.ix_(self.free, self.free)]
        return root_of_inverse(sum((part.eliminated.precision for part in parts), start=known), names)

    def step(self, at: Start, parts: Sequence[Linearised], root: np.ndarray) -> np.ndarray:
        """Gauss-Newton step of θ (p,), from a root of the covariance of the fitted parameters (k, k)."""
        pulled = -self.prior.precision @ (at.theta - self.prior.mean)
        gradient = sum((part.eliminated.gradient for part in parts), start=pulled[self.free])
        step = np.zeros_like(at.theta)
        step[self.free] = root @ (root.T @ gradient)
        return step

    def smoothest(self, noise: Noise, log: int) -> np.ndarray:
        """Largest λ of a recording for which the equations can be solved (n,): at rest it would be infinite."""
        own = [piece for piece in self.pieces if piece.log == log]
        scales = [piece.spline.step**6 * len(piece.time) / float(np.ptp(piece.time)) for piece in own]
        return SMOOTHEST * min(scales) / noise.states**2

    def lower(
        self, at: Start, step: np.ndarray, moves: Sequence[np.ndarray], parts: Sequence[Linearised]
    ) -> tuple[Start, list[Misfit]]:
        """Point after a step that lowers the cost, halved as often as needed, and misfits there.

        Of the penalty, the part that θ leaves out counts for the motion alone: it is taken from the cost to second
        order in θ. The point is `at` itself if no step length lowers the cost.
        """
        before, size, own = self._whole(parts, at), 1.0, step[self.free]
        pull = sum(float(part.eliminated.pull @ own) for part in parts)
        bend = sum(float(own @ part.eliminated.bend @ own) for part in parts)
        while size >= SMALLEST_STEP:
            moved = _moved(at, size, step, moves)
            misfits = self._misfits(moved)
            if self._whole(misfits, moved) + size * (2 * pull - size * bend) <= before * (1 + 1e-12):
                return moved, misfits
            size /= 2
        return at, self._misfits(at)

    def _misfits(self, at: Start) -> list[Misfit]:
        """Misfits of all pieces."""
        return list(self._run(partial(misfit, self.measurement), at))

    def _whole(self, parts: Sequence[Misfit | Linearised], at: Start) -> float:
        """Cost of all pieces and of θ."""
        off = at.theta - self.prior.mean
        return sum(each.cost for each in parts) + float(off @ self.prior.precision @ off)


def _share(measurement: Measurement, point: Point) -> tuple[np.ndarray, np.ndarray]:
    """Precision and right side of all of a piece's θ."""
    equations = normal_equations(measurement, point, np.arange(len(point.theta)))
    return equations.eliminated.precision, equations.eliminated.gradient


def _linearised(
    measurement: Measurement, wanted: np.ndarray, root: np.ndarray | None, point: Point, own: np.ndarray
) -> Linearised:
    """Linearised piece, derivatives by its own θ placed among the wanted entries."""
    columns = np.flatnonzero(np.isin(own, wanted))
    place = np.searchsorted(wanted, own[columns])
    mine = np.zeros((len(columns), 0)) if root is None else root[place]
    part = linearised(measurement, point, columns=columns, root=mine)
    every = np.arange(point.coefficients.shape[1])
    return part._replace(eliminated=joined([(every, place, part.eliminated)], len(every), len(wanted)))


def _moved(at: Start, size: float, step: np.ndarray, moves: Sequence[np.ndarray]) -> Start:
    places = [c + size * move.reshape(c.shape) for c, move in zip(at.coefficients, moves, strict=True)]
    return replace(at, theta=at.theta + size * step, coefficients=places)


def _motion(pieces: Sequence[Piece], at: Start, moves: Sequence[np.ndarray]) -> float:
    """Largest step of coefficients between the first and last samples, in standard deviations of the coordinates."""
    motion = 0.0
    for piece, move in zip(pieces, moves, strict=True):
        std = at.noises[piece.log].states
        inside = piece.spline.within(piece.time[0], piece.time[-1])
        motion = max(motion, float(np.max(np.abs(move.reshape(-1, len(std))[inside]) / std, initial=0)))
    return motion


def _noise_converged(noise: Noise, before: Noise) -> bool:
    """True if the geometric mean of the channels' noise has converged."""
    return bool(abs(np.log(noise.channels / before.channels).mean()) < SETTLED_EXPLORING)
