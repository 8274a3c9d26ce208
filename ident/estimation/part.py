"""Parts of recordings: a recording, and the samples of it that are fitted or judged by."""

from collections.abc import Sequence
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from ident.estimation.preparation import Prepared
from ident.estimation.samples import Samples

Chosen = TypeVar("Chosen", bound=slice | np.ndarray, covariant=True)
"""A span of samples, or their indices."""


class Part(NamedTuple, Generic[Chosen]):
    """Part of a recording.

    Attributes:
        log: The recording.
        samples: The samples of it, of which those left out, clipped or in a gap are not used.
    """

    log: Prepared
    samples: Chosen

    @property
    def indices(self) -> np.ndarray:
        """Indices of the used samples."""
        return self.log.taken(self.samples)

    @property
    def used(self) -> Samples:
        """The used samples."""
        return self.log.samples[self.indices]

    @property
    def times(self) -> np.ndarray:
        """Times of the used samples, s."""
        return self.log.recording.time[self.indices]

    def of(self, log: Prepared) -> "Part[Chosen]":
        """The same samples of another version of the recording."""
        return Part(log, self.samples)


def length(parts: Sequence[Part[slice]]) -> int:
    """Number of samples of parts that are spans."""
    return sum(part.samples.stop - part.samples.start for part in parts)
