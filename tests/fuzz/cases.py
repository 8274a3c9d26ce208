"""One case: files and options with a few things wrong, a command that gets them, and how that ends."""

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

from experiments import identify, stream
from experiments.cli import options
from experiments.output import figures
from experiments.runs import workers
from ident.errors import InputError

from .corpus import LOGS, MODELS, PAIR, STREAMED, write_corpus
from .damage import NAMES, Rng, any_of, damaged
from .here import Here
from .undrawn import not_drawn

OURS = tuple(Path(figures.__file__).parents[2] / name for name in ("experiments", "ident", "scenes", "sim", "tests"))
"""Folders whose code is named where a case breaks."""

CLEAN = ("accepted", "refused")
"""How cases should end."""

HANG = 30
"""Seconds of the processor after which a case hangs; the slowest takes a few."""

DRAWN = 40
"""Every so many cases draw their figures, which takes longer than all the rest."""

COMMANDS = (identify, stream)

DRAW = figures.drawn
"""The function that draws them."""


@dataclass(frozen=True)
class Ending:
    """How a case ended.

    Attributes:
        kind: `accepted`, `refused`, `traceback`, `hang`, `foreign` for a library's words in place of ours, or `odd` for
            an exit code without its sentence.
        what: The sentence, or where the code broke.
        story: Everything that there is to know.
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
        maker, command = _Maker(self._corpus, folder, rng, wrong), any_of(rng, COMMANDS)
        arguments = maker.identify() if command is identify else maker.stream()
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
        code: Any = options.run(run, command.parser, arguments)
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
    said = [line.split(": error: ", 1)[1] for line in err.getvalue().splitlines() if ": error: " in line]
    if code == 0 and not said:
        return "accepted", ""
    if code != 2 or len(said) != 1 or len(said[0]) < 10:
        return "odd", f"exit {code} after {len(said)} error lines"
    if refusals and not isinstance(refusals[0], InputError | OSError):
        return "foreign", f"{_place(refusals[0])}: {said[0]}"
    return "refused", said[0]


def _place(error: Exception) -> str:
    """Where in this project an error was raised, or let through."""
    calls = traceback.extract_tb(error.__traceback__)
    last = [call for call in calls if any(Path(call.filename).is_relative_to(folder) for folder in OURS)][-1]
    return f"{type(error).__name__} under {Path(last.filename).name}:{last.name}"


def _hang(*_: object) -> None:
    raise Hang


@dataclass(frozen=True, eq=False)
class _Maker:
    """Makes the arguments of one case, in which one or two things are wrong: `model`, `log`, `columns` or `options`."""

    corpus: Path
    folder: Path
    rng: Rng
    wrong: frozenset[str]

    def identify(self) -> list[str]:
        """Arguments of `identify`."""
        name = any_of(self.rng, list(MODELS))
        mapping = self.file("columns", f"{name}.toml")
        files = [
            self.file("model", any_of(self.rng, MODELS[name])),
            self.log(name),
        ]
        right = {
            "--base": ["base"],
            "--columns": [mapping],
            "--cutoff": ["auto", "20"],
            "--holdout": ["0.4", "0.05"],
            "--held-out": [self.file("log", f"{name}.csv", "other.csv")],
            "--no-offsets": [],
            "--estimator": ["ordinary", "weighted", "joint"],
            "--prior": ["auto", "on", "off"],
            "--own": ["offset", "delay"],
        }
        wrong = {
            "--base": ["link1", "link2", "world", "$", ""],
            "--columns": ["absent.toml", files[0], "."],
            "--cutoff": ["0", "nan", "49", "1e-9", "1e9", "x"],
            "--holdout": ["0.9", "2", "nan"],
            "--held-out": [files[0], files[1], "absent.csv", "."],
            "--drive": ["viscous", "coulomb", "rotor", "stribeck", "x"],
            "--ignore": ["grip", "x", "$"],
            "--name": ["..", "a/b", "", "$", "\u202e", "x" * 300],
        }
        always = ("--base", "--columns") if "columns" in self.wrong or name == "pad" else ("--base",)
        return [*files, *self.options(right, wrong, always)]

    def stream(self) -> list[str]:
        """Arguments of `stream`."""
        name, number = any_of(self.rng, list(MODELS)), int(any_of(self.rng, (1, 1, 2)))
        files = [self.file("model", any_of(self.rng, MODELS[name]))]
        files += [self.file("log", f"{name}.{any_of(self.rng, STREAMED)}") for _ in range(number)]
        right = {"--base": ["base"], "--contact": ["contact"], "--piece": ["7", "50", "100000"]}
        wrong = {
            "--base": ["link1", "link2", "$", ""],
            "--columns": [self.file("columns", f"{name}.toml"), "absent.toml", files[0], "."],
            "--contact": ["ground", "x", "$"],
            "--without": ["contact", "x"],
            "--ignore": ["grip", "$"],
            "--piece": ["0", "x", "1"],
        }
        return [*files, *self.options(right, wrong, ("--base", *(["--contact"] if name == "pad" else [])))]

    def log(self, name: str) -> str:
        """A log in any of the formats, perhaps in two files."""
        ending = any_of(self.rng, LOGS)
        names = [file.format(name) for file in PAIR] if ending == "pair" else [f"{name}.{ending}"]
        return "+".join(self.file("log", each) for each in names)

    def file(self, what: str, name: str, new: str | None = None) -> str:
        """A copy of a file of the corpus, damaged if it is to be wrong; now and then it has a strange name then."""
        data, path = (self.corpus / name).read_bytes(), self.folder / (new or name)
        if what in self.wrong:
            for _ in range(int(any_of(self.rng, (1, 1, 1, 2, 3)))):
                data = damaged(data, path.suffix, self.rng) or b" "
            if self.rng.random() < 0.05:
                strange = any_of(self.rng, [n for n in NAMES if "/" not in n and "\0" not in n])
                path = path.with_name(f"{strange[:20]}{path.suffix}")
        path.write_bytes(data)
        return str(path)

    def options(self, right: dict[str, list[str]], wrong: dict[str, list[str]], always: Sequence[str]) -> list[str]:
        """Some options with right values, or one of them, if options are to be wrong, with a wrong one."""
        chosen = {option: right[option] for option in right if option in always or self.rng.random() < 0.15}
        if "options" in self.wrong:
            option = any_of(self.rng, list(wrong))
            chosen[option] = wrong[option]
        pairs = ([option, *([any_of(self.rng, values)] if values else [])] for option, values in chosen.items())
        return [argument for pair in pairs for argument in pair]
