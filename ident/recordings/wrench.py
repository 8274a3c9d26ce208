"""Wrenches moved between frames, and the total wrench of a mechanism with several contacts (Eq. 15-18)."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ident.errors import InputError
from ident.geometry.se3 import coAd
from ident.mechanism.body import is_rigid
from ident.mechanism.tree import Tree


@dataclass(frozen=True, eq=False)
class Contact:
    """What a sensor measures between a link and its surroundings.

    Attributes:
        body: Name of the link.
        exerted_by_link: Wrench `[F; τ]` that the link exerts *on its surroundings*, Γ_E of Eq. 15, in the sensor's
            frame, N and N m (N, 6). `Contact.applied_to_link` takes the opposite one.
        pose: Pose T_iE of the sensor's frame in the link's (4, 4), or one for each sample (N, 4, 4).
        covariance: Covariance of the measured wrench in the sensor's frame (6, 6); None if unknown.
        time: Sample times, s (N,), to be checked against the other measurements' if both are given.
    """

    body: str
    exerted_by_link: np.ndarray
    pose: np.ndarray
    covariance: np.ndarray | None = None
    time: np.ndarray | None = None

    def __post_init__(self) -> None:
        wrench, pose = np.asarray(self.exerted_by_link, float), np.asarray(self.pose, float)
        if wrench.ndim != 2 or wrench.shape[1] != 6 or not np.isfinite(wrench).all():
            raise InputError(f"The contact on '{self.body}' needs finite wrenches (N, 6), got shape {wrench.shape}.")
        if pose.shape not in ((4, 4), (len(wrench), 4, 4)) or not is_rigid(pose):
            raise InputError(
                f"The contact on '{self.body}' needs the pose of its sensor's frame, (4, 4) or ({len(wrench)}, 4, 4), "
                f"got {'none' if self.pose is None else pose.shape}."
            )
        _check_covariance(f"The contact on '{self.body}'", self.covariance)
        if self.time is not None and np.shape(self.time) != (len(wrench),):
            raise InputError(
                f"The contact on '{self.body}' needs {len(wrench)} sample times, got shape {np.shape(self.time)}."
            )

    @classmethod
    def applied_to_link(
        cls,
        body: str,
        wrench: np.ndarray,
        pose: np.ndarray,
        covariance: np.ndarray | None = None,
        time: np.ndarray | None = None,
    ) -> "Contact":
        """A contact from the wrench that the surroundings apply *to the link*, the other way round than Γ_E."""
        return cls(body, -np.asarray(wrench, float), pose, covariance, time)


@dataclass(frozen=True, eq=False)
class TotalWrench:
    """The right-hand side of `Y φ = Γ` with all contacts.

    Attributes:
        wrench: Γ `[F; τ]` in the base frame, N and N m (N, 6).
        covariance: Its covariance, one for each sample because contacts move (N, 6, 6); None if any part is unknown.
    """

    wrench: np.ndarray
    covariance: np.ndarray | None


def transform_wrench(T_ab: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """A wrench written in frame b, written in frame a: `coAd(T_ab) @ wrench` (Eq. 16).

    Args:
        T_ab: Poses of frame b in frame a (…, 4, 4).
        wrench: Wrenches `[F; τ]` in frame b (…, 6).

    Returns:
        Wrenches in frame a (…, 6).
    """
    return (coAd(T_ab) @ np.asarray(wrench, float)[..., None])[..., 0]


def transform_covariance(T_ab: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Covariance of a wrench after `transform_wrench`: `coAd(T_ab) C coAd(T_ab)ᵀ` (…, 6, 6)."""
    A = coAd(T_ab)
    return A @ covariance @ np.swapaxes(A, -1, -2)


def total_wrench(
    tree: Tree,
    q: np.ndarray,
    ground: np.ndarray | None,
    contacts: Sequence[Contact],
    *,
    ground_covariance: np.ndarray | None = None,
    time: np.ndarray | None = None,
) -> TotalWrench:
    """Eq. 17: `Γ = Γ_0 - Σ coAd(T_0E) Γ_E`, the wrench that the mechanism's own motion and weight need.

    Where nothing holds the base there is no Γ_0, and the contacts alone make up Γ (Eq. 3).

    Args:
        tree: The mechanism.
        q: Joint coordinates in rad, m or quaternions (N, n_q).
        ground: Γ_0, the wrench that the ground exerts on the base, in the base frame, N and N m (N, 6); None where
            nothing holds the base.
        contacts: Any number of contacts on any bodies.
        ground_covariance: Covariance of the measured Γ_0 (6, 6).
        time: Sample times, s (N,).

    Returns:
        The total wrench, with the sensors' covariances carried through the transport where all are known.

    Raises:
        InputError: A contact is on a body that does not exist, its samples do not match in number or time, or an array
            is not finite or of another shape.
    """
    if np.ndim(q) != 2:
        raise InputError(f"The total wrench needs joint coordinates (N, n_q), got shape {np.shape(q)}.")
    poses = tree.poses(q)
    if not np.isfinite(poses).all():
        raise InputError("The total wrench needs finite joint states.")
    if ground is None:
        if ground_covariance is not None:
            raise InputError("A covariance of the ground wrench needs a ground wrench, got None.")
        ground, ground_covariance = np.zeros((len(poses), 6)), np.zeros((6, 6))
    wrench = np.array(ground, float)
    if wrench.shape != (len(poses), 6) or not np.isfinite(wrench).all():
        raise InputError(
            f"{len(poses)} joint states need finite ground wrenches ({len(poses)}, 6), got shape {wrench.shape}."
        )
    _check_covariance("The ground wrench", ground_covariance)
    if time is not None and np.shape(time) != (len(poses),):
        raise InputError(f"{len(poses)} joint states need as many sample times, got shape {np.shape(time)}.")
    known = ground_covariance is not None and all(contact.covariance is not None for contact in contacts)
    covariance = np.tile(np.asarray(ground_covariance, float), (len(poses), 1, 1)) if known else None
    for contact in contacts:
        _check(contact, tree, len(poses), time)
        T_0E = poses[:, tree.names.index(contact.body)] @ contact.pose
        wrench -= transform_wrench(T_0E, contact.exerted_by_link)
        if covariance is not None and contact.covariance is not None:
            covariance += transform_covariance(T_0E, contact.covariance)
    return TotalWrench(wrench, covariance)


def _check(contact: Contact, tree: Tree, samples: int, time: np.ndarray | None) -> None:
    if contact.body not in tree.names:
        raise InputError(f"A contact is on '{contact.body}', but the mechanism's bodies are {', '.join(tree.names)}.")
    if len(contact.exerted_by_link) != samples:
        raise InputError(
            f"The contact on '{contact.body}' needs {samples} samples like the joint states, "
            f"got {len(contact.exerted_by_link)}."
        )
    if time is not None and contact.time is not None:
        shift = np.abs(np.asarray(contact.time) - time)
        if not shift.max() <= 1e-9:
            raise InputError(
                f"The contact on '{contact.body}' needs the joint states' sample times; they differ by up to "
                f"{shift.max():.3g} s, most at sample {int(shift.argmax())}."
            )


def _check_covariance(whose: str, covariance: np.ndarray | None) -> None:
    if covariance is None:
        return
    C = np.asarray(covariance, float)
    if C.shape != (6, 6) or not np.allclose(C, C.T):
        raise InputError(f"{whose} needs a symmetric covariance (6, 6), got shape {C.shape}.")
