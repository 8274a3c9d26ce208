"""Where samples come from: one piece, or many that need not fit into memory together."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Protocol, runtime_checkable

import numpy as np

from ident.errors import InputError
from ident.estimation.equations import Equations
from ident.estimation.samples import Samples, arrays_of
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree


@runtime_checkable
class Recorded(Protocol):
    """A recording that finds its channels by the names of joints and of a wrench."""

    def joint_states(self, joints: Sequence[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Positions, velocities and accelerations of the named joints, each (N, n)."""

    def wrench(self, name: str) -> np.ndarray:
        """The wrench `[F; τ]` of that name (N, 6)."""

    @property
    def wrenches(self) -> tuple[str, ...]:
        """Names of all wrenches."""


Source = Samples | Recorded | Iterable[Samples | Recorded]
"""One piece, or an iterable of pieces that need not fit into memory together."""


def pieces(source: Source, equations: Equations) -> Iterator[Samples]:
    """The pieces of a source, of which all have the same columns and types.

    Args:
        source: Samples or a recording, or an iterable of them. Of a recording the wrench `ground` is the total one.
        equations: What is fitted.

    Raises:
        InputError: A piece does not fit the mechanism or the first one, or there is none.
    """
    first: Samples | None = None
    alone = isinstance(source, Samples | Recorded)
    for k, piece in enumerate([source] if alone else source):  # type: ignore[arg-type]
        where = "The samples" if alone else f"Piece {k}"
        if not isinstance(piece, Samples | Recorded):
            raise InputError(f"{where} must be Samples or a recording, got {type(piece).__name__}.")
        samples = piece if isinstance(piece, Samples) else _of_recording(piece, equations.mechanism.tree)
        fitting = equations.checked(samples, where)
        if first is not None:
            _compare(samples, first, where)
        first = first or samples
        yield fitting
    if first is None:
        raise InputError("Identification needs at least one piece of samples, got none.")


def _of_recording(recording: Recorded, tree: Tree) -> Samples:
    others = [name for name in recording.wrenches if name != "ground"]
    if others:
        raise InputError(
            f"The recording holds the wrench '{others[0]}' besides that of the ground; make Samples of the total "
            "wrench, as ident.recordings.wrench.total_wrench gives it."
        )
    return Samples(Motion(*recording.joint_states(tree.joints)), recording.wrench("ground"))


def _compare(samples: Samples, first: Samples, where: str) -> None:
    before = arrays_of(first)
    for name, x in arrays_of(samples).items():
        if x.dtype != before[name].dtype:
            raise InputError(
                f"{where}: '{name}' is {x.dtype} where the first piece has {before[name].dtype}; all need one type."
            )
    if (samples.motion.base is None) != (first.motion.base is None):
        raise InputError(f"{where}: either all pieces have 'base' or none has.")
    if (samples.covariance is None) != (first.covariance is None):
        raise InputError(f"{where}: either all pieces have 'covariance' or none has.")
