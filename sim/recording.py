"""What was measured: channels by name, with units, noise levels, true values where they are known, and provenance."""

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from scipy.spatial.transform import Rotation

from sim.atomic import replacing

COMPONENTS = {3: "xyz", 4: "wxyz"}
"""Suffixes of the columns of a vector and of a quaternion in a CSV file: `ground_force.x`."""

TRUE = "true:"
"""Prefix of the CSV columns that hold true values."""


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
        steps = np.diff(self.time)
        if not (steps > 0).all():
            raise ValueError(f"Recorded times must increase; sample {int(np.argmin(steps > 0)) + 1} does not.")
        for name in ("measured", "true"):
            channels = {key: _checked(key, x, len(self.time)) for key, x in getattr(self, name).items()}
            object.__setattr__(self, name, channels)
        for name in ("units", "noise", "provenance"):
            object.__setattr__(self, name, dict(getattr(self, name)))
        for name in self.measured:
            if not re.fullmatch(r"(?!true:|time$|#)[^\s,.]([^,.\r\n]*[^\s,.])?", name):
                raise ValueError(f"A channel's name cannot be {name!r}: it is a word without commas and dots.")
        for name, level in self.noise.items():
            if isinstance(level, str) or not 0 <= level < np.inf:
                raise ValueError(f"The noise of channel '{name}' needs a standard deviation, got {level!r}.")
        if self.true and {k: x.shape for k, x in self.true.items()} != {k: x.shape for k, x in self.measured.items()}:
            raise ValueError("True values need the same channels and shapes as the measured ones.")

    @property
    def noise_free(self) -> "Recording":
        """The true values as if they had been measured."""
        if not self.true:
            raise ValueError("This recording holds no true values.")
        return replace(self, measured=self.true)

    def __getitem__(self, channel: str) -> np.ndarray:
        """A measured channel (N,) or (N, d)."""
        if channel not in self.measured:
            raise ValueError(f"The recording has no channel '{channel}'; it has {', '.join(sorted(self.measured))}.")
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
        """Writes a `.npz` or `.csv` file that `load` reads back bit by bit."""
        path = Path(path)
        writers = {".npz": self._write_npz, ".csv": self._write_csv}
        if path.suffix not in writers:
            raise ValueError(f"A recording is saved as .npz or .csv, got '{path.name}'.")
        with replacing(path) as temporary:
            writers[path.suffix](temporary)

    @classmethod
    def load(cls, path: str | Path) -> "Recording":
        """Reads what `save` wrote.

        Raises:
            ValueError: The file is missing or not a recording; the message names file, row and column.
        """
        path = Path(path)
        readers = {".npz": cls._read_npz, ".csv": cls._read_csv}
        if path.suffix not in readers or not path.is_file():
            raise ValueError(f"A recording is a .npz or .csv file that exists, got '{path}'.")
        try:
            return readers[path.suffix](path)
        except (ValueError, KeyError, OSError, EOFError, TypeError, NotImplementedError, BadZipFile) as error:
            raise ValueError(f"{path}: {error}") from error

    def _metadata(self) -> dict[str, Any]:
        return {"units": dict(self.units), "noise": dict(self.noise), "provenance": dict(self.provenance)}

    def _write_npz(self, path: Path) -> None:
        arrays: dict[str, Any] = {"time": self.time, "metadata": json.dumps(self._metadata())}
        for kind in ("measured", "true"):
            arrays |= {f"{kind}/{name}": x for name, x in getattr(self, kind).items()}
        np.savez(path, **arrays)

    @classmethod
    def _read_npz(cls, path: Path) -> "Recording":
        with path.open("rb") as stream, np.load(stream, allow_pickle=False) as data:
            measured, true = (
                {key.removeprefix(kind): data[key] for key in data.files if key.startswith(kind)}
                for kind in ("measured/", "true/")
            )
            return cls(data["time"], measured, true, **json.loads(str(data["metadata"])))

    def _write_csv(self, path: Path) -> None:
        columns = {"time": self.time}
        for prefix, channels in (("", self.measured), (TRUE, self.true)):
            for name, x in channels.items():
                suffixes = [""] if x.ndim == 1 else [f".{c}" for c in COMPONENTS.get(x.shape[1], range(x.shape[1]))]
                columns |= {f"{prefix}{name}{s}": c for s, c in zip(suffixes, x.reshape(len(x), -1).T, strict=True)}
        comments = [f"# {key}: {json.dumps(value)}" for key, value in self._metadata().items()]
        rows = (",".join(map(repr, row)) for row in np.stack(list(columns.values()), axis=1).tolist())
        path.write_text("\n".join([*comments, ",".join(columns), *rows, ""]), encoding="utf-8")

    @classmethod
    def _read_csv(cls, path: Path) -> "Recording":
        metadata: dict[str, Any] = {}
        lines = list(enumerate(path.read_text(encoding="utf-8-sig").rstrip("\n").split("\n"), start=1))
        while lines and lines[0][1].startswith("#"):
            number, line = lines.pop(0)
            key, _, value = line[1:].partition(":")
            try:
                metadata[key.strip()] = json.loads(value)
            except json.JSONDecodeError as error:
                raise ValueError(f"row {number} needs '# units', noise or provenance in JSON ({error}).") from None
        if not lines or not lines[0][1].strip():
            raise ValueError("no header row.")
        header = [cell.strip() for cell in lines.pop(0)[1].split(",")]
        _check_header(header)
        table = np.array([_numbers(line, number, header) for number, line in lines]).reshape(-1, len(header))
        columns = dict(zip(header, table.T, strict=True))
        channels = {name: _channel(name, columns) for name in dict.fromkeys(h.partition(".")[0] for h in header)}
        return cls(
            time=channels.pop("time"),
            measured={k: x for k, x in channels.items() if not k.startswith(TRUE)},
            true={k.removeprefix(TRUE): x for k, x in channels.items() if k.startswith(TRUE)},
            **metadata,
        )


