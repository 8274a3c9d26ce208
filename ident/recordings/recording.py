"""Recordings: channels by name, with units, noise levels, true values if known, and provenance."""

import sys
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from numbers import Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from scipy.spatial.transform import Rotation

from ident.annotations import typed
from ident.arguments import check_type, checked_path, checked_rpy
from ident.display.brief import Brief, channels_frame, listed
from ident.errors import LogError
from ident.files.limits import LIMIT
from ident.files.table import BASE
from ident.geometry.se3 import pose
from ident.mechanism.body import Follower, is_rigid
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.model.axes import Couplings
from ident.recordings import times
from ident.recordings.smoothing import longest_step, low_pass
from ident.recordings.stated import Servo, Tracker, load, save
from ident.recordings.times import STREAMS, Sampled, interpolated, interpolated_poses, uniform_times
from ident.recordings.wrench import GROUND, Sensor, TotalWrench, Wrench, total_wrench

if TYPE_CHECKING:
    import pandas as pd
    from matplotlib.figure import Figure

STATES = ("position", "velocity", "acceleration")
"""Names of q, q̇ and q̈ in a joint's channels."""


@typed("noise", "streams")
@dataclass(frozen=True, eq=False, repr=False)
class Recording(Brief):
    """Channels at common sample times, simulated or measured, and streams at times of their own.

    Joint channels are named `JOINT_position`, `JOINT_velocity`, `JOINT_acceleration` and `JOINT_torque`, or
    `JOINT_command` for the commanded position of a joint with a servo; for a ball the
    position is a quaternion `w, x, y, z` (N, 4), the others have three components in the body's frame (N, 3). Wrenches
    are `NAME_force` and `NAME_torque`, poses of bodies in the base frame `BODY_position` and `BODY_orientation` (a
    quaternion). Values are finite, or NaN throughout a column that was not measured.

    Attributes:
        time: Sample times, s (N,).
        measured: Measured channels (N,) or (N, d).
        true: The same channels without noise, empty if they are unknown.
        units: Unit of each channel.
        noise: Standard deviation of each channel's noise in its unit, as far as known; for an orientation, of each
            component of a rotation vector in rad.
        provenance: Origin of the recording, in JSON's types.
        sensors: Sensors of the wrenches, by name. By default the ground's is in the base frame and measures the wrench
            that the ground exerts on the mechanism.
        base: Poses of a moving base frame in an inertial frame (N, 4, 4), None for a base at rest.
        base_rpy_deg: Roll, pitch and yaw of a base at rest, or of the axes of a moving one's poses, as for `Mechanism`;
            None for the model's.
        held: True if something holds the base, whose wrench is the ground's; None to infer it from the mechanism.
        setup: Standard deviations of set-up errors that differ from the defaults, in SI units and radians, by the
            kinds of `ident.setup.SETUP`; zero for what is exactly as stated.
        known: Standard deviations of the model's body parameters that differ from the defaults, by the kinds of
            `ident.parameters.prior.KNOWN`.
        known_bodies: The same of single bodies, by name, which take precedence.
        servos: Servos of the joints whose torques follow from their commands, by name.
        scales: Relative standard deviations of the scales of joint torques that are not exact, by joint: of `kp` of a
            servo, or of a motor's torque constant.
        couplings: Motors that move several joints together, to which rotors and friction belong: rows of R in
            `q_motor = R q`, by the motors' names, as numbers other than zero by joint.
        followers: Joints without channels that follow another one, by name.
        still: True if samples are poses at rest, in any order, whose times mean nothing.
        loaded: Name of the body that carries a load, which `identify_load` identifies; empty without one.
        trackers: Tracked bodies, whose poses are channels of the trajectory estimate, by the names of these poses.
        notes: Sentences on what was detected and repaired.
        unused: Names of a file's columns that were not used.
        streams: Channels as they were measured, at times of their own and NaN where a sample is missing, by name; the
            base's poses as `base:pose` (N, 16). The trajectory estimate uses these; everything else uses `measured` and
            `base`, where they are interpolated at the common times.
    """

    time: np.ndarray
    measured: Mapping[str, np.ndarray]
    true: Mapping[str, np.ndarray] = field(default_factory=dict)
    units: Mapping[str, str] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    provenance: Mapping[str, Any] = field(default_factory=dict)
    sensors: Mapping[str, Sensor] = field(default_factory=dict)
    base: np.ndarray | None = None
    setup: Mapping[str, float] = field(default_factory=dict)
    known: Mapping[str, float] = field(default_factory=dict)
    known_bodies: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    servos: Mapping[str, Servo] = field(default_factory=dict)
    scales: Mapping[str, float] = field(default_factory=dict)
    couplings: Couplings = field(default_factory=dict)
    followers: Mapping[str, Follower] = field(default_factory=dict)
    notes: Sequence[str] = ()
    unused: Sequence[str] = ()
    streams: Mapping[str, Sampled] = field(default_factory=dict)
    held: bool | None = None
    base_rpy_deg: tuple[float, ...] | None = None
    still: bool = False
    loaded: str = ""
    trackers: Mapping[str, Tracker] = field(default_factory=dict)

    def __post_init__(self) -> None:
        check_type("streams", self.streams, Mapping, STREAMS)
        check_type("noise", self.noise, Mapping, "a mapping of standard deviations")
        object.__setattr__(self, "time", times.checked_channel("time", self.time, None))
        times.check_times("Recorded times", self.time)
        for name in ("measured", "true"):
            channels = {key: times.checked_channel(key, x, len(self.time)) for key, x in getattr(self, name).items()}
            object.__setattr__(self, name, channels)
        for name in ("units", "noise", "provenance", "sensors"):
            object.__setattr__(self, name, dict(getattr(self, name)))
        for name, level in self.noise.items():
            if not (isinstance(level, Real) and 0 <= level < np.inf):
                raise LogError(f"The noise of channel '{name}' needs a standard deviation, got {level!r}.")
        if self.true and {k: x.shape for k, x in self.true.items()} != {k: x.shape for k, x in self.measured.items()}:
            raise LogError("True values need the same channels and shapes as the measured ones.")
        if self.base is not None and not (self.base.shape == (len(self.time), 4, 4) and is_rigid(self.base)):
            raise LogError(f"A moving base needs poses ({len(self.time)}, 4, 4), got {self.base.shape}.")
        if self.base_rpy_deg is not None:
            object.__setattr__(self, "base_rpy_deg", checked_rpy("base_rpy_deg", self.base_rpy_deg, LogError))
        object.__setattr__(self, "streams", {name: times.checked_stream(name, x) for name, x in self.streams.items()})
        for name, stream in self.streams.items():
            common = self._common(name).values
            if stream.values.shape[1:] != common.shape[1:]:
                raise LogError(f"The stream '{name}' needs {common[0].size} components, got {stream.columns.shape[1]}.")

    @property
    def _in_short(self) -> dict[str, object]:
        samples = len(self.time)
        return {
            "samples": f"{samples} at {self.rate:.4g} Hz, {np.ptp(self.time):.4g} s" if samples > 1 else str(samples),
            "channels": listed(self.measured),
            "wrenches": listed(self.wrenches),
            "commands": listed(self.servos),
            "base": "" if self.base is None else "moves",
            "own times": listed(self.streams),
            "notes": listed(self.notes, 1),
            "not used": listed(self.unused),
        }

    @classmethod
    @typed("streams")
    def from_streams(
        cls, streams: Mapping[str, tuple[Any, Any]], *, rate: float | None = None, **others: Any
    ) -> "Recording":
        """Recording of channels that were measured at times of their own.

        At the common times, which span the time that all streams cover, channels are interpolated linearly.

        Args:
            streams: Times (N,) and values (N,) or (N, d) by channel, NaN where a sample is missing; poses of a moving
                base as `base:pose` (N, 16), row by row.
            rate: Rate of the common times in Hz, by default that of the joint positions.
            others: Other fields of a recording, such as `units` or `sensors`.

        Raises:
            LogError: A stream is malformed, they have no time in common, or the rate is unknown.
        """
        check_type("streams", streams, Mapping, STREAMS)
        checked = {name: times.checked_stream(name, stream) for name, stream in streams.items()}
        time = uniform_times(checked, rate)
        measured = {name: interpolated(stream, time) for name, stream in checked.items() if name != BASE}
        base = interpolated_poses(checked[BASE], time) if BASE in checked else None
        return cls(time, measured, base=base, streams=checked, **others)

    @property
    def rate(self) -> float:
        """Samples per second, Hz."""
        return (len(self.time) - 1) / float(self.time[-1] - self.time[0])

    @property
    def noise_free(self) -> "Recording":
        """The recording with the true values in place of the measured ones."""
        if not self.true:
            raise LogError("This recording holds no true values.")
        return replace(self, measured=self.true, streams={})

    def without(self, channels: Collection[str]) -> "Recording":
        """The recording without some channels."""
        kept: dict[str, Any] = {
            kind: {name: x for name, x in getattr(self, kind).items() if name not in channels}
            for kind in ("measured", "true", "streams")
        }
        return replace(self, **kept)

    @property
    def without_streams(self) -> "Recording":
        """The recording at its common times alone."""
        return replace(self, streams={})

    def as_measured(self, channel: str) -> Sampled:
        """A channel at the times at which it was measured; the base's poses as `base:pose` (N, 16)."""
        return self.streams[channel] if channel in self.streams else self._common(channel)

    def _common(self, channel: str) -> Sampled:
        if channel == BASE and self.base is not None:
            return Sampled(self.time, self.base.reshape(-1, 16))
        return Sampled(self.time, self[channel])

    def covered(self, channels: Iterable[str]) -> np.ndarray:
        """Mask of the common times that lie in no gap of any of the channels (N,)."""
        inside = np.ones(len(self.time), bool)
        for name in (name for name in channels if name in self.streams):
            stream = self.streams[name]
            there = np.isfinite(stream.columns)
            measured = Sampled(stream.time, stream.columns[:, there.any(axis=0)])
            if measured.values.size:
                inside &= times.between_samples(measured, self.time, longest_step(measured))
        return inside

    @typed()
    def with_sensors(self, sensors: Mapping[str, Sensor]) -> "Recording":
        """The recording with sensors added or replaced, by the names of their wrenches."""
        return replace(self, sensors={**self.sensors, **sensors})

    def __getitem__(self, channel: str) -> np.ndarray:
        """A measured channel (N,) or (N, d)."""
        if channel not in self.measured:
            raise LogError(f"The recording has no channel '{channel}'; it has {', '.join(sorted(self.measured))}.")
        return self.measured[channel]

    def joint_states(self, joints: Sequence[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """q in rad or quaternions (N, n_q), q̇ in rad/s and q̈ in rad/s² of the named joints, both (N, n)."""
        q, dq, ddq = (self.of_joints(joints, kind) for kind in STATES)
        return q, dq, ddq

    def of_joints(self, joints: Sequence[str], kind: str) -> np.ndarray:
        """One quantity of the named joints, `position`, `velocity`, `acceleration` or `torque` (N, n)."""
        samples = len(self.time)
        return np.hstack([np.empty((samples, 0)), *(self[f"{j}_{kind}"].reshape(samples, -1) for j in joints)])

    def torques_at(self, tree: Tree, motion: Motion, cutoff: float | None = None) -> np.ndarray | None:
        """Torques of a tree's joints, measured or of servos, NaN for joints without (N, n); None if no joint has any.

        Args:
            tree: The mechanism's tree.
            motion: Its motion, at which servos of commanded joints act (N samples).
            cutoff: Frequency at which the motion was low-passed, as torques and commands are, Hz; None for no filter.
        """
        out = self.torques(tree.joints)
        commanded = {tree.freedoms.index(joint): joint for joint in tree.joints if joint in self.servos}
        if out is None:
            if not commanded:
                return None
            out = np.full((len(self.time), len(tree.freedoms)), np.nan)
        for k, joint in commanded.items():
            out[:, k] = self.servos[joint].kp * self._acting(f"{joint}_command")
        out = out if cutoff is None else low_pass(out, self.rate, cutoff)
        if commanded:
            kp, kv = np.array([(self.servos[joint].kp, self.servos[joint].kv) for joint in commanded.values()]).T
            own = [*commanded]
            out[:, own] -= kp * tree.freedom_coordinates(motion.q)[:, own] + kv * motion.dq[:, own]
        return out

    def _acting(self, channel: str) -> np.ndarray:
        """Commands that act around the samples, each held until the next one; of poses at rest their own (N,)."""
        if self.still or np.isnan(self[channel]).all():
            return self[channel]
        time = self.time[0] + np.arange(len(self.time)) / self.rate
        own = self.streams.get(channel, Sampled(time, self[channel]))
        when, command = own.time[known := np.isfinite(own.values)], own.values[known]
        # Half-way between a command and the next one their mean acts; within samples, angles whose acceleration jumps
        # are off what passes through the samples.
        command[1:-1] -= np.diff(command, 2) / 12
        return np.interp(time - np.median(np.diff(when)) / 2, when, command)

    def torques(self, joints: Sequence[str]) -> np.ndarray | None:
        """Measured torques of the named joints, NaN for joints without (N, n); None if no joint has any."""
        if not any(f"{joint}_torque" in self.measured for joint in joints):
            return None
        columns = []
        for joint in joints:
            freedoms = 1 if self[f"{joint}_position"].ndim == 1 else 3
            missing = np.full((len(self.time), freedoms), np.nan)
            columns.append(self.measured.get(f"{joint}_torque", missing).reshape(missing.shape))
        return np.hstack(columns)

    def joint_noise(self, joints: Sequence[str]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Standard deviations of the channels of hinges and slides, zero where unknown, each (n,)."""
        q, dq, ddq = (np.array([self.noise.get(f"{joint}_{kind}", 0.0) for joint in joints]) for kind in STATES)
        return q, dq, ddq

    @property
    def wrenches(self) -> tuple[str, ...]:
        """Names of the wrenches that have both a force and a torque channel."""
        forces = [name.removesuffix("_force") for name in self.measured if name.endswith("_force")]
        return tuple(name for name in forces if f"{name}_torque" in self.measured)

    @typed()
    def wrench(self, name: str) -> Wrench:
        """The wrench `[F; τ]` of a force and a torque channel, with the covariance of their noise if known.

        Raises:
            LogError: There is none of that name, or its sensor is unknown.
        """
        channels = f"{name}_force", f"{name}_torque"
        values = np.hstack([self[channel] for channel in channels])
        if name != GROUND and name not in self.sensors:
            raise LogError(
                f"The wrench '{name}' needs to be known by the body and the pose of its sensor (`with_sensors`); known "
                f"are {', '.join((GROUND, *self.sensors))}."
            )
        levels = [self.noise.get(channel) for channel in channels]
        covariance = None if None in levels else np.diag(np.repeat(np.array(levels, float), 3) ** 2)
        sensor = self.sensors.get(name, Sensor())
        return Wrench(
            values, sensor.body, sensor.pose, sensor.applied_to_link, covariance, time=self.time, frame=sensor.frame
        )

    def is_held(self, tree: Tree) -> bool:
        """True if something holds the base: as stated, or else if it rests and no joints leave it floating."""
        return (self.base is None and not tree.floats) if self.held is None else self.held

    def total_wrench(self, tree: Tree, without: Iterable[str] = (), *, motion: Motion | None = None) -> TotalWrench:
        """Total wrench of all wrenches but those named (Eq. 17); of contacts alone if nothing holds the base.

        Args:
            tree: The mechanism.
            without: Names of wrenches to leave out.
            motion: Motion of mechanism and base, by default the recorded joint positions and poses.
        """
        names = [name for name in self.wrenches if name not in without]
        ground = self.wrench(GROUND) if GROUND in names or self.is_held(tree) else None
        contacts = [self.wrench(name) for name in names if name != GROUND]
        if motion is None:
            return total_wrench(tree, self.of_joints(tree.joints, "position"), ground, contacts, base=self.base)
        return total_wrench(tree, motion.q, ground, contacts, base=motion.base_poses)

    def poses(self, body: str) -> np.ndarray:
        """Pose of a body in the base frame (N, 4, 4)."""
        return poses(self[f"{body}_position"], self[f"{body}_orientation"])

    def to_frame(self) -> "pd.DataFrame":
        """Measured channels as a pandas data frame, with the times in s as its index.

        Units are those of `units`, else rad, rad/s, rad/s², N and N m; m for slides. A vector has a column for each
        component, such as `ground_force.x`, a moving base 16 for its poses. `read_log` reads such a frame.

        Raises:
            InputError: pandas is not installed (extra `pandas`).
        """
        base = {} if self.base is None else {BASE: self.base.reshape(-1, 16)}
        return channels_frame(self.time, {**self.measured, **base})

    def plot(self) -> "Figure":
        """Joint positions, torques and commands and the wrenches over time, as a matplotlib figure."""
        from ident.display.plots import recording_figure

        return recording_figure(self.time, self.measured, self.units, self.wrenches)

    def save(self, path: str | Path) -> None:
        """Writes a `.npz` or `.csv` file that `load` reads back exactly, except for the streams.

        Raises:
            LogError: A channel has a name that a file cannot hold, or the file another suffix.
            InputError: The folder does not exist.
        """
        save(checked_path("path", path), vars(self))

    @classmethod
    def load(cls, path: str | Path, *, limit: int = LIMIT) -> "Recording":
        """Reads a file written by `save`, or one with columns named like channels.

        Args:
            path: A `.csv`, `.tsv`, `.txt` or `.npz` file.
            limit: Bytes that an archive may take in memory, as for `limits.check_size`.

        Raises:
            LogError: The file is missing or not a recording; the message names file, row and column.
        """
        (recording,) = cls.chunks(path, sys.maxsize, limit=limit)
        return recording

    @classmethod
    def chunks(cls, path: str | Path, samples: int = 10_000, *, limit: int = LIMIT) -> Iterator["Recording"]:
        """Reads a file like `load`, but piece by piece, for text larger than memory; an archive is read whole.

        Args:
            path: A `.csv`, `.tsv`, `.txt` or `.npz` file.
            samples: Samples of each piece; the last one may have fewer.
            limit: Bytes that an archive may take in memory, as for `limits.check_size`.

        Raises:
            LogError: The file is missing or not a recording, as for `load`; raised when the faulty piece is read.
            InputError: A piece has no samples.
        """
        if samples < 1:
            raise LogError(f"A piece of a recording needs at least one sample, got {samples}.")
        file = checked_path("path", path)
        try:
            for fields in load(file, samples, limit=limit):
                yield cls(**fields)
        except (LogError, OSError) as error:
            raise LogError(f"{path}: {error}") from error


def poses(position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    """Poses (N, 4, 4) from positions (N, 3) and quaternions `w, x, y, z` (N, 4)."""
    return pose(Rotation.from_quat(quaternion, scalar_first=True).as_matrix(), position)
