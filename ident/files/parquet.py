"""Parquet files, and LeRobot's datasets of them, of versions 2 and 3: one episode, vectors by components' names.

Version 2 has a file for each episode, `data/chunk-000/episode_000003.parquet`. Version 3 has several in a file,
`data/chunk-000/file-000.parquet`, and lists in `meta/episodes` which is where. `meta/info.json` describes the columns.
"""

import re
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from ident.errors import LogError
from ident.files.limits import LIMIT, NUMBER, check_size, library, parsed_json, undamaged
from ident.files.table import Table, vector_columns

UNPACKED, PACKED = 2, 3
"""Fields of a page's header: its sizes in bytes."""

COUNTED = (5, 7, 8)
"""Fields of a page's header of which the first field is a number of values: data, dictionaries, data of version 2."""


def tables(path: Path, limit: int) -> list[Table]:
    """The table of a file; timestamps and durations are in s, timestamps counted from the first one.

    Raises:
        LogError: The file is damaged or too large.
        InputError: The library is not installed.
    """
    with library("parquet"):
        import pyarrow.parquet
    with undamaged("a parquet file"), path.open("rb") as stream:
        file = pyarrow.parquet.ParquetFile(stream)
        columns = file.schema_arrow
        numeric = [field for field in columns if _width(field.type)]
        check_size(path, NUMBER * file.metadata.num_rows * sum(_width(field.type) for field in numeric), limit)
        twice = [name for name in columns.names if columns.names.count(name) > 1]
        if twice:
            raise LogError(f"columns of a log need different names, '{twice[0]}' is more than one.")
        check_size(path, size_of(stream, file.metadata, [field.name for field in numeric]), limit)
        content = file.read([field.name for field in numeric])
        cells: dict[str, np.ndarray] = {}
        units: dict[str, str] = {}
        for field in numeric:
            column = content.column(field.name)
            cells |= vector_columns(field.name, numbers(column))
            if _is_time(field.type):
                units[field.name] = "SI"
    return [Table(cells, range(content.num_rows), "row", units=units)]


def _width(kind: Any) -> int:
    """Count of numbers in a cell of a type; zero if it is not numeric."""
    from pyarrow import types

    if types.is_fixed_size_list(kind):
        return int(kind.list_size) if _width(kind.value_type) == 1 else 0
    number = types.is_integer(kind) or types.is_floating(kind) or types.is_boolean(kind) or types.is_decimal(kind)
    return int(number or _is_time(kind))


def _is_time(kind: Any) -> bool:
    from pyarrow import types

    return bool(types.is_timestamp(kind) or types.is_duration(kind))


def numbers(column: Any) -> np.ndarray:
    """Numbers of a column of any numeric type, NaN for its nulls (N,) or (N, d)."""
    return _numbers(column.combine_chunks(), column.type)


