"""Assignment of bodies to the segments of a person, from a mapping file."""

from pathlib import Path
from typing import Any

from ident.errors import LogError
from ident.files.entries import made, table
from ident.files.limits import toml
from ident.parameters.person import Placed
from ident.recordings.columns.external_loads import LOADS


def read_segments(path: Path) -> dict[str, Placed] | None:
    """Segments of a person by body, from `[segments]` of a mapping file; None if it has no such table.

    Raises:
        LogError: The file is missing or malformed.
    """
    if path.suffix.lower() == LOADS:
        return None
    entries = toml(path, "a mapping of columns needs", LogError)
    try:
        return segments_of(entries["segments"]) if "segments" in entries else None
    except LogError as error:
        raise LogError(f"{path}: {error}") from None


def segments_of(entries: Any) -> dict[str, Placed]:
    """Segments by body, from entries `BODY = "SEGMENT"` or tables with the segment and its ends."""
    given = {body: {"segment": x} if isinstance(x, str) else x for body, x in table("segments", entries).items()}
    return {body: made(Placed, f"segments.{body}", entry) for body, entry in given.items()}
