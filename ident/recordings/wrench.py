"""Wrenches moved between frames, and the total wrench of a mechanism with several contacts (Eq. 15-18)."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ident.annotations import typed
from ident.errors import InputError, LogError
from ident.geometry.se3 import applied, coAd, inverse
from ident.mechanism.body import is_rigid
from ident.mechanism.tree import Tree

GROUND = "ground"
"""Name of the wrench at the base; all others are contacts."""

FRAMES = ("body", "world")
"""Frames of a sensor: it moves with its link, or rests in the world like a force plate."""


@typed()
@dataclass(frozen=True, eq=False)
class Sensor:
    """Place and sign of a measured wrench.

    Attributes:
        body: Name of the link in contact; None for the ground wrench.
        pose: Pose of the sensor's frame in the link's frame, for the ground wrench in the base frame (4, 4). For a
            frame at rest, its pose in the frame of a moving base's poses, which is the base frame of a base at rest.
        applied_to_link: True if readings are what the surroundings exert on the mechanism; otherwise they are what the
            link exerts on its surroundings, Γ_E of Eq. 15.
        frame: One of `FRAMES`: `body` if the sensor's frame moves with the link, `world` if it rests.
        plate: Name of the plate if several bodies take turns on it: each has a wrench of its own, zero while it is not
            on the plate, and all share the plate's pose. Empty otherwise.
    """

    body: str | None = None
    pose: np.ndarray = field(default_factory=lambda: np.eye(4))
    applied_to_link: bool = True
    frame: str = "body"
    plate: str = ""

    def __post_init__(self) -> None:
        _check_frame(f"The sensor on '{self.body}'", self.frame, self.body)
        if np.shape(self.pose) != (4, 4) or not is_rigid(self.pose):
            raise LogError(f"The sensor on '{self.body}' needs a rigid pose (4, 4), got shape {np.shape(self.pose)}.")


@typed("pose")
@dataclass(frozen=True, eq=False)
class Wrench:
    """A measured wrench.

    Attributes:
        values: Wrenches `[F; τ]` in the sensor's frame, N and N m, NaN in the columns of missing channels (N, 6).
        body: Name of the link in contact; None for the ground wrench.
        pose: Pose of the sensor's frame as for `Sensor` (4, 4), or one for each sample (N, 4, 4).
        applied_to_link: Sign of the readings, as for `Sensor`.
        covariance: Covariance of the values (6, 6); None if unknown.
        time: Sample times, s (N,), to be checked against other wrenches' if both are given.
        frame: One of `FRAMES`, as for `Sensor`.
    """

    values: np.ndarray
    body: str | None = None
    pose: np.ndarray = field(default_factory=lambda: np.eye(4))
    applied_to_link: bool = True
    covariance: np.ndarray | None = None
    time: np.ndarray | None = None
    frame: str = "body"

    def __post_init__(self) -> None:
        who = "The ground wrench" if self.body is None else f"The contact on '{self.body}'"
        _check_frame(who, self.frame, self.body)
        values, pose = np.asarray(self.values, float), np.asarray(self.pose, float)
        if values.ndim != 2 or values.shape[1] != 6 or not (np.isfinite(values) | np.isnan(values).all(axis=0)).all():
            raise InputError(
                f"{who} needs wrenches (N, 6), each component finite or NaN throughout, got shape {values.shape}."
            )
        if pose.shape not in ((4, 4), (len(values), 4, 4)) or not is_rigid(pose):
            raise InputError(
                f"{who} needs the pose of its sensor's frame, (4, 4) or ({len(values)}, 4, 4), "
                f"got {'none' if self.pose is None else pose.shape}."
            )
        C = self.covariance
        if C is not None and (np.shape(C) != (6, 6) or not np.allclose(C, np.transpose(C))):
            raise InputError(f"{who} needs a symmetric covariance (6, 6), got shape {np.shape(C)}.")
        if self.time is not None and np.shape(self.time) != (len(values),):
            raise InputError(f"{who} needs {len(values)} sample times, got shape {np.shape(self.time)}.")
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "pose", pose)

    @property
    def on_mechanism(self) -> np.ndarray:
        """Wrench that the surroundings exert on the mechanism, in the sensor's frame (N, 6)."""
        return self.values if self.applied_to_link else -self.values


@dataclass(frozen=True, eq=False)
class TotalWrench:
    """The right-hand side of `Y φ = Γ` with all contacts.

    Attributes:
        values: Γ `[F; τ]` in `frame`, N and N m, NaN in the columns of components that are not measured (N, 6).
        frame: Pose of the ground sensor's frame in the base frame (4, 4), one for each sample if it moves.
        parts: Pose in that frame and covariance of every sensor.
    """

    values: np.ndarray
    frame: np.ndarray
    parts: Sequence[tuple[np.ndarray, np.ndarray | None]]

    @property
    def in_base(self) -> np.ndarray:
        """Γ in the base frame, which needs all components (N, 6)."""
        return transform_wrench(self.frame, self.values)

    @cached_property
    def covariance(self) -> np.ndarray | None:
        """Covariance of the values, for each sample because contacts move (N, 6, 6); None if a part is unknown."""
        total = np.zeros((len(self.values), 6, 6))
        for pose, covariance in self.parts:
            if covariance is None:
                return None
            total += transform_covariance(pose, covariance)
        return total


