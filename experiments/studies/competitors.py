"""Other methods for noisy joint angles, in a few lines each: filters, splines and instrumental variables.

Each estimates velocities and accelerations first, and treats the regressor Y at these states as exact:

    ψ = (Zᵀ Y)⁻¹ Zᵀ Γ

Least squares has Z = Y. With instrumental variables, Z is the regressor at other states, whose noise should be
independent of Y's.

References:
    Janot, Vandanjon and Gautier, A Generic Instrumental Variable Approach for Industrial Robot Identification, IEEE
    Transactions on Control Systems Technology 22(1), 2014, doi:10.1109/TCST.2013.2246163.
    Woltring, A Fortran package for generalized, cross-validatory spline smoothing and differentiation, Advances in
    Engineering Software 8(2), 1986, doi:10.1016/0141-1195(86)90098-7.
"""

import numpy as np
from scipy.interpolate import make_smoothing_spline

from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.model.regressor import base_wrench_regressor
from ident.recordings.recording import Recording
from ident.recordings.smoothing import chosen_cutoff, settling, smoothed

USUAL = 6.0
"""Cut-off, Hz, that gait laboratories use for markers."""

BLOCK = 50
"""Samples over which residuals may be correlated: half a second."""


def low_passed(mechanism: Mechanism, recording: Recording, cutoff: float | None = None) -> tuple[Motion, int]:
    """Angles and derivatives by a zero-phase Butterworth filter, and the samples that it takes to settle at each end.

    Args:
        mechanism: The mechanism.
        recording: Its joint angles.
        cutoff: Cut-off frequency, Hz, by default chosen from the angles.
    """
    q, rate = recording.of_joints(mechanism.tree.joints, "position"), recording.rate
    cutoff = chosen_cutoff(q, rate) if cutoff is None else cutoff
    return Motion(*smoothed(q, rate, cutoff)), settling(rate, cutoff)


def splined(mechanism: Mechanism, recording: Recording) -> tuple[Motion, int]:
    """Angles and derivatives by cubic smoothing splines, chosen by generalised cross-validation.

    Natural splines have no acceleration at the ends: half a second is to be left out there.
    """
    angles = recording.of_joints(mechanism.tree.joints, "position").T
    splines = [make_smoothing_spline(recording.time, q) for q in angles]
    q, dq, ddq = (np.stack([s.derivative(d)(recording.time) for s in splines], axis=1) for d in range(3))
    return Motion(q, dq, ddq), round(recording.rate / 2)


def instrumental(
    mechanism: Mechanism,
    kept: tuple[int, ...],
    recording: Recording,
    motion: Motion,
    instruments: Motion | None = None,
    edge: int = 0,
) -> tuple[np.ndarray, np.ndarray]:
    """Base parameters from the ground wrench by instrumental variables, channels weighted by their sensors' noise.

    Args:
        mechanism: The mechanism.
        kept: Columns of the regressor that the base parameters keep.
        recording: The ground wrench, with the covariance of its noise.
        motion: States of the regressor Y.
        instruments: States of the instruments Z, by default those of Y: least squares.
        edge: Samples to leave out at each end.

    Returns:
        Base parameters, and their standard deviations for residuals that are correlated within `BLOCK` samples (r,).
    """
    wrench = recording.wrench("ground")
    std = np.sqrt(np.diag(wrench.covariance)) if wrench.covariance is not None else np.ones(6)
    inside = slice(edge, len(motion) - edge)
    Y, Z = (_weighted(mechanism, kept, states[inside], std) for states in (motion, instruments or motion))
    measured = wrench.values[inside] / std
    normal = np.einsum("ncr,ncs->rs", Z, Y)
    psi = np.linalg.solve(normal, np.einsum("ncr,nc->r", Z, measured))
    pulls = np.einsum("ncr,nc->nr", Z, measured - Y @ psi)
    together = np.add.reduceat(pulls, np.arange(0, len(pulls), BLOCK))
    spread = np.linalg.solve(normal, together.T)
    return psi, np.sqrt((spread**2).sum(axis=1))


def _weighted(mechanism: Mechanism, kept: tuple[int, ...], motion: Motion, std: np.ndarray) -> np.ndarray:
    """Columns of the regressor, each channel divided by its noise (N, 6, r)."""
    Y = base_wrench_regressor(mechanism.tree, *motion.states, gravity=mechanism.gravity)
    return Y[..., list(kept)] / std[:, None]
