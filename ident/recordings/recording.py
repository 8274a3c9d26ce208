"""What was measured: channels by name, with units, noise levels, true values where they are known, and provenance."""

import re
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from numbers import Real
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from ident.errors import InputError, LogError
from ident.recordings.atomic import replacing
from ident.recordings.csv_file import TRUE, csv_pieces, write_csv
from ident.recordings.npz import LIMIT
from ident.recordings.npz_file import npz_pieces, write_npz

METADATA = ("units", "noise", "provenance")
"""What a file says about its channels."""


@dataclass(frozen=True, eq=False)
class Recording:
    """Channels sampled at the same instants.

    Joints are found by the names `JOINT_position`, `JOINT_velocity` and `JOINT_acceleration`, wrenches by `NAME_force`
    and `NAME_torque`, poses of bodies in the base frame by `BODY_position` and `BODY_orientation` (a quaternion).

    Attributes:
        time: Sample times, s (N,).
        measured: Measured channels (N,) or (N, d).
        true: The same channels without noise, empty where nobody knows them.
        units: Unit of each channel.
        noise: Standard deviation of each channel's noise in its unit, as far as known; for an orientation, of each
            component of a rotation vector in rad.
        provenance: Where the recording comes from, in JSON's types.
    """

    time: np.ndarray
    measured: Mapping[str, np.ndarray]
    true: Mapping[str, np.ndarray] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        object.__setattr__(self, "time", _checked("time", self.time, None))
        _check_increasing(self.time)
        for name in ("measured", "true"):
            channels = {key: _checked(key, x, len(self.time)) for key, x in getattr(self, name).items()}
            object.__setattr__(self, name, channels)
        for name in ("units", "noise", "provenance"):
            object.__setattr__(self, name, dict(getattr(self, name)))
        for name in self.measured:
            if not re.fullmatch(r"(?!true:|time$|#)[^\s,.]([^,.\r\n]*[^\s,.])?", name):
                raise LogError(f"A channel's name cannot be {name!r}: it is a word without commas and dots.")
        for name, level in self.noise.items():
            if not (isinstance(level, Real) and 0 <= level < np.inf):
                raise LogError(f"The noise of channel '{name}' needs a standard deviation, got {level!r}.")
        if self.true and {k: x.shape for k, x in self.true.items()} != {k: x.shape for k, x in self.measured.items()}:
            raise LogError("True values need the same channels and shapes as the measured ones.")

    @property
    def noise_free(self) -> "Recording":
        """The true values as if they had been measured."""
        if not self.true:
            raise LogError("This recording holds no true values.")
        return replace(self, measured=self.true)

    def __getitem__(self, channel: str) -> np.ndarray:
        """A measured channel (N,) or (N, d)."""
        if channel not in self.measured:
            raise LogError(f"The recording has no channel '{channel}'; it has {', '.join(sorted(self.measured))}.")
        return self.measured[channel]

    def joint_states(self, joints: Sequence[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q in rad, q̇ in rad/s and q̈ in rad/s² of the named joints, each (N, n)."""
        q, dq, ddq = (
            np.stack([self[f"{joint}_{kind}"] for joint in joints], axis=-1)
            for kind in ("position", "velocity", "acceleration")
        )
        return q, dq, ddq

    def joint_noise(self, joints: Sequence[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Standard deviations of the channels of `joint_states`, zero where unknown, each (n,)."""
        q, dq, ddq = (
            np.array([self.noise.get(f"{joint}_{kind}", 0.0) for joint in joints])
            for kind in ("position", "velocity", "acceleration")
        )
        return q, dq, ddq

    def wrench(self, name: str) -> np.ndarray:
        """The wrench `[F; τ]` of a force and a torque channel, N and N m (N, 6)."""
        return np.hstack([self[f"{name}_force"], self[f"{name}_torque"]])

    @property
    def wrenches(self) -> tuple[str, ...]:
        """Names of the wrenches that have both a force and a torque channel."""
        forces = [name.removesuffix("_force") for name in self.measured if name.endswith("_force")]
        return tuple(name for name in forces if f"{name}_torque" in self.measured)

    def wrench_covariance(self, name: str) -> np.ndarray:
        """Covariance of the noise on `wrench`, from the declared levels, N² and (N m)² (6, 6)."""
        force, torque = (self.noise.get(f"{name}_{kind}", 0.0) for kind in ("force", "torque"))
        return np.diag(np.repeat([force, torque], 3) ** 2)

    def poses(self, body: str) -> np.ndarray:
        """Pose of a body in the base frame (N, 4, 4)."""
        T = np.tile(np.eye(4), (len(self.time), 1, 1))
        T[:, :3, :3] = Rotation.from_quat(self[f"{body}_orientation"], scalar_first=True).as_matrix()
        T[:, :3, 3] = self[f"{body}_position"]
        return T

    def save(self, path: str | Path) -> None:
        """Writes a `.npz` or `.csv` file that `load` reads back bit by bit.

        Raises:
            InputError: The file's name ends otherwise.
        """
        path = Path(path)
        writers = {".npz": write_npz, ".csv": write_csv}
        if path.suffix not in writers:
            raise InputError(f"A recording is saved as .npz or .csv, got '{path.name}'.")
        channels = {"time": self.time, **self.measured} | {f"{TRUE}{name}": x for name, x in self.true.items()}
        metadata = {name: getattr(self, name) for name in METADATA}
        with replacing(path) as temporary:
            writers[path.suffix](temporary, channels, metadata)

    @classmethod
    def load(cls, path: str | Path, *, limit: int = LIMIT) -> "Recording":
        """Reads what `save` wrote, an archive that takes at most so many bytes in memory (`npz.check_size`).

        Raises:
            LogError: The file is missing or not a recording; the message names file, row and column.
        """
        (recording,) = cls.chunks(path, sys.maxsize, limit=limit)
        return recording

    @classmethod
    def chunks(cls, path: str | Path, samples: int = 10_000, *, limit: int = LIMIT) -> Iterator["Recording"]:
        """Reads what `save` wrote piece by piece, for files that are larger than memory.

        Args:
            path: A `.npz` or `.csv` file.
            samples: Samples of each piece, of the last one perhaps fewer.
            limit: Bytes that a piece of an archive may take in memory, as for `npz.check_size`.

        Raises:
            LogError: The file is missing or not a recording, as for `load`; a fault is found when its piece is due.
            InputError: A piece has no samples.
        """
        path = Path(path)
        if path.suffix not in (".npz", ".csv") or not path.is_file():
            raise LogError(f"A recording is a .npz or .csv file that exists, got '{path}'.")
        if samples < 1:
            raise InputError(f"A piece of a recording needs at least one sample, got {samples}.")
        first, last = 0, np.empty(0)
        try:
            pieces = npz_pieces(path, samples, limit) if path.suffix == ".npz" else csv_pieces(path, samples)
            for channels, metadata in pieces:
                for name, x in channels.items():
                    _check_finite(name, x, first)
                time = channels.pop("time")
                _check_increasing(np.append(last, time), first - len(last))
                yield cls._of(time, channels, metadata)
                first, last = first + len(time), time[-1:]
            if first == 0:
                raise LogError("a recording needs samples, it has none.")
        except (LogError, OSError) as error:
            raise LogError(f"{path}: {error}") from error

    @classmethod
    def _of(cls, time: np.ndarray, channels: Mapping[str, np.ndarray], metadata: Mapping[str, Any]) -> "Recording":
        """A recording from what a file holds."""
        for name, content in metadata.items():
            if name not in METADATA or not isinstance(content, Mapping):
                raise LogError(f"besides channels a file has {', '.join(METADATA)}, each a JSON object; not '{name}'.")
        true = {name.removeprefix(TRUE): x for name, x in channels.items() if name.startswith(TRUE)}
        return cls(time, {name: x for name, x in channels.items() if not name.startswith(TRUE)}, true, **metadata)


def _checked(name: str, values: Iterable[float], samples: int | None) -> np.ndarray:
    x = np.array(values, float)
    dimensions = (1,) if samples is None else (1, 2)
    if x.ndim not in dimensions or samples not in (None, len(x)) or x.size == 0:
        raise LogError(
            f"Channel '{name}' needs {samples or 'N > 0'} samples along its first axis, got shape {x.shape}."
        )
    _check_finite(name, x)
    x.flags.writeable = False
    return x


def _check_finite(name: str, x: np.ndarray, first: int = 0) -> None:
    """Refuses NaN and infinity in a channel whose first row is that sample."""
    finite = np.isfinite(x)
    if not finite.all():
        bad = tuple(np.argwhere(~finite)[0])
        raise LogError(f"Channel '{name}' needs finite numbers; sample {first + bad[0]} is {x[bad]}.")


def _check_increasing(time: np.ndarray, first: int = 0) -> None:
    """Refuses times, from that sample on, that do not increase."""
    steps = np.diff(time)
    if not (steps > 0).all():
        raise LogError(f"Recorded times must increase; sample {first + int(np.argmin(steps > 0)) + 1} does not.")
