"""Criteria of excitation, predicted standard deviations and functions of them, and the search for the best motion.

M = Σ Y_bᵀ C⁻¹ Y_b     information of a motion, C the covariance of the noise on a sample
σ = √diag M⁻¹          standard deviations of ψ by least squares, weighted by C
P = B S Bᵀ             prior covariance of ψ, S that of φ, and ψ = B φ the regrouping

Noise is white, and joint states are exact.
"""

import sys
from collections.abc import Sequence

import numpy as np
from scipy.linalg import block_diag, cho_factor, cho_solve
from tqdm import tqdm

from experiments.studies.excitation_problem import DesignProblem, drive_deviations
from ident.errors import InputError, ModelError
from ident.mechanism.motion import Motion
from ident.parameters.prior import known_rows
from sim.motion.collisions import Collisions
from sim.motion.excitation import FourierTrajectory
from sim.motion.excitation_design import (
    Cost,
    Limits,
    States,
    design,
    nearby_start,
    random_start,
    scaled_into,
)


def known_root(problem: DesignProblem) -> np.ndarray:
    """Root L of the prior covariance of ψ and drives, `P = Lᵀ L`; norms of its columns are standard deviations.

    Raises:
        ModelError: No body has a mass.
    """
    if problem.mechanism.prior is None:
        raise ModelError(
            "Deviations relative to what the model knows need a mass, and no body has one; choose --criterion "
            "determinant or condition."
        )
    root = np.linalg.qr(known_rows(problem.mechanism, problem.parameters))[1]
    if not problem.drives:
        return root
    return block_diag(root, np.diag(drive_deviations(problem.mechanism, problem.drives)))


def predicted_deviations(problem: DesignProblem, motion: Motion) -> np.ndarray:
    """Standard deviations σ of ψ and drives from a motion, by weighted least squares without a prior.

    Args:
        problem: The problem.
        motion: A sampled motion.

    Returns:
        σ in SI units (r + d,).
    """
    rows = (problem.whitening @ problem.regressor(*motion.states)).reshape(-1, len(problem.names))
    _, s, Vt = np.linalg.svd(rows, full_matrices=False)
    return np.linalg.norm(Vt.T / np.maximum(s, np.finfo(float).eps * s[0]), axis=1)


def quality(problem: DesignProblem, motion: Motion) -> dict[str, float]:
    """All criteria of a sampled motion by name; without masses, those relative to the prior are missing."""
    Y = problem.regressor(*motion.states)
    columns, weighted = (x.reshape(-1, Y.shape[2]) for x in (Y, problem.whitening @ Y))
    norms = np.maximum(np.linalg.norm(columns, axis=0), np.finfo(float).tiny)
    s = np.linalg.svd(columns, compute_uv=False)
    relative = {}
    if problem.mechanism.prior is not None:
        logarithm, _ = _relative_deviation(weighted.T @ weighted, known_root(problem))
        relative = {"geometric_mean_of_relative_deviations": float(np.exp(logarithm))}
    return {
        "condition_number": _ratio(s),
        "condition_number_of_unit_columns": _ratio(np.linalg.svd(columns / norms, compute_uv=False)),
        **relative,
        "log_det_information": 2 * float(np.log(np.linalg.svd(weighted, compute_uv=False)).sum()),
        "smallest_singular_value": float(s[-1]),
    }


def cost(problem: DesignProblem, criterion: str, samples: int) -> Cost:
    """Cost of a criterion of `defaults.CRITERIA`, as a logarithm, with its derivatives with respect to a motion.

    Args:
        problem: The problem.
        criterion: `deviations`: the geometric mean of the standard deviations of ψ relative to the prior ones. The
            prior counts as one more measurement (Chaloner and Verdinelli, Bayesian experimental design, Stat. Sci.
            1995, doi:10.1214/ss/1177009939), so that bodies too small to be identified do not dominate the design.
            The mean of squares instead, the trace of A-optimality, is dominated by the worst-determined parameter:
            within the paper's limits it gets an eighth smaller, and the geometric mean an eighth larger.
            `determinant`: det M to the power of -1/2r, D-optimality. `condition`: the condition number of Y_b.
        samples: Number of samples N of the motion's recording.

    Raises:
        ModelError: No body has a mass, so that there is no prior.
    """
    W = problem.whitening if criterion != "condition" else np.eye(len(problem.whitening))
    L = known_root(problem) if criterion == "deviations" else None

    def logarithm(q: np.ndarray, dq: np.ndarray, ddq: np.ndarray) -> tuple[float, States]:
        # Columns first, as in the regressor's memory.
        Y = W @ problem.regressor(q, dq, ddq).T
        columns, each = Y.reshape(len(Y), -1), samples / len(q)
        M = each * columns @ columns.T
        value, by_M = _eigenvalues(M, criterion) if L is None else _relative_deviation(M, L)
        # M is quadratic in Y: δf = Σ by_M · δM = 2 Σ (W Y by_M) · W δY.
        adjoints = W.T @ (2 * each * by_M @ columns).reshape(Y.shape)
        return value, problem.pulled_back(Motion(q, dq, ddq), adjoints.T)

    return logarithm


