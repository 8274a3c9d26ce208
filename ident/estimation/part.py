"""Parts of recordings that are fitted or judged by, and the channels that are constant in them.

The noise of a constant channel is unknown: it is left out.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Generic, NamedTuple, TypeVar

import numpy as np

from ident.estimation import repairs
from ident.estimation.equations import COMPONENTS
from ident.estimation.loads import predicted_channels
from ident.estimation.preparation import Prepared, equations_of
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


def flat_channels(parts: Sequence[Part[slice]]) -> dict[str, float]:
    """Channels that are constant in the parts of recordings to fit, with their values."""
    every = [repairs.constants(part.log.recording, part.log.mechanism.tree, part.samples) for part in parts]
    return {name: x for name, x in every[0].items() if all(each.get(name) == x for each in every)}


def without_channels(log: Prepared, flat: Mapping[str, float]) -> Prepared:
    """Recording without channels that are constant in the fitted samples; a note or a finding reports them.

    Args:
        log: The recording.
        flat: Channels to leave out and their values.
    """
    mechanism, motion, old, notes = log.mechanism, log.samples.motion, log.equations, list(log.notes)
    kept = [k for k, name in enumerate(old.channels) if name not in flat]
    samples = replace(log.samples, measured=log.samples.measured[:, kept])
    channels = tuple(old.channels[k] for k in kept)
    equations, sensors = equations_of(mechanism, log.recording, log.frame, samples, channels, log.drives)
    predicted = predicted_channels(mechanism, motion, log.frame, torques=bool(old.torques))
    stuck = repairs.stuck(flat, predicted, notes, in_fitted=True)
    return replace(
        log,
        recording=repairs.without_channels(log.recording, mechanism.tree, flat),
        equations=equations,
        samples=samples,
        sensors=sensors,
        wrench=np.where(np.isin(COMPONENTS, list(flat)), np.nan, log.wrench),
        notes=tuple(notes),
        stuck=(*log.stuck, *stuck),
    )
