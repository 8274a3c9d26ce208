"""Outcomes of a long run, saved as they come in, so that it can be interrupted and resumed without loss."""

import json
import sys
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from ident.display.brief import listed
from ident.errors import InputError
from ident.files import npz
from ident.files.atomic import save_arrays
from ident.files.limits import parsed_json

SAVE_EVERY = 5.0
"""Seconds between two saves."""

SHOWN = 3
"""Number of differing files that a message names."""

LISTS = "files", "logs", "recordings"
"""Settings that are lists of files."""


@dataclass(frozen=True, eq=False)
class Checkpoint:
    """File with the outcomes of a run.

    Attributes:
        what: Name of the outcomes, e.g. "trials".
        file: NPZ file with the outcomes, replaced atomically.
        identity: Settings that all outcomes of one run share, in JSON types.
        check: Raises an `InputError` if the outcomes of an earlier run are not as they have to be.
    """

    what: str
    file: Path
    identity: Mapping[str, Any]
    check: Callable[[Sequence[Any]], object] | None = None

    def done(self) -> list[str]:
        """Outcomes of an interrupted run, as JSON.

        Raises:
            InputError: There are none, or they belong to another run.
        """
        try:
            data = npz.arrays(self.file)
            kept, outcomes = parsed_json(str(data["identity"])), bytes(data["outcomes"]).decode().splitlines()
            parsed = [parsed_json(text) for text in outcomes]
            wanted = json.loads(json.dumps(self.identity))
            different = [named(key, kept.get(key), wanted[key]) for key in wanted if kept.get(key) != wanted[key]]
            if self.check is not None and not different:
                self.check(parsed)
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise InputError(f"--resume needs the {self.what} of an earlier run in {self.file} ({error}).") from None
        if different:
            raise InputError(
                f"The {self.what} in {self.file} are of another run: {', '.join(different)} differ; leave out --resume."
            )
        return outcomes

    def set_aside(self) -> None:
        """Renames the file of an earlier run, if there is one."""
        if self.file.exists():
            self.file.replace(self.file.with_stem(f"{self.file.stem}_before"))

    def keep(self) -> None:
        """Saves that nothing is done, if nothing is saved, so that a run that a full disk has ended can be resumed.

        Without room even for that, the file of an earlier run is put back.
        """
        if self.file.exists():
            return
        try:
            self.save([])
        except OSError:
            with suppress(OSError):
                self.file.with_stem(f"{self.file.stem}_before").replace(self.file)
        else:
            print(f"\nNone of the {self.what} is done; once there is room run again with --resume.", file=sys.stderr)

    def collect(self, batches: Iterable[Sequence[str]], total: int, done: Sequence[str] = ()) -> list[str]:
        """Collects outcomes and saves them every few seconds, at the end, and on any error.

        Args:
            batches: Outcomes in order, a few at a time, as JSON.
            total: Number of outcomes to reach.
            done: The first of them, from an interrupted run; without any, an earlier run's file is set aside.

        Raises:
            OSError: They could not be saved; the file has those of the last save.
        """
        if not done:
            self.set_aside()
        outcomes = list(done)
        try:
            try:
                self._take(batches, outcomes, total)
            finally:
                if len(outcomes) > len(done):
                    self.save(outcomes)
        except BaseException:
            if self.file.exists():
                print(f"\nThe {self.what} done so far are in {self.file}; run again with --resume.", file=sys.stderr)
            raise
        return outcomes

    def _take(self, batches: Iterable[Sequence[str]], outcomes: list[str], total: int) -> None:
        saved = time.monotonic()
        title = self.what.capitalize()
        with tqdm(desc=title, total=total, initial=len(outcomes), file=sys.stderr) as bar:
            for batch in batches:
                outcomes.extend(batch)
                bar.update(len(batch))
                if time.monotonic() - saved > SAVE_EVERY:
                    self.save(outcomes)
                    saved = time.monotonic()

    def save(self, outcomes: Sequence[str]) -> None:
        """Writes the file."""
        # As letters of four bytes each, texts of numbers would take ten times the room of these.
        lines = np.frombuffer("\n".join(outcomes).encode(), np.uint8)
        save_arrays(self.file, {"identity": json.dumps(self.identity), "outcomes": lines})


def named(key: str, kept: Any, wanted: Any) -> str:
    """The name of a setting that differs from an earlier run's, with its files that differ if it is a list of such."""
    if key not in LISTS:
        return key
    before = kept if isinstance(kept, list) else []
    files = [name for each in wanted if each not in before for name in _names(each)]
    files = files or [name for each in before if each not in wanted for name in _names(each)]
    return f"{key} ({listed(files, SHOWN)})" if files else key


def _names(entry: Any) -> list[str]:
    """Names of the files in an entry: text, the sum of a file, or those of several."""
    if isinstance(entry, str):
        return [entry]
    files = entry.get("files", [entry]) if isinstance(entry, dict) else []
    return [str(each["file"]) for each in files if isinstance(each, dict) and "file" in each]
