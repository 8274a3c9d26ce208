"""Simultaneous estimate of trajectory, parameters, set-up and noise of a recording.

minimise  Σ_m ‖x_m - C_m c‖² / σ_m² + Σ_c ‖w_c - f_c(c, θ)‖² / σ_c² + Σ_j λ_j ∫ x⃛_j² dt + ‖θ - θ_0‖²_prior

over spline coefficients c by Gauss-Newton steps, and over parameters θ the same without the third term, along the
trajectories that minimise all (generalised profiling, `ident.trajectory.algebra.arrow`). Ordered by time the curvature
is banded, with a border for θ; pieces share only θ, so that their precisions add. After each step, noise and smoothness
are updated by restricted maximum likelihood:

    σ_m² <- ‖r_m‖² / (N_m - tr(H⁻¹ H_m)),      λ_j <- (rank P - λ_j tr(H⁻¹ P_j)) / (c_jᵀ P c_j + 2 / λ_j)

H_m and λ_j P_j are the parts of the curvature H from a stream of measurements and from the jerk's penalty (Wood and
Fasiolo, Biometrics 73, 2017, doi:10.1111/biom.12666). With 2 / λ_j, the likelihood times the variance 1 / λ_j has its
maximum (Li and Lahiri, J. Multivariate Analysis 101:882-892, 2010): by itself it is often largest without any motion
where that is below slow noise, and the motion that is lost is in no interval.

Each stream's noise has constant size, and may be correlated as `x_k = ρ x_k-1 + u_k`. Then sums r_k + r_k-1 and
differences r_k - r_k-1 are uncorrelated with variances v± = 2 σ² (1 ± ρ), which follow by the same update; the
trajectory absorbs more of the sums:

    v± <- v± · Σ s±² / ((1 ∓ ρ) N / 2 - tr(H⁻¹ H±)),      ρ <- (v+ - v-) / (v+ + v-)

with s± the corresponding halves of innovations (`ident.trajectory.algebra.whitening`) and H± = Σ (∂s±)ᵀ ∂s±. If the fit
absorbed nothing, this would be Burg's estimate, which is the first ρ where it exceeds chance.
"""

import pickle
from collections.abc import Callable, Collection, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache, partial
from typing import Any, NamedTuple, cast

import numpy as np

from ident.estimation.measurement import Measurement
from ident.estimation.noise import CHANCE
from ident.trajectory.algebra.arrow import joined
from ident.trajectory.fit.fitted import TINIEST, TrajectoryFit, root_of_inverse, share
from ident.trajectory.fit.piece import Noise, Point
from ident.trajectory.fit.piece_equations import Linearised, Misfit, linearised, misfit, normal_equations

ROUNDS = 60
"""Largest number of rounds of the iteration."""

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

LEAST_LEFT = 0.05
"""Least share of a stream's samples that counts as degrees of freedom of its noise."""

MOST_CORRELATED = 0.99
"""Upper limit of ρ; above it the mean of a channel is practically free."""

WHITE_AGAIN = 1.0
"""Correlation, in standard deviations of that of white noise, below which correlated noise becomes white again."""

COLOURED_FLOOR = 15.0
"""Relative increase of the floor of a channel's noise at ρ = 1: there are model errors then, and the trajectory's fit
to the channel is no measure of its noise."""

LEAST_MOTION = 2.0
"""Least degrees of freedom of a coordinate's motion in a recording. Where a joint of a person swings by 1° in noise of
.5° that lasts, its motion was lost and parameters were off by up to 3.7 s.d. for it, with this by .8."""

ALIKE = 0.1
"""Least noise of a component relative to the median of its sensor's components in the same unit."""

TINY = 1e-3
"""Lower limit of numbers of samples."""


class Tolerance(NamedTuple):
    """Largest last steps of θ, in its standard deviations, and of coefficients, in those of the coordinates."""

    theta: float
    motion: float

    def holds(self, theta: float, motion: float) -> bool:
        """True if these steps are smaller."""
        return theta < self.theta and motion < self.motion


SETTLED = Tolerance(0.02, 0.1)
"""Tolerance of convergence; that of θ is that of the noise, too, relative for standard deviations."""

NEAR = Tolerance(0.1, 0.5)
"""Tolerance of fits that only decide: what they decide does not change any more from there on."""


