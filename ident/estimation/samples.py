"""Samples for identification: a motion and measured channels, in one piece or many."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.arguments import described
from ident.errors import InputError
from ident.mechanism import motion
from ident.mechanism.motion import Motion, Which
from ident.mechanism.tree import Tree


@dataclass(frozen=True, eq=False)
class Samples:
    """Motion and measured channels at N instants.

    Attributes:
        motion: Joint states, and the motion of a base that does not rest.
        measured: Measured channels (N, C); for default `Equations` the total wrench Γ `[F; τ]` in the base frame, N
            and N m.
        covariance: Covariance of the channels for weighting: one for all samples (C, C) or one for each (N, C, C).
    """

    motion: Motion
    measured: np.ndarray
    covariance: np.ndarray | None = None

    def __len__(self) -> int:
        return len(self.measured)

    def __getitem__(self, which: Which) -> "Samples":
        """Selection of the samples."""
        each = self.covariance is not None and self.covariance.ndim == 3
        covariance = self.covariance[which] if each else self.covariance  # type: ignore[index]
        return Samples(self.motion[which], self.measured[which], covariance)

    def checked(self, tree: Tree, channels: int, where: str = "The samples") -> "Samples":
        """The samples, checked to fit a mechanism and a number of channels.

        Raises:
            InputError: They do not fit or are not finite; the message names the array and the place in it.
        """
        if not isinstance(self.motion, Motion):
            raise InputError(f"{where} must have a Motion, got {described(self.motion)}.")
        widths = {"q": sum(body.coordinates for body in tree.bodies), "measured": channels}
        widths |= dict.fromkeys(("dq", "ddq"), len(tree.freedoms))
        for name, x in arrays_of(self).items():
            if not isinstance(x, np.ndarray) or x.dtype.kind not in "fiu":
                kind = getattr(x, "dtype", type(x))
                raise InputError(f"{where}: '{name}' must be an array of real numbers, got {kind}.")
            if x.ndim != 2 or x.shape[1] != widths[name] or len(x) != len(self) or not len(x):
                raise InputError(
                    f"{where}: '{name}' needs a row for each of {len(self)} samples and {widths[name]} columns, got "
                    f"{x.shape}."
                )
            # Adding up needs no memory; only arrays whose sum is not finite are searched.
            with np.errstate(invalid="ignore", over="ignore"):
                suspect = not np.isfinite(x.sum(dtype=float))
            if suspect and not (finite := np.isfinite(x).all(axis=1)).all():
                raise InputError(
                    f"{where}: '{name}' needs finite numbers; sample {finite.argmin()} has NaN or infinity."
                )
        shapes = ((channels, channels), (len(self), channels, channels))
        if self.covariance is not None and np.shape(self.covariance) not in shapes:
            raise InputError(
                f"{where}: 'covariance' needs the shape {shapes[0]} or {shapes[1]}, got {np.shape(self.covariance)}."
            )
        return replace(self, motion=self.motion.checked_further(tree))


def whitened(rows: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Rows times W, where `W C Wᵀ = 1` for the covariance C of the channels.

    Args:
        rows: Columns first, samples last (k, C, N).
        covariance: C of all samples (C, C), or of each (N, C, C).

    Raises:
        InputError: It is not symmetric and positive definite.
    """
    if not np.allclose(covariance, np.swapaxes(covariance, -1, -2)):
        raise InputError("A covariance of the channels needs to be symmetric.")
    try:
        W = np.linalg.inv(np.linalg.cholesky(covariance))
    except np.linalg.LinAlgError:
        raise InputError("A covariance of the channels needs to be positive definite.") from None
    return np.moveaxis(W @ np.moveaxis(rows, 2, 0).swapaxes(1, 2), (0, 1, 2), (2, 1, 0))


def even(stream: Iterable[Samples], size: int) -> Iterator[Samples]:
    """Yields the samples of a stream in pieces of one size; only the last may be shorter."""
    held: list[Samples] = []
    room = size
    for piece in stream:
        while len(piece):
            held.append(piece[:room])
            piece = piece[room:]
            room -= len(held[-1])
            if not room:
                yield joined(held)
                held, room = [], size
    if held:
        yield joined(held)


def joined(parts: Sequence[Samples]) -> Samples:
    """Consecutive pieces joined into one."""
    if len(parts) == 1:
        return parts[0]
    measured = np.concatenate([part.measured for part in parts])
    covariance, channels = parts[0].covariance, measured.shape[1]
    if covariance is not None:
        each = [np.broadcast_to(part.covariance, (len(part), channels, channels)) for part in parts]  # type: ignore[arg-type]
        covariance = np.concatenate(each)
    return Samples(motion.joined([part.motion for part in parts]), measured, covariance)


def arrays_of(samples: Samples) -> dict[str, np.ndarray]:
    """Arrays by their names in messages."""
    return {"q": samples.motion.q, "dq": samples.motion.dq, "ddq": samples.motion.ddq, "measured": samples.measured}
