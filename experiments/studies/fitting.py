"""One model identified from one recording."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.estimation.equations import Equations
from ident.estimation.least_squares import Fit, huber_white, least_squares
from ident.estimation.samples import Samples
from ident.mechanism.body import BASE
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.parameters.base_parameters import BaseParameters, structural_base_parameters
from ident.recordings.recording import Recording


@dataclass(frozen=True, eq=False)
class Trial:
    """A model's base parameters: the estimate, what the true φ gives by the same regrouping, and what is predicted.

    Attributes:
        estimate: The estimate.
        psi_true: True base parameters (r,).
        predicted: Total wrench that the estimate predicts at the measured joint states (N, 6).
    """

    estimate: Fit
    psi_true: np.ndarray
    predicted: np.ndarray

    @property
    def base(self) -> BaseParameters:
        """The regrouping."""
        return self.estimate.parameters

    @property
    def error(self) -> np.ndarray:
        """Estimated minus true base parameters."""
        return self.estimate.psi - self.psi_true


def fit(
    mechanism: Mechanism,
    recording: Recording,
    *,
    wrench: np.ndarray | None = None,
    covariance: np.ndarray | None = None,
    kept: Sequence[str] | None = None,
) -> Trial:
    """Base parameters of one model from measured joint states and wrenches.

    Args:
        mechanism: The model's mechanism, with the true φ for its prior.
        recording: Measured joint states and ground wrench.
        wrench: Total wrench `[F; τ]`, N and N m (N, 6); by default the recording's ground wrench alone.
        covariance: Its covariance (N, 6, 6), to weight by; by default ordinary least squares.
        kept: Names of the base parameters; by default the first independent columns.

    Raises:
        ExcitationError: The motion does not separate the base parameters.
        InputError: `kept` is not a basis.
    """
    joints = mechanism.tree.joints
    motion = Motion(*recording.joint_states(joints))
    measured = recording.wrench("ground").values if wrench is None else wrench
    samples = Samples(motion, measured, covariance)
    base = structural_base_parameters(mechanism, kept=None if kept is None else tuple(kept))
    noise = recording.joint_noise(joints)
    estimate = least_squares(Equations(mechanism, base), samples, state_noise=noise)
    return Trial(huber_white(estimate, samples), base.regroup(mechanism.known), estimate.predicted(motion))


def measured_poses(tree: Tree, recording: Recording) -> np.ndarray:
    """Measured pose of every body in the base frame (N, b, 4, 4); a welded body goes with its parent."""
    poses: list[np.ndarray] = []
    for body in tree.bodies:
        parent = np.tile(np.eye(4), (len(recording.time), 1, 1)) if body.parent == BASE else poses[body.parent]
        poses.append(recording.poses(body.name) if body.moves else parent @ body.home)
    return np.stack(poses, axis=1)
