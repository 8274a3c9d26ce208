"""Assignment of bodies to the segments of a person, from a mapping file."""

from pathlib import Path
from typing import Any

from ident.errors import LogError
from ident.files.table import short
from ident.parameters.person import Placed
from ident.recordings.columns.entries import check_keys, table, toml, vector
from ident.recordings.columns.external_loads import LOADS


def read_segments(path: Path) -> dict[str, Placed] | None:
    """Segments of a person by body, from `[segments]` of a mapping file; None if it has no such table.

    Raises:
        LogError: The file is missing or malformed.
    """
    if path.suffix.lower() == LOADS:
        return None
    entries = toml(path)
    try:
        return segments_of(entries["segments"]) if "segments" in entries else None
    except LogError as error:
        raise LogError(f"{path}: {error}") from None


def segments_of(entries: Any) -> dict[str, Placed]:
    """Segments by body, from entries `BODY = "SEGMENT"` or tables with the segment and its ends."""
    out = {}
    for body, entry in table("segments", entries).items():
        where = f"segments.{body}"
        given = {"segment": entry} if isinstance(entry, str) else table(where, entry)
        check_keys(where, given, ("segment", "proximal", "distal"))
        if not isinstance(given.get("segment"), str):
            raise LogError(f"{where} needs the name of a segment, got {short(given.get('segment'))}.")
        ends = (vector(f"{where}.{end}", given[end], 3) if end in given else None for end in ("proximal", "distal"))
        out[body] = Placed(given["segment"], *ends)
    return out
