"""Text files in UTF-8 or UTF-16, perhaps packed by gzip, with a limit on the unpacked size."""

import codecs
import gzip
import io
import zlib
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import count
from pathlib import Path

from ident.errors import LogError
from ident.files.limits import LIMIT, LONGEST, check_size


class _Counted(io.RawIOBase):
    """Bytes of a packed file, counted since the last piece began."""

    def __init__(self, stream: gzip.GzipFile, path: Path, limit: int) -> None:
        self.stream, self.path, self.limit, self.count = stream, path, limit, 0

    def readable(self) -> bool:
        return True

    def readinto(self, buffer: memoryview) -> int:  # type: ignore[override]
        data = self.stream.read(len(buffer))
        buffer[: len(data)] = data
        self.count += len(data)
        check_size(self.path, self.count, self.limit)
        return len(data)


class Text(io.TextIOWrapper):
    """Lines of a text that is read in pieces."""

    path: Path
    limit: int

    def begin_piece(self) -> None:
        """Resets the count of unpacked bytes at the start of a piece."""
        if isinstance(counted := getattr(self.buffer, "raw", None), _Counted):
            counted.count = 0

    def check_size(self, size: int) -> None:
        """Refuses a size in bytes above the limit, as `limits.check_size`."""
        check_size(self.path, size, self.limit)

    def whole_lines(self) -> Iterator[str]:
        """Its lines.

        Raises:
            LogError: One is longer than any row of a log.
        """
        for number in count(1):
            if not (line := self.readline(LONGEST + 1)):
                return
            if len(line) > LONGEST:
                raise LogError(f"row {number} is longer than {LONGEST} characters, which no row of a log is.")
            yield line


@contextmanager
def opened_text(path: Path, limit: int = LIMIT) -> Iterator[Text]:
    """Opens a text file for the duration of a block.

    Args:
        path: The file; one whose name ends in `.gz` is unpacked.
        limit: Bytes that a piece of a packed file may have, as for `check_size`.

    Raises:
        LogError: A packed file is damaged, or too large when unpacked.
    """
    if path.suffix.lower() != ".gz":
        with path.open("rb") as stream:
            yield _text(stream, path, limit)
        return
    try:
        with gzip.open(path) as packed:
            yield _text(io.BufferedReader(_Counted(packed, path, limit)), path, limit)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise LogError(f"the file needs to be packed by gzip, whole and undamaged ({error}).") from None


def _text(buffer: io.BufferedReader, path: Path, limit: int) -> Text:
    utf16 = buffer.peek(2)[:2] in (codecs.BOM_UTF16_LE, codecs.BOM_UTF16_BE)
    text = Text(buffer, encoding="utf-16" if utf16 else "utf-8-sig")
    text.path, text.limit = path, limit
    return text
