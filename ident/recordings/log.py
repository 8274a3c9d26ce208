"""A user's recording of a mechanism: columns found by name or by a mapping file, units converted, time repaired."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from ident.errors import LogError
from ident.recordings.channels import read_channels, with_names
from ident.recordings.mapping import GROUND, KINDS, UNITS, ColumnMapping, read_mapping
from ident.recordings.npz import LIMIT
from ident.recordings.plausibility import check_angles, check_rates, unit_of_force
from ident.recordings.table import SAMPLES, Table, read_table
from ident.recordings.times import repaired

__all__ = ["GROUND", "KINDS", "SAMPLES", "UNITS", "Log", "Wrench", "read_log"]


@dataclass(frozen=True, eq=False)
class Wrench:
    """A measured wrench.

    Attributes:
        values: Wrenches `[F; τ]` in the sensor's frame, N and N m, NaN in the columns of missing channels (N, 6).
        body: Name of the body that touches something; None for the ground wrench.
        pose: Pose of the sensor's frame in the body's frame, for the ground wrench in the base frame (4, 4).
        applied_to_link: Whether the values are what the surroundings exert on the mechanism, not the other way round.
    """

    values: np.ndarray
    body: str | None
    pose: np.ndarray
    applied_to_link: bool

    @property
    def on_mechanism(self) -> np.ndarray:
        """The wrench that the surroundings exert on the mechanism, in the sensor's frame (N, 6)."""
        return self.values if self.applied_to_link else -self.values


@dataclass(frozen=True, eq=False)
class Log:
    """What a user recorded, uniformly sampled and in SI units, joints in the mechanism's order.

    Attributes:
        time: Sample times, s (N,).
        q: Joint positions, rad or m (N, n).
        dq: Joint velocities, rad/s or m/s (N, n), None unless the log has those of all joints.
        ddq: Joint accelerations, rad/s² or m/s² (N, n), None unless the log has those of all joints.
        torques: Joint torques or forces, N m or N (N, n), NaN in the columns of joints without; None without any.
        wrenches: Measured wrenches by name; `ground` is the one at the base.
        base: Pose of a moving base frame in an inertial frame (N, 4, 4), None for a base that rests.
        notes: Sentences on what was detected and repaired.
        unused: Names of the columns that nothing was taken from.
    """

    time: np.ndarray
    q: np.ndarray
    dq: np.ndarray | None
    ddq: np.ndarray | None
    torques: np.ndarray | None
    wrenches: Mapping[str, Wrench]
    base: np.ndarray | None
    notes: tuple[str, ...]
    unused: tuple[str, ...] = ()

    @property
    def rate(self) -> float:
        """Samples per second, Hz."""
        return (len(self.time) - 1) / float(self.time[-1] - self.time[0])


def read_log(
    path: str | Path,
    joints: Sequence[str],
    bodies: Sequence[str] = (),
    columns: str | Path | None = None,
    *,
    slides: Sequence[str] = (),
    balls: Sequence[str] = (),
    weight: float | None = None,
    limit: int = LIMIT,
) -> Log:
    """Reads a log of joint states and wrenches.

    Args:
        path: A CSV file with a header, a npz file of arrays by name, or what `Recording.save` wrote.
        joints: Names of the joints in the mechanism's order.
        bodies: Names of its bodies, which contacts may name.
        columns: A TOML file that maps columns to joints, wrenches and the base where names or units differ. What it
            does not mention is found by name.
        slides: Those of the joints that slide: lengths, not angles.
        balls: Those of the joints that are balls; logs cannot hold them.
        weight: Weight of the mechanism, N, to judge the units of the ground wrench by.
        limit: Bytes that a npz file may take in memory.

    Returns:
        The log.

    Raises:
        LogError: A file is missing or malformed, holds what the mechanism does not have, or lacks what it needs; the
            message names file, row and column.
    """
    if balls:
        raise LogError(
            f"A log can hold hinges, slides and the pose of a moving base, but not the ball joint '{balls[0]}'; name "
            "the body it carries as the base, and map its pose under [base]."
        )
    mapping = ColumnMapping() if columns is None else read_mapping(Path(columns), joints, bodies, slides)
    try:
        return _log(read_table(Path(path), limit), mapping, joints, slides, weight)
    except LogError as error:
        raise LogError(f"{path}: {error}") from None


def _log(
    table: Table, mapping: ColumnMapping, joints: Sequence[str], slides: Sequence[str], weight: float | None
) -> Log:
    notes: list[str] = []
    mapping = with_names(mapping, table, joints)
    time, channels = repaired(table, mapping.columns["time"], read_channels(table, mapping, notes), notes)
    q, dq, ddq, torques = (_stacked(kind, channels, joints, len(time)) for kind in KINDS)
    states = {
        "position": q,
        "velocity": _of_all_joints("velocity", dq, joints, notes),
        "acceleration": _of_all_joints("acceleration", ddq, joints, notes),
    }
    check_angles(mapping, q, joints, slides)
    check_rates(time, states, joints, slides)
    wrenches = {
        name: Wrench(
            np.hstack([channels[f"wrenches.{name}.force"], channels[f"wrenches.{name}.torque"]]),
            sensor.body,
            sensor.pose,
            sensor.applied_to_link,
        )
        for name, sensor in mapping.sensors.items()
    }
    if GROUND in wrenches and weight and not mapping.has_base:
        notes += unit_of_force(mapping, wrenches[GROUND].values[:, :3], weight)
    return Log(
        time,
        q,
        states["velocity"],
        states["acceleration"],
        None if np.isnan(torques[0]).all() else torques,
        wrenches,
        _poses(channels["base.position"], channels["base.quaternion"]) if mapping.has_base else None,
        tuple(notes),
        tuple(name for name in table.cells if name not in mapping.used),
    )


def _stacked(kind: str, channels: Mapping[str, np.ndarray], joints: Sequence[str], samples: int) -> np.ndarray:
    """One quantity of all joints, NaN in the columns of joints without (N, n)."""
    return np.hstack([np.empty((samples, 0)), *(channels[f"joints.{joint}.{kind}"] for joint in joints)])


def _of_all_joints(kind: str, x: np.ndarray, joints: Sequence[str], notes: list[str]) -> np.ndarray | None:
    """One quantity of all joints (N, n), or None if one of them is without."""
    missing = [joint for joint, first in zip(joints, x[0], strict=True) if np.isnan(first)]
    if 0 < len(missing) < len(joints):
        notes.append(f"No {kind} of {', '.join(missing)} is recorded; those of the other joints are not used.")
    return x if joints and not missing else None


def _poses(position: np.ndarray, quaternion: np.ndarray) -> np.ndarray:
    T = np.tile(np.eye(4), (len(position), 1, 1))
    T[:, :3, :3] = Rotation.from_quat(quaternion, scalar_first=True).as_matrix()
    T[:, :3, 3] = position
    return T
