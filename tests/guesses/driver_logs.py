"""Forty logs with the column names of ten drivers and tools, each with its true mapping."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import walker
from guesses.odd_logs import DEG, text, vector
from guesses.robots import FINGERS, UR, Robot, seven, ur
from scipy.io import savemat

ALPHABETICAL = sorted(range(6), key=UR.__getitem__)


@dataclass(frozen=True, eq=False)
class Log:
    """A log with its true mapping.

    Attributes:
        tool: Driver or tool with these column names.
        about: Special features.
        columns: Columns of numbers or words by name (N,).
        mechanism: The recorded mechanism.
        truth: Column of each quantity as `JOINT.KIND`, with the factor to SI; None without a column.
        wrenches: Columns of each wrench, forces first, and the body that it acts on; None for the ground.
        asked: True if something is open that only its owner knows.
        between: Separator of columns; `mat` for a MATLAB file.
        header: True if it has a row of names.
    """

    tool: str
    about: str
    columns: Mapping[str, Any]
    mechanism: Any
    truth: Mapping[str, tuple[str, float] | None]
    wrenches: Mapping[tuple[str, ...], str | None] = field(default_factory=dict)
    asked: bool = False
    between: str = ","
    header: bool = True

    @property
    def name(self) -> str:
        """Its tool and special features, for messages."""
        return f"{self.tool}: {self.about}"

    def write(self, folder: Path) -> Path:
        """Writes it and returns its path."""
        if self.between == "mat":
            savemat(folder / "log.mat", self.columns)
            return folder / "log.mat"
        path = folder / "log.csv"
        if any(np.asarray(x).dtype.kind == "U" for x in self.columns.values()):
            rows = zip(*([str(cell) for cell in x] for x in self.columns.values()), strict=True)
            lines = [",".join(row) for row in [tuple(self.columns), *rows]]
            path.write_text("\n".join(lines) + "\n", encoding="utf-8")
            return path
        content = text(self.columns, self.between)
        path.write_text(content if self.header else content.partition("\n")[2], encoding="utf-8")
        return path


def series(pattern: str, x: np.ndarray, first: int = 0) -> dict[str, np.ndarray]:
    """Numbered columns of an array (N, d)."""
    return {pattern.format(k): column for k, column in enumerate(x.T, start=first)}


def named(pattern: str, names: Sequence[str], x: np.ndarray) -> dict[str, np.ndarray]:
    """Columns of an array (N, d) by names."""
    return {pattern.format(name): column for name, column in zip(names, x.T, strict=True)}


def true(
    robot: Robot, names: Mapping[str, Sequence[str]], factors: Mapping[str, float] | None = None
) -> dict[str, Any]:
    """True columns of each kind, from the base on."""
    scale = factors or {}
    return {
        f"{joint}.{kind}": (column, scale.get(kind, 1.0))
        for kind, columns in names.items()
        for joint, column in zip(robot.joints, columns, strict=True)
    }


def numbered(robot: Robot, *patterns: str, first: int = 0, order: Sequence[int] | None = None) -> dict[str, Any]:
    """True mapping of numbered positions, velocities and torques."""
    n = len(robot.joints)
    place = {joint: k for k, joint in enumerate(order or range(n))}
    kinds = dict(zip(("position", "velocity", "torque"), patterns, strict=False))
    return true(robot, {kind: [p.format(place[k] + first) for k in range(n)] for kind, p in kinds.items() if p})


def stamped(robot: Robot, name: str = "time", factor: float = 1.0, start: float = 0.0) -> dict[str, np.ndarray]:
    """The column of times."""
    return {name: factor * (robot.time + start)}


def states(robot: Robot, q: str, dq: str, tau: str, *, first: int = 0, order: Sequence[int] | None = None):
    """Numbered columns of positions, velocities and torques."""
    order = order or range(len(robot.joints))
    parts = ((q, robot.q), (dq, robot.dq), (tau, robot.tau))
    return {name: x for p, values in parts if p for name, x in series(p, values[:, order], first).items()}


def noise(robot: Robot, columns: int, size: float = 1.0, seed: int = 5) -> np.ndarray:
    """Columns independent of the motion (N, columns)."""
    return size * np.cumsum(np.random.default_rng(seed).normal(size=(len(robot.time), columns)), axis=0) / 30


def fingers(robot: Robot) -> dict[str, None]:
    """Quantities that a log without fingers leaves open."""
    return {f"{name}.position": None for name in FINGERS}


def angles_of_walker(pattern: str, factor: float = 1.0) -> tuple[dict[str, np.ndarray], dict[str, Any]]:
    """A person's columns and their true mapping."""
    time, q, *_ = walker.motion()
    joints = walker.mechanism().tree.joints
    slide = np.array([1.0 if name in ("tx", "ty", "tz") else factor for name in joints])
    columns = {"time": time, **named(pattern, joints, q * slide)}
    scales = dict(zip(joints, slide, strict=True))
    return columns, {f"{name}.position": (pattern.format(name), 1 / scales[name]) for name in joints}


def plates(force: str, point: str, moment: str, sides: Mapping[str, str]):
    """Plates under a person's feet with centres of pressure, and their columns.

    Args:
        force: Pattern of a force's component, with the plate's name and the axis.
        point: The same of the point of application.
        moment: The same of the moment about it.
        sides: Names of the plates of the right and of the left foot.
    """
    both, columns, those = walker.wrenches(), {}, {}
    for side, wrench in (("r", both["right"] + both["rail"]), ("l", both["left"])):
        at, free = walker.centre_of_pressure(wrench)
        at = np.nan_to_num(np.column_stack([at, 0 * free]), posinf=0, neginf=0)
        about = np.column_stack([0 * free, 0 * free, free])
        names = [[p.format(sides[side], axis) for axis in "xyz"] for p in (force, point, moment)]
        for listed, x in zip(names, (wrench[:, :3], at, about), strict=True):
            columns |= dict(zip(listed, x.T, strict=True))
        those[tuple(names[0] + names[2])] = f"foot_{side}"
    return columns, those


def base_wrench(robot: Robot, force: str, torque: str, turn: float = 1.0):
    """Columns of the ground's wrench, and their mapping."""
    columns = vector(force, turn * robot.base[:, :3]) | vector(torque, turn * robot.base[:, 3:])
    return columns, {tuple(columns): None}


__all__ = ["ALPHABETICAL", "DEG", "FINGERS", "UR", "Log", "seven", "ur"]
