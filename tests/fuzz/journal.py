"""How every case ended, kept in a file from case to case."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .cases import CLEAN, Ending


class Journal:
    """A line of JSON when a case begins and one when it has ended.

    Attributes:
        endings: What is known of each case that need not run again; one that began and never ended took its process
            with it.
    """

    def __init__(self, file: Path) -> None:
        file.parent.mkdir(parents=True, exist_ok=True)
        self.file, self.endings = file, dict[int, dict[str, Any]]()
        file.touch()
        lines = file.read_text(encoding="utf-8").splitlines(keepends=True)
        # The last line of a process that was killed may not be whole.
        file.write_text("".join(line for line in lines if line.endswith("\n")), encoding="utf-8")
        for line in file.read_text(encoding="utf-8").splitlines():
            found = json.loads(line)
            self.endings[found["case"]] = found
        # What was unclean may have been mended; what took the process with it would do so again.
        self.endings = {k: found for k, found in self.endings.items() if found["ending"] in (*CLEAN, "died")}

    @contextmanager
    def entry(self, case: int) -> Iterator[Callable[[Ending], None]]:
        """Takes down that a case begins, and what the block notes of its end; forgets it if the user interrupts."""
        with self.file.open("a", encoding="utf-8") as lines:
            before = lines.tell()
            lines.write(json.dumps({"case": case, "ending": "died", "what": "the process died"}) + "\n")
            lines.flush()

            def note(ending: Ending) -> None:
                self.endings[case] = {"case": case, "ending": ending.kind, "what": ending.what}
                lines.write(json.dumps(self.endings[case]) + "\n")

            try:
                yield note
            except KeyboardInterrupt:
                lines.truncate(before)
                raise