def transform_wrench(T_ab: np.ndarray, wrench: np.ndarray) -> np.ndarray:
    """Wrench given in frame b, expressed in frame a: `coAd(T_ab) @ wrench` (Eq. 15, 16).

    Args:
        T_ab: Poses of frame b in frame a (…, 4, 4).
        wrench: Wrenches `[F; τ]` in frame b (…, 6).

    Returns:
        Wrenches in frame a (…, 6).
    """
    wrench, A = np.asarray(wrench, float), coAd(T_ab)
    # One pose for all samples needs a single matrix product, which is much faster.
    return wrench @ A.T if A.ndim == 2 else applied(A, wrench)


def transform_covariance(T_ab: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Covariance of a wrench after `transform_wrench`: `coAd(T_ab) C coAd(T_ab)ᵀ` (…, 6, 6)."""
    A = coAd(T_ab)
    return A @ covariance @ np.swapaxes(A, -1, -2)


def pose_in_base(sensor: Sensor | Wrench, body: np.ndarray, base: np.ndarray | None) -> np.ndarray:
    """Pose of a contact's sensor in the base frame, from its body's pose or, for one in the world, from the base's.

    Args:
        sensor: The sensor, or its wrench.
        body: Pose of its body in the base frame (…, 4, 4).
        base: Pose of a moving base in the world (…, 4, 4); None for a base at rest, whose frame is then the world's.

    Returns:
        Poses (…, 4, 4), or one for all samples.
    """
    if sensor.frame == "body":
        return body @ sensor.pose
    return np.asarray(sensor.pose) if base is None else inverse(base) @ sensor.pose


@typed()
def total_wrench(
    tree: Tree, q: np.ndarray, ground: Wrench | None, contacts: Sequence[Wrench], *, base: np.ndarray | None = None
) -> TotalWrench:
    """Total wrench, which the mechanism's motion and weight need: `Γ = Γ_0 - Σ coAd(T_0E) Γ_E` (Eq. 17, 18).

    If nothing holds the base there is no Γ_0, and Γ is the sum of the contacts alone (Eq. 1-3).

    Args:
        tree: The mechanism.
        q: Joint coordinates in rad, m or quaternions (N, n_q).
        ground: Wrench between the ground and the base, perhaps without some of its components; None if nothing holds
            the base.
        contacts: Any number of contacts on any bodies, each with all components.
        base: Poses of a moving base in the world, for wrenches whose frames rest there (N, 4, 4).

    Returns:
        The total wrench in the frame of the ground's sensor, or in the base frame without a ground wrench; the sensors'
        covariances are transformed with it if all are known.

    Raises:
        InputError: A contact is on a body that does not exist or lacks components, or samples do not match in number or
            time, or are not finite.
    """
    if np.ndim(q) != 2:
        raise InputError(f"The total wrench needs joint coordinates (N, n_q), got shape {np.shape(q)}.")
    if not np.isfinite(q).all():
        raise InputError("The total wrench needs finite joint states.")
    _check(tree, len(q), ground, contacts)
    if base is not None and np.shape(base) != (len(q), 4, 4):
        raise InputError(f"{len(q)} joint states need poses of a moving base, got shape {np.shape(base)}.")
    # Most wrenches are on the base.
    poses = tree.poses(q) if contacts else np.zeros((len(q), 0, 4, 4))
    frame = np.eye(4) if ground is None else ground.pose
    values = np.zeros((len(q), 6)) if ground is None else ground.on_mechanism.copy()
    parts = [] if ground is None else [(np.eye(4), ground.covariance)]
    for contact in contacts:
        body = poses[:, tree.names.index(str(contact.body))]
        pose = inverse(frame) @ pose_in_base(contact, body, base)
        values += transform_wrench(pose, contact.on_mechanism)
        parts.append((pose, contact.covariance))
    return TotalWrench(values, frame, parts)


def _check_frame(who: str, frame: str, body: str | None) -> None:
    """Refuses an unknown frame, or `world` for the ground wrench, whose frame is that of the base."""
    if frame not in FRAMES or (body is None and frame != "body"):
        raise InputError(f"{who} needs a frame out of {', '.join(FRAMES)}, for the ground 'body', got {frame!r}.")


def _check(tree: Tree, samples: int, ground: Wrench | None, contacts: Sequence[Wrench]) -> None:
    """Refuses wrenches that do not fit the mechanism, its samples, or each other."""
    if ground is not None and len(ground.values) != samples:
        raise InputError(f"{samples} joint states need ground wrenches ({samples}, 6), got {ground.values.shape}.")
    time = None if ground is None else ground.time
    for contact in contacts:
        who, time = f"The contact on '{contact.body}'", contact.time if time is None else time
        if contact.body not in tree.names:
            raise InputError(
                f"A contact is on '{contact.body}', but the mechanism's bodies are {', '.join(tree.names)}."
            )
        if len(contact.values) != samples:
            raise InputError(f"{who} needs {samples} samples like the joint states, got {len(contact.values)}.")
        if not np.isfinite(contact.values).all():
            raise InputError(f"{who} needs all six components; only the ground's wrench may lack some.")
        if time is not None and contact.time is not None:
            shift = np.abs(np.asarray(contact.time) - time)
            if not shift.max() <= 1e-9:
                raise InputError(
                    f"{who} needs the other wrenches' sample times; they differ by up to {shift.max():.3g} s, most at "
                    f"sample {int(shift.argmax())}."
                )
