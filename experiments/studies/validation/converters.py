"""Converters of published files into files that are read, each of a few lines, by name."""

import csv
import io
import pickle
import re
import sqlite3
import struct
import zipfile
from collections.abc import Callable, Iterator
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import InputError
from ident.files.atomic import replacing

Converter = Callable[[Path, Path], None]
"""Function of the paths of a file and of the file to make."""


def declared_world(source: Path, target: Path) -> None:
    """Declares the link `world` of a URDF file, on which its first joint hangs, as Drake does by itself."""
    text = source.read_text(encoding="utf-8")
    declared = re.sub(r"(<robot\b[^>]*>)", r'\1\n<link name="world"/>', text, count=1)
    _write(target, text if re.search(r'<link\s+name="world"', text) else declared)


def clamped(source: Path, target: Path) -> None:
    """Takes free joints, meshes and keyframes out of an MJCF file, so that its base is clamped."""
    text = source.read_text(encoding="utf-8")
    for pattern in (
        r"<freejoint\b[^>]*/>",
        r'<joint\b[^>]*type="free"[^>]*/>',
        r"<mesh\b[^>]*/>",
        r"<geom\b[^>]*\bmesh=[^>]*/>",
        r"<keyframe>.*?</keyframe>",
    ):
        text = re.sub(pattern, "", text, flags=re.DOTALL)
    _write(target, text)


NOISE = {
    "f[xyz]": 0.1,
    "m[xyz]": 0.005,
    "[xyz]": 1e-4,
    "q[wxyz]": np.radians(0.01) / 2,
    "ground_force_[lr]_v[xyz]": 1.0,
    "ground_torque_[lr]_[xyz]": 0.1,
    "pelvis_t[xyz]": 1e-3,
    "(pelvis|hip|lumbar|knee|arm|ankle|elbow|subtalar|pro)_.*": np.radians(0.5),
}
"""Noise of simulated columns by the form of their names, the first that fits, SI units: of tools the middle of three
published levels (Nadeau et al., arXiv:2203.00830), and of poses and persons what cameras and plates have."""


def noisy(source: Path, target: Path, factor: float = 1.0) -> None:
    """Adds noise to the exact columns of a simulation, drawn by the file's name and folder; a factor is on wrenches."""
    lines = source.read_text(encoding="utf-8").splitlines()
    start = lines.index("endheader") + 1 if "endheader" in lines else 0
    mark = "," if "," in lines[start] else "\t"
    names = lines[start].split(mark)
    table = np.array([line.split(mark) for line in lines[start + 1 :]], float)
    std = [next((x for form, x in NOISE.items() if re.fullmatch(form, name)), 0.0) for name in names]
    std = [x * (factor if re.fullmatch("[fm][xyz]", name) else 1) for x, name in zip(std, names, strict=True)]
    drawn = f"{source.parent.name}/{source.name}" + f" {factor:g}" * (factor != 1)
    rng = np.random.default_rng(list(drawn.encode()))
    table += std * rng.standard_normal(table.shape)
    rows = (mark.join(f"{x:.9g}" for x in row) for row in table)
    _write(target, "\n".join([*lines[: start + 1], *rows, ""]))


def wrong_bodies(source: Path, target: Path) -> None:
    """Makes masses, centres and inertias of an OpenSim model's bodies wrong by up to a fifth, drawn by its name."""
    rng = np.random.default_rng(list(source.name.encode()))

    def wrong(match: re.Match[str]) -> str:
        numbers = np.array(match[2].split(), float) * (1 + rng.uniform(-0.2, 0.2))
        return f"{match[1]}{' '.join(f'{x:.12g}' for x in numbers)}{match[3]}"

    text = source.read_text(encoding="utf-8")
    _write(target, re.sub(r"(<(?:mass|mass_center|inertia)>)([^<]*)(</)", wrong, text))


def joint_states(source: Path, target: Path) -> None:
    """Makes a table of the `sensor_msgs/JointState` messages of a ROS 2 bag in sqlite, times from zero."""
    with closing(sqlite3.connect(f"{source.resolve().as_uri()}?mode=ro&immutable=1", uri=True)) as bag:
        topics = "SELECT id FROM topics WHERE type = 'sensor_msgs/msg/JointState'"
        messages = f"SELECT data FROM messages WHERE topic_id IN ({topics}) ORDER BY timestamp"
        states = [_joint_state(data) for (data,) in bag.execute(messages)]
    if not states:
        raise InputError(f"'{source}' holds no joint states.")
    joints, start = states[0][1], states[0][0]
    head = ["time", *(f"{joint}_{kind}" for kind in ("position", "velocity", "torque") for joint in joints)]
    _table(target, head, ([repr(time - start), *map(repr, numbers)] for time, _, numbers in states))


