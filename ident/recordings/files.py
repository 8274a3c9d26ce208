"""Files of recordings, written and read as tables by what their names end in."""

import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ident.errors import LogError
from ident.recordings.atomic import replacing
from ident.recordings.csv_file import csv_pieces, write_csv
from ident.recordings.npz import LIMIT
from ident.recordings.npz_file import npz_pieces, write_npz
from ident.recordings.table import Table


def write_channels(path: Path, channels: Mapping[str, np.ndarray], metadata: Mapping[str, Any]) -> None:
    """Writes a `.npz` or `.csv` file; arguments as for `write_csv`.

    Raises:
        LogError: The name ends in neither.
    """
    writers = {".npz": write_npz, ".csv": write_csv}
    if path.suffix not in writers:
        raise LogError(f"A recording is saved as .npz or .csv, got '{path.name}'.")
    with replacing(path) as temporary:
        writers[path.suffix](temporary, channels, metadata)


def read_tables(
    path: Path, samples: int = sys.maxsize, *, overlap: int = 0, truth: bool = False, limit: int = LIMIT
) -> Iterator[Table]:
    """Reads a file piece by piece, so that one that is larger than memory can be read.

    Args:
        path: A `.csv`, `.tsv`, `.txt` or `.npz` file.
        samples: Samples of each piece, of the last one perhaps fewer.
        overlap: How many of them each piece begins with again, besides.
        truth: Whether an archive's true values are read as well.
        limit: Bytes that a piece of an archive may take in memory, as for `npz.check_size`.

    Raises:
        LogError: The file is missing or malformed; a fault is found when its piece is due.
    """
    suffix = path.suffix.lower()
    if suffix not in (".csv", ".txt", ".tsv", ".npz") or not path.is_file():
        raise LogError("a log is a .csv, .tsv, .txt or .npz file that exists.")
    if suffix == ".npz":
        return npz_pieces(path, samples, overlap=overlap, truth=truth, limit=limit)
    return csv_pieces(path, samples, overlap=overlap)
