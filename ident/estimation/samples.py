"""What is identified from: joint states and the total wrench, in one piece or in many."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Protocol, runtime_checkable

import numpy as np

from ident.errors import InputError
from ident.mechanism.motion import BaseMotion
from ident.mechanism.tree import Tree
from ident.recordings.wrench import TotalWrench


@runtime_checkable
class Recorded(Protocol):
    """A recording that finds its channels by the names of joints, and knows where its wrenches are measured."""

    @property
    def base(self) -> np.ndarray | None:
        """Poses of a moving base, None at rest."""

    def joint_states(self, joints: Sequence[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions, velocities and accelerations of the named joints, each (N, n)."""

    def total_wrench(self, tree: Tree) -> TotalWrench:
        """The total wrench of everything that touches the mechanism."""


@dataclass(frozen=True, eq=False)
class Samples:
    """Joint states and total wrench at N instants.

    Attributes:
        q: Joint coordinates in rad, m or quaternions (N, n_q).
        dq: Joint velocities, rad/s or m/s (N, n); `ddq` their rates (N, n).
        ddq: Joint accelerations, rad/s² or m/s² (N, n).
        wrench: Total wrench Γ `[F; τ]` in the base frame, N and N m (N, 6).
        base: Motion of the base frame, None at rest.
        covariance: Covariance of the wrench, to weight by: one for all samples (6, 6) or one for each (N, 6, 6).
    """

    q: np.ndarray
    dq: np.ndarray
    ddq: np.ndarray
    wrench: np.ndarray
    base: BaseMotion | None = None
    covariance: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.wrench)

    def part(self, which: slice) -> "Samples":
        """Some of the samples."""
        states = {key: getattr(self, key)[which] for key in ("q", "dq", "ddq", "wrench")}
        base = self.base and BaseMotion(self.base.T[which], self.base.V[which], self.base.dV[which])
        each = self.covariance is not None and self.covariance.ndim == 3
        return replace(self, **states, base=base, covariance=self.covariance[which] if each else self.covariance)  # type: ignore[index]


def whitened(rows: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Rows times W, where `W C Wᵀ = 1` for the covariance C of the wrench.

    Args:
        rows: Columns first, samples last (k, 6, N).
        covariance: C of all samples (6, 6), or of each (N, 6, 6).

    Raises:
        InputError: It is not symmetric and positive definite.
    """
    if not np.allclose(covariance, np.swapaxes(covariance, -1, -2)):
        raise InputError("The wrench's covariance needs to be symmetric.")
    try:
        W = np.linalg.inv(np.linalg.cholesky(covariance))
    except np.linalg.LinAlgError:
        raise InputError("The wrench's covariance needs to be positive definite.") from None
    return np.moveaxis(W @ np.moveaxis(rows, 2, 0).swapaxes(1, 2), (0, 1, 2), (2, 1, 0))


Source = Samples | Recorded | Iterable[Samples | Recorded]
"""One piece, or an iterable of pieces that need not fit into memory together."""


def pieces(source: Source, tree: Tree) -> Iterator[Samples]:
    """The pieces of a source, of which all have the same columns and types.

    Args:
        source: Samples or a recording, or an iterable of them.
        tree: The mechanism.

    Raises:
        InputError: A piece does not fit the mechanism or the first one, or there is none.
    """
    first: Samples | None = None
    alone = isinstance(source, Samples | Recorded)
    for k, piece in enumerate([source] if alone else source):  # type: ignore[arg-type]
        where = "The samples" if alone else f"Piece {k}"
        if not isinstance(piece, Samples | Recorded):
            raise InputError(f"{where} must be Samples or a recording, got {type(piece).__name__}.")
        samples = piece if isinstance(piece, Samples) else _of_recording(piece, tree)
        check_samples(samples, tree, where)
        first = first or samples
        _compare(samples, first, where)
        yield samples
    if first is None:
        raise InputError("Identification needs at least one piece of samples, got none.")


def even(stream: Iterable[Samples], size: int) -> Iterator[Samples]:
    """The same samples, one after the other, in pieces of one size; only the last may be shorter."""
    held: list[Samples] = []
    room = size
    for piece in stream:
        while len(piece):
            held.append(piece.part(slice(room)))
            piece = piece.part(slice(room, None))
            room -= len(held[-1])
            if not room:
                yield joined(held)
                held, room = [], size
    if held:
        yield joined(held)


def joined(parts: Sequence[Samples]) -> Samples:
    """Pieces that follow one another, as one."""
    if len(parts) == 1:
        return parts[0]
    fields = {key: np.concatenate([getattr(part, key) for part in parts]) for key in ("q", "dq", "ddq", "wrench")}
    base, covariance = parts[0].base, parts[0].covariance
    if base is not None:
        base = BaseMotion(*(np.concatenate([getattr(part.base, key) for part in parts]) for key in ("T", "V", "dV")))
    if covariance is not None:
        covariance = np.concatenate([np.broadcast_to(part.covariance, (len(part), 6, 6)) for part in parts])  # type: ignore[arg-type]
    return Samples(**fields, base=base, covariance=covariance)


def _of_recording(recording: Recorded, tree: Tree) -> Samples:
    if recording.base is not None:
        raise InputError("A recording of a moving base needs the base's motion: make Samples with it.")
    return Samples(*recording.joint_states(tree.joints), recording.total_wrench(tree).in_base)


def check_samples(samples: Samples, tree: Tree, where: str = "The samples") -> None:
    """Raises a ValueError unless samples fit a mechanism and are finite."""
    widths = {"q": sum(body.coordinates for body in tree.bodies), "wrench": 6}
    widths |= dict.fromkeys(("dq", "ddq"), len(tree.freedoms))
    for name, width in widths.items():
        x = getattr(samples, name)
        if not isinstance(x, np.ndarray) or x.dtype.kind not in "fiu":
            raise InputError(f"{where}: '{name}' must be an array of real numbers, got {getattr(x, 'dtype', type(x))}.")
        if x.ndim != 2 or x.shape[1] != width or len(x) != len(samples) or not len(x):
            raise InputError(
                f"{where}: '{name}' needs a row for each of {len(samples)} samples and {width} columns, got {x.shape}."
            )
        # A sum takes no memory; one that overflows is looked at closely.
        with np.errstate(invalid="ignore", over="ignore"):
            suspect = not np.isfinite(x.sum())
        if suspect and not (finite := np.isfinite(x).all(axis=1)).all():
            raise InputError(
                f"{where}: '{name}' needs finite numbers; sample {int(np.argmin(finite))} has NaN or infinity."
            )
    C = samples.covariance
    if C is not None and np.shape(C) not in ((6, 6), (len(samples), 6, 6)):
        raise InputError(f"{where}: 'covariance' needs the shape (6, 6) or ({len(samples)}, 6, 6), got {np.shape(C)}.")


def _compare(samples: Samples, first: Samples, where: str) -> None:
    for name in ("q", "dq", "ddq", "wrench"):
        kind, before = getattr(samples, name).dtype, getattr(first, name).dtype
        if kind != before:
            raise InputError(f"{where}: '{name}' is {kind} where the first piece has {before}; all need one type.")
    for name in ("base", "covariance"):
        if (getattr(samples, name) is None) != (getattr(first, name) is None):
            raise InputError(f"{where}: either all pieces have '{name}' or none has.")
