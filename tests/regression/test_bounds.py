"""Least squares take memory that does not grow, and are as accurate as Householder's QR."""

import tracemalloc
from collections.abc import Iterable
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import pytest

from docs.tools.mechanisms import Subject, double_pendulum
from ident.estimation.pieces import Source
from ident.estimation.samples import Samples
from ident.mechanism.motion import Motion
from ident.regression.ordinary import least_squares

PIECE = 10_000
"""Samples in a piece of a stream that is generated while it is read."""

SPREADS = 10.0 ** -np.arange(0, 5, 0.5)
"""Sizes of motions: the smaller, the worse the condition number."""

WRENCH_NOISE = (0.1, 1e-6)
"""Standard deviations of the noise on the wrench, N and N m."""

MEMORY = 6.0
"""Largest peak memory of an identification above its inputs, MB."""

ERROR = 2.0
"""Largest ratio of the error of ψ to that of LAPACK's Householder QR."""

SAMPLES = 2000
"""Samples of each problem that is solved in extended precision."""


@dataclass(frozen=True)
class Peak:
    """Peak memory of an identification of the double pendulum.

    Attributes:
        samples: Number of samples N.
        streamed: Peak above the memory in use before, with samples generated in pieces of `PIECE`, MB.
        in_memory: Peak above the arrays that hold all samples, MB.
    """

    samples: int
    streamed: float
    in_memory: float


def peaks(numbers: Iterable[int]) -> list[Peak]:
    """Peak memory for several numbers of samples."""
    mechanism, rows = double_pendulum(), []
    # Caches that are filled once for each mechanism are filled here.
    _peak(mechanism, mechanism.samples(PIECE))
    for number in numbers:
        held = mechanism.samples(number)
        rows.append(Peak(number, _peak(mechanism, mechanism.pieces(number, PIECE)), _peak(mechanism, held)))
    return rows


def _peak(mechanism: Subject, source: Source) -> float:
    """Peak memory above the memory in use before, MB."""
    tracemalloc.start()
    try:
        least_squares(mechanism.equations, source)
        return tracemalloc.get_traced_memory()[1] / 1e6
    finally:
        tracemalloc.stop()


@dataclass(frozen=True)
class Accuracy:
    """Errors of ψ against Householder's QR in extended precision, relative to the largest element of ψ.

    Attributes:
        condition_number: Condition number of the base regressor.
        ours: Error of `least_squares`.
        qr: Error of LAPACK's Householder QR in double precision.
        normal: Error of the plain normal equations.
    """

    condition_number: float
    ours: float
    qr: float
    normal: float


def accuracies() -> list[Accuracy]:
    """Errors for problems of increasing condition number, the larger of both noise levels."""
    rows = []
    for mechanism in (double_pendulum(), double_pendulum(tilt_deg=5)):
        for spread in SPREADS:
            each = [_accuracy(mechanism, spread, noise) for noise in WRENCH_NOISE]
            rows.append(Accuracy(*np.max([list(vars(accuracy).values()) for accuracy in each], axis=0).tolist()))
    return sorted(rows, key=lambda accuracy: accuracy.condition_number)


def _accuracy(mechanism: Subject, spread: float, noise: float) -> Accuracy:
    """Errors for small motions around one posture."""
    rng = np.random.default_rng(1)
    joints = len(mechanism.tree.freedoms)
    q = rng.normal(size=joints) + spread * rng.normal(size=(SAMPLES, joints))
    dq, ddq = spread * rng.normal(size=(2, SAMPLES, joints))
    samples = Samples(Motion(q, dq, ddq), noise * rng.normal(size=(SAMPLES, 6)))
    Y = mechanism.regressor(samples, mechanism.parameters.kept)
    samples.measured[:] += Y @ rng.normal(size=Y.shape[2])
    A, b = np.ascontiguousarray(Y).reshape(-1, Y.shape[2]), samples.measured.ravel()
    exact = _householder(A.astype(np.longdouble), b.astype(np.longdouble))
    estimate = least_squares(mechanism.equations, samples)
    Q, R = np.linalg.qr(A)

    def error(psi: np.ndarray) -> float:
        return float(abs(psi - exact).max() / abs(exact).max())

    return Accuracy(
        estimate.condition_number,
        error(estimate.psi),
        error(np.linalg.solve(R, Q.T @ b)),
        error(np.linalg.solve(A.T @ A, A.T @ b)),
    )


def _householder(A: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Least-squares solution of `A x = b` by reflections, in the precision of its arguments."""
    rows, columns = np.column_stack([A, b]), A.shape[1]
    for k in range(columns):
        v = rows[k:, k].copy()
        v[0] += np.copysign(np.sqrt(v @ v), v[0])
        v /= np.sqrt(v @ v)
        rows[k:, k:] -= 2 * np.outer(v, v @ rows[k:, k:])
    x = np.zeros(columns, A.dtype)
    for k in reversed(range(columns)):
        x[k] = (rows[k, -1] - rows[k, k + 1 : -1] @ x[k + 1 :]) / rows[k, k]
    return x


def test_householder_solves_exactly_solvable_least_squares():
    # A rational problem with a known solution from its normal equations in exact arithmetic.
    A, b = np.array([[1, 2], [3, 4], [5, 7], [1, 0]]), np.array([1, -2, 3, 5])
    (p, q, r), (u, v) = (A[:, 0] @ A[:, 0], A[:, 0] @ A[:, 1], A[:, 1] @ A[:, 1]), A.T @ b
    exact = [Fraction(int(r * u - q * v), int(p * r - q * q)), Fraction(int(p * v - q * u), int(p * r - q * q))]
    solution = _householder(A.astype(np.longdouble), b.astype(np.longdouble))
    np.testing.assert_allclose(solution.astype(float), [float(x) for x in exact], rtol=1e-15)


@pytest.mark.skipif(np.finfo(np.longdouble).eps >= np.finfo(float).eps, reason="no extended precision here")
def test_estimates_are_as_accurate_as_those_of_householders_qr():
    rows = accuracies()
    assert rows[0].condition_number < 40
    assert rows[-1].condition_number > 1e7
    for accuracy in rows:
        assert accuracy.ours <= ERROR * accuracy.qr
    # The problems are hard enough to distinguish the methods.
    assert rows[-1].normal > 1e4 * rows[-1].qr


def test_peak_memory_does_not_grow_with_the_samples():
    few, many = peaks((20_000, 200_000))
    for peak in (few, many):
        assert max(peak.streamed, peak.in_memory) < MEMORY
    assert many.streamed < few.streamed + 1
    # Arrays are checked for finite numbers, with a byte for each number at a time.
    assert many.in_memory < few.in_memory + 2
