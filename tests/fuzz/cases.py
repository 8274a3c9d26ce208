"""One case: files and options with a few errors, a command that gets them, and its ending."""

import argparse
import os
import shutil
import signal
import tempfile
import traceback
import warnings
from collections.abc import Sequence
from contextlib import ExitStack, redirect_stderr, redirect_stdout
from dataclasses import dataclass
from io import StringIO
from pathlib import Path
from types import ModuleType
from typing import Any
from unittest import mock

import numpy as np

from experiments import angles, compare, excite, human, identify, payload
from experiments.cli import running
from experiments.document import figures
from experiments.runs import workers
from ident.errors import InputError

from .corpus import write_corpus
from .damage import any_of
from .here import Here
from .maker import Maker
from .undrawn import not_drawn

OURS = tuple(Path(figures.__file__).parents[2] / name for name in ("experiments", "ident", "scenes", "sim", "tests"))
"""Folders of the project's code, in which the place of an error is named."""

CLEAN = ("accepted", "refused")
"""The acceptable endings."""

HANG = 30
"""Processor time in s after which a case counts as hanging; the slowest takes a few."""

DRAWN = 40
"""One of so many cases draws its figures, which takes longer than all the rest."""

COMMANDS = (identify, identify, compare, angles, payload, human, excite)
"""The commands, some more often than others."""

ARGUMENTS = {
    angles: Maker.angles,
    compare: Maker.compare,
    excite: Maker.excite,
    human: Maker.human,
    identify: Maker.identify,
    payload: Maker.payload,
}
"""Makers of the arguments of each."""

DRAW = figures.drawn
"""The function that draws figures."""


@dataclass(frozen=True)
class Ending:
    """Ending of a case.

    Attributes:
        kind: `accepted`, `refused`, `traceback`, `hang`, `foreign` for a library's words in place of ours, or `odd` for
            an exit code without its sentence.
        what: The sentence, or the place of the error.
        story: Full description.
    """

    kind: str
    what: str
    story: str


class Hang(BaseException):
    """A case took too long."""


class Runner:
    """Runs cases in a folder of its own.

    Attributes:
        seed: Seed of all cases.
    """

    def __init__(self, seed: int) -> None:
        self.seed = seed

    def __enter__(self) -> "Runner":
        with ExitStack() as stack:
            self._folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="fuzz-")))
            self._corpus = self._folder / "corpus"
            self._corpus.mkdir()
            write_corpus(self._corpus)
            before = Path.cwd()
            # MuJoCo logs warnings into the working directory.
            os.chdir(self._folder)
            stack.callback(os.chdir, before)
            stack.enter_context(mock.patch.object(workers, "Processes", Here))
            stack.callback(signal.signal, signal.SIGPROF, signal.signal(signal.SIGPROF, _hang))
            self._open = stack.pop_all()
        return self

    def __exit__(self, *exception: object) -> None:
        self._open.close()

    def run(self, case: int) -> Ending:
        """Makes and runs one case."""
        rng = np.random.default_rng((self.seed, case))
        folder = self._folder / "case"
        shutil.rmtree(folder, ignore_errors=True)
        folder.mkdir()
        wrong = frozenset(
            any_of(rng, ("model", "log", "log", "columns", "options")) for _ in range(any_of(rng, (1, 1, 1, 2)))
        )
        maker, command = Maker(self._corpus, folder, rng, wrong), any_of(rng, COMMANDS)
        arguments = ARGUMENTS[command](maker)
        arguments += ["--out", str(folder / "out")]
        draw = DRAW if case % DRAWN == 0 else not_drawn
        out, err = StringIO(), StringIO()
        with (
            mock.patch.object(figures, "drawn", draw),
            warnings.catch_warnings(),
            redirect_stdout(out),
            redirect_stderr(err),
        ):
            warnings.simplefilter("ignore")
            kind, what = _ending(command, arguments, err)
        story = [f"{command.__name__} {' '.join(arguments)}", out.getvalue(), err.getvalue(), f"{kind}: {what}"]
        return Ending(kind, what, "\n".join(filter(None, story)))


def _ending(command: ModuleType, arguments: Sequence[str], err: StringIO) -> tuple[str, str]:
    refusals: list[Exception] = []

    def run(args: argparse.Namespace) -> None:
        try:
            command.run(args)
        except Exception as error:
            refusals.append(error)
            raise

    signal.setitimer(signal.ITIMER_PROF, HANG)
    try:
        code: Any = running.run(run, command.parser, arguments)
    except SystemExit as stop:
        code = stop.code
    except Hang:
        return "hang", f"{command.__name__}: longer than {HANG} s"
    except Exception as error:
        err.write(traceback.format_exc())
        return "traceback", _place(error)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    if code == 130:
        raise KeyboardInterrupt
    messages = [line.split(": error: ", 1)[1] for line in err.getvalue().splitlines() if ": error: " in line]
    if code == 0 and not messages:
        return "accepted", ""
    if code != 2 or len(messages) != 1 or len(messages[0]) < 10:
        return "odd", f"exit {code} after {len(messages)} error lines"
    if refusals and not isinstance(refusals[0], InputError | OSError):
        return "foreign", f"{_place(refusals[0])}: {messages[0]}"
    return "refused", messages[0]


def _place(error: Exception) -> str:
    """Place in this project at which an error was raised, or passed through."""
    calls = traceback.extract_tb(error.__traceback__)
    last = [call for call in calls if any(Path(call.filename).is_relative_to(folder) for folder in OURS)][-1]
    return f"{type(error).__name__} under {Path(last.filename).name}:{last.name}"


def _hang(*_: object) -> None:
    raise Hang