def _joint_state(data: bytes) -> tuple[float, list[str], list[float]]:
    """Time, joints, and positions, velocities and efforts of a message in CDR."""
    at = 4

    def number(form: str, size: int) -> Any:
        nonlocal at
        at += -(at - 4) % size
        at += size
        return struct.unpack_from("<" + form, data, at - size)[0]

    def text() -> str:
        nonlocal at
        size = number("I", 4)
        at += size
        return data[at - size : at - 1].decode()

    time = number("i", 4) + number("I", 4) / 1e9
    text()
    joints = [text() for _ in range(number("I", 4))]
    numbers = [number("d", 8) for _ in range(3) for _ in range(number("I", 4))]
    if len(numbers) != 3 * len(joints):
        raise InputError(f"A message names {len(joints)} joints and holds {len(numbers)} numbers of them.")
    return time, joints, numbers


def tensors(source: Path, target: Path) -> None:
    """Makes a table of a tensor file with `time`, and `dof_pos` and `des_dof_pos` of the twelve joints of a Go2."""
    with zipfile.ZipFile(source) as archive:
        (content,) = [name for name in archive.namelist() if name.endswith("/data.pkl")]
        read = _Tensors(archive, content.removesuffix("data.pkl"))
        tables = read.load()
    legs, parts = ("FL", "FR", "RL", "RR"), ("hip", "thigh", "calf")
    joints = [f"{leg}_{part}_joint" for leg in legs for part in parts]
    head = ["time", *(f"{kind}_{joint}" for kind in "qu" for joint in joints)]
    rows = np.column_stack([np.ravel(tables["time"]), tables["dof_pos"], tables["des_dof_pos"]])
    _table(target, head, ([f"{x:.7g}" for x in row] for row in rows))


class _Tensors(pickle.Unpickler):
    """Reader of a tensor file that builds dictionaries and dense arrays and nothing else."""

    TYPES = {"FloatStorage": "<f4", "DoubleStorage": "<f8", "LongStorage": "<i8", "IntStorage": "<i4"}  # noqa: RUF012

    def __init__(self, archive: zipfile.ZipFile, prefix: str) -> None:
        super().__init__(io.BytesIO(archive.read(f"{prefix}data.pkl")))
        self._archive, self._prefix = archive, prefix

    def find_class(self, module: str, name: str) -> Any:
        """Class or function of a few names; all others are refused."""
        allowed = {
            ("torch._utils", "_rebuild_tensor_v2"): _dense,
            ("collections", "OrderedDict"): dict,
            **{("torch", kind): form for kind, form in self.TYPES.items()},
        }
        if (module, name) not in allowed:
            raise InputError(f"A tensor file with '{module}.{name}' is not read: it may run code.")
        return allowed[module, name]

    def persistent_load(self, pid: Any) -> np.ndarray:
        """Numbers of a storage."""
        _, form, key, *_ = pid
        return np.frombuffer(self._archive.read(f"{self._prefix}data/{key}"), form)


def _dense(storage: np.ndarray, offset: int, size: tuple[int, ...], stride: tuple[int, ...], *_: object) -> np.ndarray:
    """Array of a tensor of some size and stride in a storage."""
    at = np.array(offset)
    for axis, step in zip(size, stride, strict=True):
        at = at[..., None] + step * np.arange(axis)
    return storage[at]


def _table(target: Path, head: list[str], rows: Iterator[list[str]]) -> None:
    out = io.StringIO()
    writer = csv.writer(out, lineterminator="\n")
    writer.writerow(head)
    writer.writerows(rows)
    _write(target, out.getvalue())


def _write(target: Path, text: str) -> None:
    with replacing(target) as temporary:
        temporary.write_text(text, encoding="utf-8", newline="")


CONVERTERS: dict[str, Converter] = {
    "declared_world": declared_world,
    "clamped": clamped,
    "joint_states": joint_states,
    "tensors": tensors,
    "noisy": noisy,
    "noisy_low": partial(noisy, factor=0.5),
    "noisy_high": partial(noisy, factor=2.0),
    "wrong_bodies": wrong_bodies,
}
"""All converters by name."""