def _numbers(column: Any, kind: Any) -> np.ndarray:
    """Numbers of an array, as `numbers`."""
    import pyarrow

    if _width(kind) > 1:
        if column.null_count:
            raise LogError("a column of vectors has rows without any.")
        return _numbers(column.flatten(), kind.value_type).reshape(len(column), -1)
    if not _is_time(kind):
        return np.asarray(column.cast(pyarrow.float64()).to_numpy(zero_copy_only=False), float)
    ticks = column.cast(pyarrow.int64())
    missing = np.asarray(ticks.is_null().to_numpy(zero_copy_only=False))
    # Integers: nanoseconds since 1970 have more digits than a float.
    counts = np.asarray(ticks.fill_null(0).to_numpy(zero_copy_only=False), np.int64)
    first = counts[missing.argmin()] if pyarrow.types.is_timestamp(kind) and len(counts) else 0
    return np.where(missing, np.nan, (counts - first) * {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[kind.unit])


def size_of(stream: BinaryIO, metadata: Any, columns: Collection[str]) -> int:
    """Bytes that some columns take in memory.

    Args:
        stream: The file.
        metadata: Its footer, as the library reads it.
        columns: Names of the columns.

    Raises:
        LogError: A header is none.
    """
    groups = [metadata.row_group(k) for k in range(metadata.num_row_groups)]
    chunks = [group.column(k) for group in groups for k in range(group.num_columns)]
    # A vector's path is that of its innermost part, `action.list.element`.
    used = [each for each in chunks if any(f"{each.path_in_schema}.".startswith(f"{name}.") for name in columns)]
    return sum(_chunk_size(stream, each) for each in used)


def _chunk_size(stream: BinaryIO, chunk: Any) -> int:
    """Bytes of all pages of a column in a row group."""
    offsets = chunk.data_page_offset, chunk.dictionary_page_offset or 0
    size, at = 0, min(offset for offset in offsets if offset)
    end = at + chunk.total_compressed_size
    while at < end:
        stream.seek(at)
        header = _struct(stream)
        values = sum(header[k].get(1, 0) for k in COUNTED if k in header)
        size += max(NUMBER * values, header.get(UNPACKED, 0))
        at = stream.tell() + max(0, header.get(PACKED, 0))
    return size


def _struct(stream: BinaryIO) -> dict[int, Any]:
    """Fields of a structure by number: whole numbers and structures; True for all others."""
    fields, number = dict[int, Any](), 0
    while (head := _byte(stream)) and (kind := head & 15):
        number = number + (head >> 4) if head >> 4 else _whole(stream)
        if kind in (4, 5, 6):
            fields[number] = _whole(stream)
        elif kind == 12:
            fields[number] = _struct(stream)
        elif kind in (1, 2, 3, 7, 8):
            # Truth values are in the type itself; texts follow their length.
            stream.seek({3: 1, 7: 8}.get(kind, 0) if kind != 8 else _natural(stream), 1)
            fields[number] = True
        else:
            raise LogError(f"a page's header has a field of type {kind}")
    return fields


def _whole(stream: BinaryIO) -> int:
    """Whole number, whose sign is its last bit."""
    number = _natural(stream)
    return number >> 1 if number % 2 == 0 else -(number + 1 >> 1)


def _natural(stream: BinaryIO) -> int:
    """Natural number in pieces of seven bits, the last of which has no eighth."""
    number = 0
    for shift in range(0, 70, 7):
        piece = _byte(stream)
        number |= (piece & 127) << shift
        if piece < 128:
            return number
    raise LogError("a page's header has a number of more than ten bytes")


def _byte(stream: BinaryIO) -> int:
    if not (byte := stream.read(1)):
        raise LogError("a page's header is cut off")
    return byte[0]


INFO = "meta/info.json"
"""File that marks a folder as a dataset, and describes its columns."""

EPISODE, TIME = "episode_index", "timestamp"
"""Columns of an episode's number, and of times in s from its beginning."""

NO_VALUES = (TIME, EPISODE, "frame_index", "index", "task_index")
"""Columns that measure nothing."""

NUMERIC = ("bool", "float", "int", "uint")
"""Beginnings of the names of numeric types; others are videos, images and texts."""

MOST = 10_000
"""Largest number of components of a vector; longer ones are pictures or what networks made of them."""


def is_dataset(path: Path) -> bool:
    """True if a path is the folder of a dataset, or one with an episode, `DATASET#3`."""
    return (folder_and_episode(path)[0] / INFO).is_file()


def folder_and_episode(path: Path) -> tuple[Path, str]:
    """Folder of a dataset, and its episode as it is given after `#`; an empty text if none is."""
    folder, mark, episode = str(path).rpartition("#")
    return (Path(folder), episode) if mark and not path.exists() else (path, "")


def parts(path: Path) -> tuple[Path, ...]:
    """Files that are read of a dataset: its description, and the data of the episode; raises as `dataset_tables`."""
    folder, _ = folder_and_episode(path)
    version, _ = _description(folder)
    episodes = _episodes(folder, version)
    return folder / INFO, episodes[_chosen(path, episodes)]


def dataset_tables(path: Path, limit: int) -> list[Table]:
    """The table of one episode.

    Vectors are split into components by the names in `meta/info.json`, `observation.state.shoulder`, or by their
    numbers, `observation.state.0`, if they have none; components of one name get their numbers as well. Times are the
    column `time`, in s.

    Args:
        path: The folder of a dataset with one episode, or `DATASET#3` for episode 3.
        limit: Bytes that the columns of the episode's file may take in memory.

    Raises:
        LogError: The dataset is damaged, of another version, or has not the episode.
        InputError: The library is not installed.
    """
    folder, _ = folder_and_episode(path)
    version, features = _description(folder)
    with library("parquet"):
        import pyarrow.parquet  # noqa: F401
    episodes = _episodes(folder, version, limit)
    episode = _chosen(path, episodes)
    file = episodes[episode]
    name = file.relative_to(folder).as_posix()
    if not file.is_file():
        raise LogError(f"episode {episode} is in {name}, which does not exist.")
    with undamaged(f"a LeRobot dataset, and {name} a parquet file of its columns"):
        cells = _of_episode(file, name, episode, features, limit)
    return [Table(cells, range(len(cells["time"])), "frame", units={"time": "SI"})]


def _description(folder: Path) -> tuple[int, Mapping[str, Any]]:
    """Main version of a dataset, and its features by name."""
    with undamaged(f"a LeRobot dataset, whose {INFO} describes it in JSON"):
        info = parsed_json((folder / INFO).read_text(encoding="utf-8"))
        version, features = info.get("codebase_version"), info.get("features")
    if not (match := re.fullmatch(r"v?([23])\.\d+", str(version))):
        raise LogError(
            f"LeRobot's datasets of versions 2 and 3 are read; {INFO} says codebase_version {version!r:.40}."
        )
    if not (isinstance(features, dict) and all(isinstance(each, dict) for each in features.values())):
        raise LogError(f"{INFO} of a LeRobot dataset needs 'features', which describe its columns; it has none.")
    return int(match[1]), features


def _episodes(folder: Path, version: int, limit: int = LIMIT) -> dict[int, Path]:
    """File of each episode, by number; their list may take `limit` bytes in memory.

    Raises:
        LogError: There is none.
    """
    with undamaged("a LeRobot dataset that lists its episodes"):
        episodes = dict(sorted(_listed(folder, limit) if version == 3 else _single(folder)))
    if not episodes:
        needed = "meta/episodes/chunk-000/file-000.parquet" if version == 3 else "data/chunk-000/episode_000000.parquet"
        raise LogError(f"a LeRobot dataset of version {version} has its first episode in {needed}; here is none.")
    return episodes


def _single(folder: Path) -> Iterator[tuple[int, Path]]:
    """Yields number and file of each episode of version 2."""
    for file in folder.glob("data/chunk-*/episode_*.parquet"):
        if (number := file.stem.removeprefix("episode_")).isdecimal():
            yield int(number), file


def _listed(folder: Path, limit: int) -> Iterator[tuple[int, Path]]:
    """Yields number and file of each episode of version 3."""
    from pyarrow import parquet

    names = [EPISODE, "data/chunk_index", "data/file_index"]
    for file in folder.glob("meta/episodes/chunk-*/*.parquet"):
        with file.open("rb") as stream:
            content = parquet.ParquetFile(stream)
            check_size(file, NUMBER * len(names) * content.metadata.num_rows, limit)
            check_size(file, size_of(stream, content.metadata, names), limit)
            listed = content.read(names)
        for episode, chunk, k in zip(*(listed.column(name).to_pylist() for name in names), strict=True):
            yield int(episode), folder / f"data/chunk-{int(chunk):03d}/file-{int(k):03d}.parquet"


def _chosen(path: Path, episodes: Mapping[int, Path]) -> int:
    """Number of the episode that a path names, or of the only one."""
    folder, asked = folder_and_episode(path)
    if asked.isdecimal() and int(asked) in episodes:
        return int(asked)
    if not asked and len(episodes) == 1:
        return next(iter(episodes))
    there = f"the dataset has {_spans([*episodes])}"
    if not asked:
        raise LogError(f"an episode of the dataset is chosen as {folder.name}#{next(iter(episodes))}; {there}.")
    raise LogError(f"an episode is chosen by its number, got '{asked:.40}'; {there}.")


def _spans(numbers: Sequence[int]) -> str:
    """Sorted numbers in words, `episodes 0 to 4, 7`."""
    runs = [[k for _, k in run] for _, run in groupby(enumerate(numbers), lambda each: each[1] - each[0])]
    shown = [f"{run[0]} to {run[-1]}" if len(run) > 1 else str(run[0]) for run in runs]
    return f"episode{'s' * (len(numbers) > 1)} {', '.join(shown[:20])}{', ...' * (len(shown) > 20)}"


def _of_episode(file: Path, name: str, episode: int, features: Mapping[str, Any], limit: int) -> dict[str, np.ndarray]:
    """Columns of an episode by name (N,)."""
    measured = {feature: each for feature, each in features.items() if _is_numeric(each) and feature not in NO_VALUES}
    components = {feature: _components(feature, each) for feature, each in measured.items()}
    table = _rows(file, name, episode, components, limit)
    cells = {"time": numbers(table.column(TIME))}
    for feature, names in components.items():
        vectors = _vectors(table.column(feature), feature, len(names))
        cells |= dict(zip(names, vectors.T, strict=True))
    return cells


def _rows(file: Path, name: str, episode: int, components: Mapping[str, Sequence[str]], limit: int) -> Any:
    """Times and features of an episode, as a table of the library."""
    from pyarrow import parquet

    with file.open("rb") as stream:
        content, names = parquet.ParquetFile(stream), [EPISODE, TIME, *components]
        there = content.schema_arrow.names
        if missing := [column for column in names if column not in there]:
            raise LogError(f"{name} needs a column '{missing[0]}', as of a LeRobot dataset; it has {', '.join(there)}.")
        check_size(file, NUMBER * content.metadata.num_rows * (2 + sum(map(len, components.values()))), limit)
        check_size(file, size_of(stream, content.metadata, names), limit)
        table = content.read(names)
    own = np.flatnonzero(numbers(table.column(EPISODE)) == episode)
    if not len(own):
        raise LogError(f"{name} has no rows of episode {episode}.")
    return table.take(own)


def _is_numeric(feature: Mapping[str, Any]) -> bool:
    """True if a feature is a number or a vector of numbers, and no longer than any robot's."""
    shape = feature.get("shape")
    vector = isinstance(shape, list) and len(shape) == 1 and isinstance(shape[0], int) and 0 < shape[0] <= MOST
    return vector and str(feature.get("dtype")).startswith(NUMERIC)


def _components(name: str, feature: Mapping[str, Any]) -> list[str]:
    """Names of the columns of a feature."""
    (size,) = feature["shape"]
    names = _flat(feature.get("names"))
    if names is None:
        return [name] if size == 1 else [f"{name}.{k}" for k in range(size)]
    if not isinstance(names, list) or len(names) != size:
        got = f"{len(names)}" if isinstance(names, list) else "no list"
        raise LogError(f"{INFO} needs a name for each of the {size} components of '{name}', or null; it has {got}.")
    count = Counter(map(str, names))
    return [f"{name}.{one}.{k}" if count[str(one)] > 1 else f"{name}.{one}" for k, one in enumerate(names)]


def _flat(names: Any) -> Any:
    """Names of components as one list, where they are lists under headings, {"motors": [...]}, or have places."""
    if not isinstance(names, dict):
        return names
    lists = [each for each in names.values() if isinstance(each, list)]
    return [one for each in lists for one in each] if lists else sorted(names, key=names.__getitem__)


def _vectors(column: Any, name: str, size: int) -> np.ndarray:
    """Vectors of a column of lists, or its numbers (N, size)."""
    from pyarrow import compute, types

    if not (types.is_list(column.type) or types.is_large_list(column.type) or types.is_fixed_size_list(column.type)):
        if size > 1:
            raise LogError(
                f"column '{name}' needs vectors of {size} numbers, as {INFO} has them; it has {column.type}."
            )
        return numbers(column)[:, None]
    lengths = numbers(compute.list_value_length(column))
    if (wrong := lengths != size).any():
        frame = int(wrong.argmax())
        raise LogError(
            f"frame {frame} needs {size} numbers in '{name}', as {INFO} has them; it has {lengths[frame]:g}."
        )
    return numbers(compute.list_flatten(column)).reshape(-1, size)
