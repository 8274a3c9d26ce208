"""Beginning and end of a command: bad input as one sentence, interruption, and notes on models."""

import argparse
import io
import os
import shlex
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from functools import partial
from pathlib import Path
from typing import Any

import ident
from experiments.cli import options
from experiments.runs import ENDING, GRACE, default_variables, ended_after, environment, seldom_collected
from ident.errors import InputError

Study = Callable[[argparse.Namespace], None]
MakeParser = Callable[[], argparse.ArgumentParser]
Main = Callable[[Sequence[str] | None], int]


def command(
    module: str, name: str, description: str | None, study: Study, rows: options.Options, epilog: str = ""
) -> tuple[MakeParser, Main]:
    """Parser and entry point of the command in the module of that `__name__`; run as a script, it starts at once.

    Args:
        module: `__name__` of the module.
        name: The module's name, as for `python -m`.
        description: Description for `--help`.
        study: What the command does with its parsed options.
        rows: Its options.
        epilog: Text below the help.
    """
    make_parser = partial(options.parser, name, description, rows, epilog)
    entry = partial(run, study, make_parser)
    if module == "__main__":
        seldom_collected()
        sys.exit(entry())
    return make_parser, entry


def run(study: Study, make_parser: MakeParser, argv: Sequence[str] | None = None) -> int:
    """Runs a study and turns bad input into one sentence; other errors carry a request to report them.

    Args:
        study: The study, given the parsed options.
        make_parser: Makes its parser.
        argv: Arguments, by default the command line's.

    Returns:
        Exit code: 0, 2 for bad input, 130 when interrupted, or 141 when what read the output, as `head`, has ended.
    """
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")
    if sys.stdout is None:  # It was closed.
        sys.stdout = Path(os.devnull).open("w", encoding="utf-8")  # noqa: SIM115
    code = 0
    try:
        try:
            code = _run(study, make_parser(), argv)
        finally:
            sys.stdout.flush()
    except BrokenPipeError:
        # What is left in the buffer would be a second error at the end of the process.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        code = code or 141
    return code


def _run(study: Study, parser: argparse.ArgumentParser, argv: Sequence[str] | None) -> int:
    """Runs a study and returns the exit code, as for `run`, but raises an error for a closed output."""
    given = parser.parse_args(argv)
    variables = environment(default_variables())
    interrupted = f"{parser.prog}: interrupted; every file is whole."
    with variables, _interruptible_once(interrupted) as asked, _notes_printed_once():
        try:
            with _without_log(), _its_consequences(asked):
                study(given)
        except BrokenPipeError:
            raise
        except (InputError, OSError, MemoryError) as error:
            text: object = error
            if isinstance(error, OSError) and error.filename and error.strerror:
                text = f"{error.filename}: {error.strerror}."
            print(f"{parser.prog}: error: {text}", file=sys.stderr)
            return 2
        except KeyboardInterrupt:
            print(interrupted, file=sys.stderr)
            return 130
        except Exception as error:
            error.add_note(_request(f"{parser.prog} {shlex.join(sys.argv[1:] if argv is None else argv)}"))
            raise
    return 0


def _request(command: str) -> str:
    """Request to report an error that no input should cause, printed below its traceback."""
    return (
        "This is a fault of multicontact, not of what it was given: please report it in the project's issue tracker, "
        f"with all of the above, version {ident.__version__} and the command: {command}"
    )


@contextmanager
def _without_log() -> Iterator[None]:
    """Removes the file of MuJoCo's warnings from the working directory, unless it was there before the block."""
    log = Path("MUJOCO_LOG.TXT").absolute()
    before = log.exists()
    try:
        yield
    finally:
        if not before:
            with suppress(OSError):
                log.unlink(missing_ok=True)


@contextmanager
def _notes_printed_once() -> Iterator[None]:
    """Prints notes on models once each, as models are read several times."""
    from sim.models.notes import ModelNote

    printed: set[str] = set()
    with warnings.catch_warnings():
        warnings.simplefilter("always", ModelNote)
        others = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *where: Any, **more: Any) -> None:
            if not issubclass(category, ModelNote):
                others(message, category, *where, **more)
            elif str(message) not in printed:
                printed.add(str(message))
                print(f"Note: {message}", file=sys.stderr)

        warnings.showwarning = show
        yield


@contextmanager
def _interruptible_once(message: str) -> Iterator[threading.Event]:
    """Makes the first Ctrl-C or request to terminate end a block, and ignores others within `GRACE`.

    It may take a moment to clean up; one that comes later ends what went on nevertheless, such as the report of an
    interrupted estimate. Yields an event that the first one sets. If the block goes on for `GRACE` after a request to
    terminate, the process prints the message and ends.
    """
    asked, last = threading.Event(), -GRACE
    if threading.current_thread() is not threading.main_thread():
        yield asked
        return

    def interrupt(*_: object) -> None:
        nonlocal last
        asked.set()
        if time.monotonic() - last >= GRACE:
            last = time.monotonic()
            raise KeyboardInterrupt

    before = [signal.signal(number, interrupt) for number in ENDING]
    try:
        with ended_after(GRACE, message):
            yield asked
    finally:
        for number, handler in zip(ENDING, before, strict=True):
            signal.signal(number, handler)


@contextmanager
def _its_consequences(asked: threading.Event) -> Iterator[None]:
    """Treats an error after a request to end as that request.

    If interrupted between releasing a lock and acquiring it again, Python's threading raises an error about the lock.
    """
    try:
        yield
    except Exception as error:
        if asked.is_set():
            raise KeyboardInterrupt from error
        raise
