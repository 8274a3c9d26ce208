"""Endings of all cases, saved in a file after each case."""

import json
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from .cases import CLEAN, Ending


class Journal:
    """A file with a line of JSON at the beginning and at the end of each case.

    Attributes:
        endings: Endings of cases that need not run again; a case that began and did not end has killed its process.
    """

    def __init__(self, file: Path) -> None:
        file.parent.mkdir(parents=True, exist_ok=True)
        self.file, self.endings = file, dict[int, dict[str, Any]]()
        file.touch()
        lines = file.read_text(encoding="utf-8").splitlines(keepends=True)
        # The last line of a killed process may be incomplete.
        file.write_text("".join(line for line in lines if line.endswith("\n")), encoding="utf-8")
        for line in file.read_text(encoding="utf-8").splitlines():
            entry = json.loads(line)
            self.endings[entry["case"]] = entry
        # Failures may have been fixed, and run again; a case that killed its process would do so again.
        self.endings = {k: entry for k, entry in self.endings.items() if entry["ending"] in (*CLEAN, "died")}

    @contextmanager
    def entry(self, case: int) -> Iterator[Callable[[Ending], None]]:
        """Records that a case begins, and the ending that the block states; forgets it if the user interrupts."""
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
