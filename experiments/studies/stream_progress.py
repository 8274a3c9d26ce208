"""Progress of one pass over recordings, saved so that it can be interrupted and resumed without loss."""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from experiments.runs.checkpoint import named
from ident.errors import InputError
from ident.estimation.accumulator import Accumulator
from ident.estimation.equations import Equations
from ident.files import npz
from ident.files.atomic import save_arrays
from ident.files.limits import parsed_json

FILE = "accumulated.npz"
"""File in the output folder with the progress."""


@dataclass(frozen=True, eq=False)
class Progress:
    """Progress over the pieces read so far, saved in a file.

    Attributes:
        file: The file.
        identity: Settings that determine the result, in JSON types.
        accumulator: Accumulator of the pieces; None before the first.
        done: Number of pieces.
    """

    file: Path
    identity: Mapping[str, Any]
    accumulator: Accumulator | None = None
    done: int = 0

    def resumed(self, equations: Equations) -> "Progress":
        """The progress of an earlier run on these equations.

        Raises:
            InputError: There is none, or it belongs to another run.
        """
        try:
            fields: dict[str, Any] = npz.arrays(self.file)
            kept, done = parsed_json(str(fields.pop("identity"))), int(fields.pop("done"))
            if fields.keys() != Accumulator.__dataclass_fields__.keys():
                raise InputError("another version of this package wrote it")
            accumulator = Accumulator(**fields)
            different = [named(key, kept.get(key), x) for key, x in self.identity.items() if kept.get(key) != x]
            columns = (len(equations.names) + 1,) * 2
            whole = (accumulator.factor.shape, accumulator.grams.shape) == (columns, (6, *columns)) and done > 0
            whole = whole and bool(np.isfinite([*accumulator.factor, *accumulator.gram]).all())
            if not different and not (whole and accumulator.names == equations.names):
                raise InputError("damaged")
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise InputError(f"--resume needs what an earlier run left in {self.file} ({error}).") from None
        if different:
            raise InputError(f"{self.file} is of another run: {', '.join(different)} differ; leave out --resume.")
        return Progress(self.file, self.identity, accumulator, done)

    def and_piece(self, part: Accumulator) -> "Progress":
        """The progress with one more piece."""
        accumulator = part if self.accumulator is None else self.accumulator + part
        return Progress(self.file, self.identity, accumulator, self.done + 1)

    def save(self) -> None:
        """Writes the file."""
        save_arrays(self.file, {"identity": json.dumps(self.identity), "done": self.done, **vars(self.accumulator)})
