"""Regressor and identification against a loop over another library's regressor and `np.linalg.lstsq`."""

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np

from experiments.benchmark.mechanisms import Subject, chain, double_pendulum, mechanisms, subject
from experiments.benchmark.peers import PINOCCHIO_NAME, Pinocchio
from experiments.benchmark.timing import Comparison, Effort, alternating, with_and_without
from ident.estimation.accumulator import Accumulator, accumulate
from ident.estimation.samples import Samples
from ident.mechanism.motion import Motion
from ident.parameters.base_parameters import STANDARD_GRAVITY
from ident.regression.ordinary import Fit, least_squares

REGRESSOR, ACCUMULATION = "regressor", "accumulation"
AGAIN = "regressor, memory used again"
ALL_COLUMNS, BASE_COLUMNS = "identification, all columns", "identification, base columns"

TASKS = {
    REGRESSOR: "the matrix Y of all columns (N, 6, 10 b), against the loop that fills such a matrix",
    AGAIN: "the same into the memory of an earlier call (`out`), against the same loop, which fills new memory",
    ACCUMULATION: "all that least squares needs of the base columns (`accumulate`), against the same loop alone",
    ALL_COLUMNS: "from joint states and wrench to base parameters and their covariance (`least_squares`), the "
    "regrouping found before, against the loop and np.linalg.lstsq on all columns, without a covariance",
    BASE_COLUMNS: "the same against the loop and np.linalg.lstsq on the base columns",
}
"""The timed tasks. Before them, models are built, equations recorded, and states laid out for each side."""

LARGEST = 1_000_000
"""Largest N b for which the whole identification is compared; np.linalg.lstsq takes minutes and gigabytes beyond."""

PIECE = 100_000
"""Samples in a piece of a stream."""

CHAIN, LINKS = "arm", 30_000
"""Name of the arms of increasing length, and the largest number of their bodies times samples."""

AGREEMENT = 1e-7
"""Largest difference between our results and theirs, relative to the largest element."""

Ways = tuple[Callable[[], object], Callable[[], object]]


def comparisons(effort: Effort) -> list[Comparison]:
    """All comparisons, after a check that both sides agree on the samples.

    Raises:
        ValueError: They disagree.
    """
    rows = list(_compared(double_pendulum(), effort.samples, effort))
    for mechanism in mechanisms():
        for number in effort.sizes:
            rows += _compared(mechanism, number, effort)
    rows.append(_streamed(double_pendulum(), effort))
    rows += [_of_arm(arm, samples, effort) for arm, samples in arms(effort)]
    return rows


