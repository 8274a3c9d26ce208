"""What may be wrong with a recording or a model, judged from wrenches measured and predicted."""

from dataclasses import dataclass
from itertools import permutations, product

import numpy as np
from scipy import linalg, signal

from ident.estimation.noise import autocovariance
from ident.geometry.se3 import hat
from ident.mechanism.tree import Tree

TIE = 1.25
"""Errors within this factor of the smallest one are as good."""


@dataclass(frozen=True, eq=False)
class FrameCheck:
    """How a measured wrench would have to be turned in its own axes to look like the predicted one.

    Attributes:
        sign: 1, or -1 if the wrench of action was taken for that of reaction.
        rotation: The turn, by multiples of 90° or what a transposed frame takes (3, 3).
        error: Relative error of the wrench as it is, over that of the prediction.
        error_turned: The same with sign and rotation.
    """

    sign: int
    rotation: np.ndarray
    error: float
    error_turned: float

    @property
    def suspicious(self) -> bool:
        """Whether another sign or other axes fit far better."""
        turned = self.sign < 0 or not np.array_equal(self.rotation, np.eye(3))
        return bool(turned and self.error_turned < 0.5 * self.error)


@dataclass(frozen=True, eq=False)
class ContactCheck:
    """The unmeasured contact that explains a residual wrench best.

    Attributes:
        body: Name of the body that it would be on.
        point: Where, in the body's frame, m (3,).
        explained: Fraction of the residual moment that forces through that point explain.
    """

    body: str
    point: np.ndarray
    explained: float


def check_frame(measured: np.ndarray, predicted: np.ndarray, rotation: np.ndarray) -> FrameCheck:
    """Tries both signs, all 24 right-angled turns of a sensor's axes and its transposed frame against a prediction.

    Where nothing is found the forces alone are tried: moments also depend on where the sensor's origin is.

    Args:
        measured: Wrench in the sensor's frame, NaN in channels that are not measured (N, 6).
        predicted: What the prior model predicts there (N, 6).
        rotation: Rotation of the sensor's frame in the frame that it is mounted on (3, 3).
    """
    known = np.isfinite(measured).all(axis=0)
    check = _best_turn(np.where(known, measured, 0), predicted, known, rotation)
    if check.suspicious or not known[:3].all():
        return check
    forces = _best_turn(np.where(known, measured, 0), predicted, known & (np.arange(6) < 3), rotation)
    return forces if forces.suspicious else check


def _best_turn(measured: np.ndarray, predicted: np.ndarray, known: np.ndarray, rotation: np.ndarray) -> FrameCheck:
    size = np.linalg.norm(predicted.reshape(-1, 2, 3), axis=(0, 2))
    scale = np.repeat(np.maximum(size, 1e-3 * size.max(initial=1e-12)), 3)

    def error(sign: int, R: np.ndarray) -> float:
        turned = sign * (measured.reshape(-1, 2, 3) @ R.T).reshape(-1, 6)
        seen = (np.abs(linalg.block_diag(R, R)) @ known) > 0
        return float(np.linalg.norm(((turned - predicted) / scale)[:, seen]) / np.sqrt(seen.sum() / 3))

    straight, *right_angled = right_angled_rotations()
    simple = [(1, straight), (-1, straight), (1, rotation.T @ rotation.T)]
    turns = simple + [(sign, R) for sign in (1, -1) for R in right_angled]
    errors = [error(*turn) for turn in turns]
    # In a planar motion several fit; the simplest mistake is the likeliest.
    best = next(k for k, found in enumerate(errors) if found <= TIE * min(errors))
    sign, R = turns[best]
    return FrameCheck(sign, R, errors[0], errors[best])


def right_angled_rotations() -> list[np.ndarray]:
    """The 24 rotations that take axes to axes, the identity first."""
    turns = []
    for order, signs in product(permutations(range(3)), product((1, -1), repeat=3)):
        R = np.zeros((3, 3))
        R[range(3), order] = signs
        if np.linalg.det(R) > 0:
            turns.append(R)
    return sorted(turns, key=lambda R: -np.trace(R))


def check_contact(tree: Tree, q: np.ndarray, residual: np.ndarray) -> ContactCheck:
    """Where on the mechanism an unmeasured force would have to act to leave this residual.

    Args:
        tree: The mechanism.
        q: Joint coordinates (N, n_q).
        residual: Measured less predicted wrench in the base frame, all six channels (N, 6).

    Returns:
        The best body and point: the residual moment is least-squares fitted by `(p_i + R_i c) × F`.
    """
    force, moment = residual[:, :3], residual[:, 3:]
    poses = tree.poses(q)
    total = (moment**2).sum()
    found = []
    for i in tree.inertial:
        R, p = poses[:, i, :3, :3], poses[:, i, :3, 3]
        rows = (-hat(force) @ R).reshape(-1, 3)
        target = (moment - np.cross(p, force)).ravel()
        # Another driver's SVD can fail to converge on finite data.
        point = linalg.lstsq(rows, target, cond=1e-12, lapack_driver="gelsy")[0]
        left = ((target - rows @ point) ** 2).sum()
        found.append(ContactCheck(tree.bodies[i].name, point, float(1 - left / total) if total else 0.0))
    return max(found, key=lambda check: check.explained)


def correlation_time(residual: np.ndarray, rate: float) -> np.ndarray:
    """Time until the autocorrelation of each residual falls below 1/e, s (C,)."""
    times = []
    for x in (residual - residual.mean(axis=0)).T:
        correlation = autocovariance(x)[:-1]
        below = np.flatnonzero(correlation < correlation[0] / np.e) if correlation[0] > 0 else np.zeros(1, int)
        times.append((below[0] if len(below) else len(x)) / rate)
    return np.array(times)


def amplitude_spectrum(x: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies in Hz and amplitude spectral density of a signal (N,), by Welch's method."""
    frequency, power = signal.welch(x, rate, nperseg=min(len(x), 512))
    return frequency, np.sqrt(power)