def _check_header(header: Sequence[str]) -> None:
    twice = sorted({name for name in header if header.count(name) > 1})
    if twice:
        raise ValueError(f"the header names {', '.join(twice)} more than once.")
    if "time" not in header:
        raise ValueError(f"a recording needs a column 'time'; it has {', '.join(header)}.")


def _channel(name: str, columns: Mapping[str, np.ndarray]) -> np.ndarray:
    """A channel from its column, or from its columns `name.x`, `name.y`, … in whatever order they stand."""
    suffixes = [column.partition(".")[2] for column in columns if column.partition(".")[0] == name]
    if suffixes == [""]:
        return columns[name]
    expected = COMPONENTS.get(len(suffixes), [str(k) for k in range(len(suffixes))])
    if sorted(suffixes) != sorted(expected):
        raise ValueError(f"channel '{name}' needs the components {', '.join(expected)}, it has {', '.join(suffixes)}.")
    return np.stack([columns[f"{name}.{suffix}"] for suffix in expected], axis=1)


def _numbers(line: str, number: int, header: Sequence[str]) -> list[float]:
    cells = line.split(",")
    if len(cells) != len(header):
        raise ValueError(f"row {number} has {len(cells)} cells where the header has {len(header)}.")
    return [_number(cell, number, name) for cell, name in zip(cells, header, strict=True)]


def _number(cell: str, row: int, column: str) -> float:
    try:
        return float(cell)
    except ValueError:
        raise ValueError(f"row {row}, column '{column}' needs a number, got '{cell}'.") from None


def _checked(name: str, values: Iterable[float], samples: int | None) -> np.ndarray:
    x = np.array(values, float)
    dimensions = (1,) if samples is None else (1, 2)
    if x.ndim not in dimensions or samples not in (None, len(x)) or x.size == 0:
        raise ValueError(
            f"Channel '{name}' needs {samples or 'N > 0'} samples along its first axis, got shape {x.shape}."
        )
    bad = np.argwhere(~np.isfinite(x))
    if len(bad):
        raise ValueError(f"Channel '{name}' needs finite numbers; sample {bad[0, 0]} is {x[tuple(bad[0])]}.")
    x.flags.writeable = False
    return x