def arms(effort: Effort) -> Iterator[tuple[Subject, Samples]]:
    """Arms of increasing length, and samples of their motion without a wrench."""
    for bodies in effort.bodies:
        number = min(effort.sizes[-2], LINKS // bodies)
        motion = Motion(*np.random.default_rng(0).normal(size=(3, number, bodies - 1)))
        yield subject(CHAIN, chain(bodies)), Samples(motion, np.zeros((number, 6)))


def _of_arm(arm: Subject, samples: Samples, effort: Effort) -> Comparison:
    """Comparison of an arm's regressor; so few samples do not determine its parameters."""
    peer = Pinocchio(arm.tree, STANDARD_GRAVITY)
    states, every = peer.states(samples.motion.states, None), peer.columns(range(10 * len(arm.tree.inertial)))
    Y = arm.regressor(samples)
    check_agreement(f"{AGAIN}, {arm.name}", Y[:3], peer.regressor(*(x[:3] for x in states))[..., every])
    ways = with_and_without(partial(arm.regressor, samples, out=Y), partial(peer.regressor, *states))
    return _comparison(AGAIN, arm, len(samples), alternating(ways, effort.seconds, effort.least))


def solved(Y: np.ndarray, wrench: np.ndarray, columns: Sequence[int] | None = None) -> np.ndarray:
    """Solution of `np.linalg.lstsq` for a regressor (N, 6, 10 b), or some of its columns, and wrenches (N, 6)."""
    rows = Y.reshape(-1, Y.shape[2])
    # Taking columns is several times faster than indexing them.
    rows = rows if columns is None else np.take(rows, columns, axis=1)
    return np.linalg.lstsq(rows, wrench.ravel(), rcond=None)[0]


def _compared(mechanism: Subject, number: int, effort: Effort) -> Iterator[Comparison]:
    """Comparisons on one mechanism and number of samples."""
    samples = mechanism.samples(number)
    peer = Pinocchio(mechanism.tree, STANDARD_GRAVITY)
    _check(mechanism, samples[: effort.sizes[0]], peer)
    ways = _ways(mechanism, samples, peer)
    for task in TASKS:
        if task in (REGRESSOR, AGAIN, ACCUMULATION) or number * len(mechanism.tree.bodies) <= LARGEST:
            times = alternating(with_and_without(*ways[task]), effort.seconds, effort.least)
            yield _comparison(task, mechanism, number, times)


def _ways(mechanism: Subject, samples: Samples, peer: Pinocchio) -> dict[str, Ways]:
    """Our way and theirs for each of `TASKS`."""
    states = peer.states(samples.motion.states, samples.motion.base)
    kept = peer.columns(mechanism.parameters.kept)

    def loop() -> np.ndarray:
        return peer.regressor(*states)

    return {
        REGRESSOR: (partial(mechanism.regressor, samples), loop),
        AGAIN: (partial(mechanism.regressor, samples, out=mechanism.regressor(samples)), loop),
        ACCUMULATION: (partial(_accumulated, mechanism, samples), loop),
        ALL_COLUMNS: (partial(_identified, mechanism, samples), lambda: solved(loop(), samples.measured)),
        BASE_COLUMNS: (partial(_identified, mechanism, samples), lambda: solved(loop(), samples.measured, kept)),
    }


def _accumulated(mechanism: Subject, samples: Samples, start: Accumulator | None = None) -> Accumulator:
    return accumulate(mechanism.equations, samples, start=start)


def _identified(mechanism: Subject, samples: Samples) -> Fit:
    return least_squares(mechanism.equations, samples)


def _check(mechanism: Subject, samples: Samples, peer: Pinocchio) -> None:
    """Checks our results against theirs."""
    theirs = peer.regressor(*peer.states(samples.motion.states, samples.motion.base))
    every, kept = (peer.columns(columns) for columns in (range(theirs.shape[2]), mechanism.parameters.kept))
    psi = _identified(mechanism, samples).psi
    phi = solved(theirs, samples.measured)[every]
    for what, ours, other in (
        (REGRESSOR, mechanism.regressor(samples), theirs[..., every]),
        (ALL_COLUMNS, psi, mechanism.parameters.regroup(phi)),
        (BASE_COLUMNS, psi, solved(theirs, samples.measured, kept)),
    ):
        check_agreement(f"{what}, {mechanism.name}", ours, other)


def check_agreement(what: str, ours: np.ndarray, theirs: np.ndarray) -> None:
    """Checks that two results of one task agree.

    Raises:
        ValueError: They differ by more than `AGREEMENT`.
    """
    error = abs(ours - theirs).max() / abs(theirs).max()
    if not error < AGREEMENT:
        raise ValueError(
            f"Only what gives the same result is timed; {what}: results differ by {error:.1e} of the largest."
        )


def _streamed(mechanism: Subject, effort: Effort) -> Comparison:
    """Comparison of accumulating pieces in memory with the loop, which fills a matrix for one piece at a time."""
    samples = mechanism.samples(effort.streamed)
    pieces = [samples[k : k + PIECE] for k in range(0, effort.streamed, PIECE)]
    peer = Pinocchio(mechanism.tree, STANDARD_GRAVITY)
    states = [peer.states(piece.motion.states, None) for piece in pieces]

    def ours() -> None:
        sums = None
        for piece in pieces:
            sums = _accumulated(mechanism, piece, sums)

    def theirs() -> None:
        for piece in states:
            peer.regressor(*piece)

    times = alternating(with_and_without(ours, theirs), effort.seconds, effort.least)
    return _comparison(ACCUMULATION, mechanism, effort.streamed, times)


def _comparison(task: str, mechanism: Subject, number: int, times: np.ndarray) -> Comparison:
    return Comparison.of(task, mechanism.name, len(mechanism.tree.bodies), number, PINOCCHIO_NAME, times)