def _eigenvalues(M: np.ndarray, criterion: str) -> tuple[float, np.ndarray]:
    """Logarithm of det M to the power of -1/2r, or of the root of its condition number, and the derivative by M."""
    s, V = np.linalg.eigh(M)
    weights = np.full(len(s), -1 / len(s)) / 2
    if criterion == "condition":
        weights = np.zeros(len(s))
        weights[[0, -1]] = weights[[0, -1]] + [-0.5, 0.5]
    rounding = 1e-14 * s[-1]
    visible = s > rounding
    by_s = weights * visible / np.where(visible, s, 1)
    # The others count as a fraction of the largest.
    by_s[-1] += weights[~visible].sum() / s[-1]
    return float(weights @ np.log(np.where(visible, s, rounding))), (V * by_s) @ V.T


def _relative_deviation(M: np.ndarray, L: np.ndarray) -> tuple[float, np.ndarray]:
    """Logarithm of the geometric mean of √(diag (M + P⁻¹)⁻¹ / diag P), and its derivative by the information M (r, r).

    P = Lᵀ L may be singular: (M + P⁻¹)⁻¹ = Lᵀ A⁻¹ L with A = 1 + L M Lᵀ, and a variance v = lᵀ A⁻¹ l with l a column of
    L changes by -lᵀ A⁻¹ L δM Lᵀ A⁻¹ l.
    """
    known = np.linalg.norm(L, axis=0)
    columns = L[:, known > 0] / known[known > 0]
    solved = cho_solve(cho_factor(np.eye(len(L)) + L @ M @ L.T), columns)
    variances = np.sum(columns * solved, axis=0)
    left = L.T @ solved
    return float(np.log(variances).mean()) / 2, -(left / variances) @ left.T / (2 * len(variances))


def _ratio(singular_values: np.ndarray) -> float:
    return float(singular_values[0] / max(singular_values[-1], np.finfo(float).tiny))


def best(
    value: Cost,
    limits: Limits,
    starts: Sequence[FourierTrajectory],
    collisions: Collisions | None,
    iterations: int,
    seed: int,
) -> FourierTrajectory:
    """The best motion from several starts, and then from half as many near the best; prints progress to stderr.

    Collisions are only avoided for a motion that is better with them than the best one without so far. While no motion
    is found, the first start counts as the best.

    Args:
        value: Cost to minimize.
        limits: Joint limits.
        starts: Motions to start from.
        collisions: Bodies that must not touch; None for no checks.
        iterations: Largest number of iterations from each start.
        seed: Seed of the starts near the best.

    Raises:
        InputError: All motions collide.
    """
    if collisions is not None:
        check_starts(collisions, starts, limits)
    rng, near = np.random.default_rng([seed, 1]), len(starts) // 2
    lowest, chosen, time = np.inf, None, np.linspace(0, starts[0].duration, 401)
    for k in tqdm(range(len(starts) + near), desc="Starts", file=sys.stderr):
        start = starts[k] if k < len(starts) else nearby_start(chosen or starts[0], limits, rng)
        trajectory = design(value, limits, start, collisions=collisions, iterations=iterations, below=lowest)
        if trajectory is not None and (reached := value(*trajectory.states(time))[0]) < lowest:
            lowest, chosen = reached, trajectory
    if chosen is None:
        assert collisions is not None
        raise InputError(f"No motion without collisions was found: {_collision(collisions, starts, limits)}.")
    return chosen


def _collision(collisions: Collisions, starts: Sequence[FourierTrajectory], limits: Limits) -> str:
    """Names of the bodies that touch along the start with the fewest contacts."""
    time = np.linspace(0, starts[0].duration, 401)
    pairs = min((collisions.touching(scaled_into(s, limits).states(time)[0]) for s in starts), key=len)
    return _closer(collisions, list(pairs))


def check_starts(collisions: Collisions, starts: Sequence[FourierTrajectory], limits: Limits) -> None:
    """Checks before the search that no bodies touch in all postures.

    Raises:
        InputError: A pair touches in every posture of every start.
    """
    time = np.linspace(0, starts[0].duration, 101)
    always: set[tuple[str, str]] | None = None
    for start in starts:
        for posture in scaled_into(start, limits).states(time)[0]:
            pairs = set(collisions.touching(posture[None]))
            always = pairs if always is None else always & pairs
            if not always:
                return
    raise InputError(f"No motion is without collisions: in every posture {_closer(collisions, sorted(always or ()))}.")


def _closer(collisions: Collisions, pairs: Sequence[tuple[str, str]]) -> str:
    named = ", ".join(f"'{a}' and '{b}'" for a, b in pairs[:3]) or "bodies"
    return (
        f"{named} come closer than {collisions.clearance:g} m; to accept that, lower --clearance, exclude the pair in "
        "the model, or choose --collisions ignore"
    )


def start_motions(
    limits: Limits, rest: np.ndarray, duration: float, harmonics: int, count: int, seed: int
) -> list[FourierTrajectory]:
    """Random motions, the first one about the rest position (n,)."""
    rng = np.random.default_rng(seed)
    return [random_start(limits, duration, harmonics, rng, rest if k == 0 else None) for k in range(count)]
