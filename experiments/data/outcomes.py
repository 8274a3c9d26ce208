"""Results of single studies: angles of a trial, a drawn mechanism, a design, and a sweep."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.files.markers import Markers
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.recordings.recording import Recording
from sim.markers.lengths import Scaling
from sim.markers.trial_fit import Postures
from sim.markers.trial_recording import Swap
from sim.motion.excitation_design import Limits


@dataclass(frozen=True, eq=False)
class Angles:
    """Fitted angles of a trial.

    Attributes:
        markers: The markers of the file.
        unmatched: Labels without a site.
        postures: Fitted postures.
        swaps: Markers whose labels seem exchanged.
        base: Body whose frame is {0}; None for the world.
        recording: Joint positions, their noise and the base's poses.
        scaling: Lengths of segments; None for the model's.
    """

    markers: Markers
    unmatched: tuple[str, ...]
    postures: Postures
    swaps: tuple[Swap, ...]
    base: str | None
    recording: Recording
    scaling: Scaling | None


@dataclass(frozen=True, eq=False)
class Drawing:
    """A mechanism and its geometry in one posture, in metres and world axes.

    Attributes:
        tree: The mechanism.
        q: Joint angles, rad (n,).
        base: Position of the base frame (3,).
        poses: Poses of the bodies (b, 4, 4).
        masses: Positions of their centres of mass (b, 3).
        end: End of the last link (3,).
    """

    tree: Tree
    q: np.ndarray
    base: np.ndarray
    poses: np.ndarray
    masses: np.ndarray
    end: np.ndarray


@dataclass(frozen=True, eq=False)
class Excited:
    """A motion, and what it determines of a mechanism.

    Attributes:
        motion: The motion.
        quality: All criteria, by name.
        std: Predicted standard deviations of the base parameters (r,).
    """

    motion: Motion
    quality: Mapping[str, float]
    std: np.ndarray

    @property
    def mean_deviation(self) -> float:
        """Geometric mean of the standard deviations."""
        return geometric_mean(self.std)


def geometric_mean(deviations: np.ndarray) -> float:
    """Geometric mean of standard deviations; ratios of it do not depend on units."""
    with np.errstate(divide="ignore"):
        return float(np.exp(np.log(deviations).mean()))


@dataclass(frozen=True, eq=False)
class Design:
    """A designed motion, and the one that it is compared with.

    Attributes:
        joints: Names of the joints that move.
        units: Units of the hinges and slides, `rad` or `m`.
        names: Names of the base parameters.
        drives: Names of the drives.
        bodies: Names of the bodies.
        known: Standard deviations of the prior (r + d,); None without one.
        limits: Limits of the joints.
        time: Times of the samples, s (N,).
        start: Name of the motion before, in words.
        before: That motion.
        after: The design.
        series: Its Fourier series, in JSON types.
        recording: The designed motion of all hinges and slides.
        collisions: Result of the collision checks, in words.
    """

    joints: tuple[str, ...]
    units: Mapping[str, str]
    names: tuple[str, ...]
    drives: tuple[str, ...]
    bodies: tuple[str, ...]
    known: np.ndarray | None
    limits: Limits
    time: np.ndarray
    start: str
    before: Excited
    after: Excited
    series: Mapping[str, Any]
    recording: Recording
    collisions: str


@dataclass(frozen=True, eq=False)
class Swept:
    """Results of a study for each value and seed of a sweep.

    Attributes:
        option: Name of the option.
        values: Its values.
        runs: Value, seed and summary of each run, or its error under `refused`; all values with the first seed, then
            with the next.
    """

    option: str
    values: Sequence[str | float]
    runs: Sequence[Mapping[str, Any]]

    @property
    def names(self) -> list[str]:
        """Names of the numbers in the summaries, without the paper's."""
        names = dict.fromkeys(name for run in self.runs for name, x in run.items() if isinstance(x, int | float))
        return [name for name in names if not name.startswith("paper_") and name not in (self.option, "seed")]

    def numbers(self, name: str) -> np.ndarray:
        """A number for each seed and value (seeds, values); NaN if a summary lacks it."""
        return np.array([run.get(name, np.nan) for run in self.runs], dtype=float).reshape(-1, len(self.values))