def fit(
    measurement: Measurement,
    begin: TrajectoryFit,
    *,
    coloured: bool = True,
    kept: Collection[str] = (),
    explore: bool = False,
    shares: bool = True,
    settled: Tolerance = SETTLED,
    executor: Executor | None = None,
    rounds: int = ROUNDS,
    report: Report | None = None,
) -> TrajectoryFit:
    """Fits trajectory, free parameters and noise from a starting point.

    An interrupt (Ctrl-C) ends the iteration and returns its current state.

    Args:
        measurement: Channels and parameters.
        begin: Starting point.
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
    run = map if executor is None else executor.map
    sent = measurement if executor is None else cast(Measurement, _Sent(measurement))
    computer = _Computer(sent, run)
    at, trace, status, root, stalled = begin, list[float](), "stopped", None, 0
    try:
        for number in range(rounds):
            parts = computer.linearised(at, root)
            root = _root(at, parts)
            step = _step(at, parts, root)
            moves = [part.eliminated.step - part.eliminated.by_theta @ step[at.free] for part in parts]
            last = float(np.max(np.abs(step[at.free]) / np.linalg.norm(root, axis=1), initial=0)), _motion(at, moves)
            trace.append(last[0])
            moved, misfits = computer.lower(at, step, moves, parts)
            stalled = 0 if moved is not at else stalled + 1
            before, noises = at.noises, _renewed(at, parts, misfits, coloured=coloured, kept=kept)
            at = replace(moved, noises=noises)
            if report:
                report(number, last[0])
            both = list(zip(noises, before, strict=True))
            if explore and number and all(_noise_converged(*pair) for pair in both):
                status = "near"
            elif max(new.change(old) for new, old in both) < SETTLED.theta and settled.holds(*last):
                status = "converged" if SETTLED.holds(*last) else "near"
            elif stalled > 1:
                status = "stuck"
            if status != "stopped":
                break
    except KeyboardInterrupt:
        status = "interrupted"
    wanted = computer.shares(at) if len(at.free) and (shares or status == "interrupted") else []
    return replace(at, shares=wanted, trace=tuple(trace), status=status, scatters=None, bounded=None)


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
class _Computer:
    """Contributions of every piece, computed here or by an executor."""

    measurement: Measurement
    run: Callable[..., Iterable[Any]]

    def linearised(self, at: TrajectoryFit, root: np.ndarray | None) -> list[Linearised]:
        """Normal equations of every piece for the free entries of θ, trajectories eliminated, other entries fixed.

        Args:
            at: Point of linearisation.
            root: Root of the covariance of these k entries (k, k), if known.
        """
        work = partial(_linearised, self.measurement, np.flatnonzero(at.free), root)
        return list(self.run(work, at.points, at.selections))

    def shares(self, at: TrajectoryFit) -> list[tuple[np.ndarray, np.ndarray]]:
        """Precision and right side of θ from every piece, of fixed parameters as well: score tests need them."""
        pairs = zip(self.run(partial(_share, self.measurement), at.points), at.selections, strict=True)
        return [share(schur, right, own, len(at.free)) for (schur, right), own in pairs]

    def lower(
        self, at: TrajectoryFit, step: np.ndarray, moves: Sequence[np.ndarray], parts: Sequence[Linearised]
    ) -> tuple[TrajectoryFit, list[Misfit]]:
        """Point after a step that lowers the cost, halved as often as needed, and misfits there.

        Of the penalty, the part that θ leaves out counts for the motion alone: it is taken from the cost to second
        order in θ. The point is `at` itself if no step length lowers the cost.
        """
        before, size, own = _whole(parts, at), 1.0, step[at.free]
        pull = sum(float(part.eliminated.pull @ own) for part in parts)
        bend = sum(float(own @ part.eliminated.bend @ own) for part in parts)
        while size >= SMALLEST_STEP:
            moved = _moved(at, size, step, moves)
            misfits = self._misfits(moved)
            if _whole(misfits, moved) + size * (2 * pull - size * bend) <= before * (1 + 1e-12):
                return moved, misfits
            size /= 2
        return at, self._misfits(at)

    def _misfits(self, at: TrajectoryFit) -> list[Misfit]:
        """Misfits of all pieces."""
        return list(self.run(partial(misfit, self.measurement), at.points))


def _whole(parts: Sequence[Misfit | Linearised], at: TrajectoryFit) -> float:
    """Cost of all pieces and of θ."""
    off = at.theta - at.prior.mean
    return sum(each.cost for each in parts) + float(off @ at.prior.precision @ off)


def _root(at: TrajectoryFit, parts: Sequence[Linearised]) -> np.ndarray:
    """Root of the covariance of the free parameters (k, k)."""
    names = [name for name, fitted in zip(at.names, at.free, strict=True) if fitted]
    known = at.prior.precision[np.ix_(at.free, at.free)]
    return root_of_inverse(sum((part.eliminated.precision for part in parts), start=known), names)


def _step(at: TrajectoryFit, parts: Sequence[Linearised], root: np.ndarray) -> np.ndarray:
    """Gauss-Newton step of θ (p,), from a root of the covariance of the free parameters (k, k)."""
    pulled = -at.prior.precision @ (at.theta - at.prior.mean)
    gradient = sum((part.eliminated.gradient for part in parts), start=pulled[at.free])
    step = np.zeros_like(at.theta)
    step[at.free] = root @ (root.T @ gradient)
    return step


def _renewed(
    at: TrajectoryFit,
    parts: Sequence[Linearised],
    misfits: Sequence[Misfit],
    *,
    coloured: bool,
    kept: Collection[str],
) -> list[Noise]:
    """Noise of every recording updated after a step."""
    out = list[Noise]()
    for log, old in enumerate(at.noises):
        own = [k for k, piece in enumerate(at.pieces) if piece.log == log]
        new = renewed(old, [parts[k] for k in own], [misfits[k] for k in own], coloured=coloured)
        # A larger λ, infinite at rest, would leave equations that cannot be solved.
        splines = [(at.pieces[k].spline, at.pieces[k].time) for k in own]
        scale = min(spline.step**6 * len(time) / float(np.ptp(time)) for spline, time in splines)
        new = replace(new, jerk=np.minimum(new.jerk, SMOOTHEST * scale / new.states**2))
        out.append(replace(new, **{name: getattr(old, name) for name in kept}))
    return out


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


def _moved(at: TrajectoryFit, size: float, step: np.ndarray, moves: Sequence[np.ndarray]) -> TrajectoryFit:
    places = [c + size * move.reshape(c.shape) for c, move in zip(at.coefficients, moves, strict=True)]
    return replace(at, theta=at.theta + size * step, coefficients=places)


def _motion(at: TrajectoryFit, moves: Sequence[np.ndarray]) -> float:
    """Largest step of coefficients between the first and last samples, in standard deviations of the coordinates."""
    motion = 0.0
    for piece, move in zip(at.pieces, moves, strict=True):
        std = at.noises[piece.log].states
        inside = piece.spline.within(piece.time[0], piece.time[-1])
        motion = max(motion, float(np.max(np.abs(move.reshape(-1, len(std))[inside]) / std, initial=0)))
    return motion


def _noise_converged(noise: Noise, before: Noise) -> bool:
    """True if the geometric mean of the channels' noise has converged."""
    return bool(abs(np.log(noise.channels / before.channels).mean()) < SETTLED_EXPLORING)


def renewed(noise: Noise, parts: Sequence[Linearised], misfits: Sequence[Misfit], *, coloured: bool) -> Noise:
    """Noise after restricted-likelihood updates of standard deviations, smoothness and, if requested, correlation.

    Args:
        noise: Noise before.
        parts: Linearised pieces at the last iterate.
        misfits: Misfits of the pieces after the step; those before it still reflect the old noise.
        coloured: True to update the correlation.
    """
    taken, held = (np.sum([getattr(part, k) for part in parts], axis=0) for k in ("taken", "held"))
    squares, number, bends, rank = (
        np.sum([getattr(each, k) for each in misfits], axis=0) for k in ("squares", "number", "bends", "rank")
    )
    left = np.maximum(number - taken, np.maximum(LEAST_LEFT * number, TINY))
    growth = np.where(number > 0, squares / left, 1.0)
    states = len(noise.states)
    of_states, of_channels = growth[:, :states], growth[:, states:]
    floors = _floors(noise)
    new = {
        "states": np.maximum(noise.states * np.sqrt(of_states[0]), floors["states"]),
        "channels": np.maximum(noise.channels * np.sqrt(of_channels[0]), floors["channels"]),
        "jerk": np.maximum(rank - held, TINY) / (bends + LEAST_MOTION / noise.jerk),
    }
    if coloured:
        linked = number[1:].sum(axis=0)
        new["states_rho"] = _correlation(noise.states_rho, of_states[1:], linked[:states])
        new["channels_rho"] = _correlation(noise.channels_rho, of_channels[1:], linked[states:])
    return replace(noise, **new)


def _floors(noise: Noise) -> dict[str, np.ndarray]:
    """Smallest standard deviations of states and channels after an update."""
    channels = noise.floor_channels * (1 + COLOURED_FLOOR * noise.channels_rho**2)
    for group in set(noise.alike):
        own = np.array(noise.alike) == group
        channels[own] = np.maximum(channels[own], ALIKE * np.median(noise.channels[own]))
    return {"states": noise.floor_states, "channels": channels}


def _correlation(rho: np.ndarray, growth: np.ndarray, linked: np.ndarray) -> np.ndarray:
    """Updated ρ from the factors by which the variances of sums and differences change.

    Args:
        rho: ρ before (…).
        growth: Factors (2, …) on the variances, which were as 1 + ρ to 1 - ρ.
        linked: Number of samples that follow another one (…).
    """
    sums, differences = growth[0] * (1 + rho), growth[1] * (1 - rho)
    # Both are zero for a residual of zero.
    new = (sums - differences) / np.maximum(sums + differences, TINIEST)
    white = new < np.where(rho == 0, CHANCE, WHITE_AGAIN) / np.sqrt(np.maximum(linked, 1))
    return np.where(white, 0.0, np.clip(new, 0, MOST_CORRELATED))
