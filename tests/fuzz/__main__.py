"""Runs commands on damaged input in one process, and counts how the cases end, which are the same for the same seed."""

import argparse
import faulthandler
import shutil
import signal
import sys
import tempfile
import traceback
import warnings
from collections import Counter
from contextlib import ExitStack, chdir, contextmanager, redirect_stderr, redirect_stdout
from io import StringIO
from pathlib import Path
from unittest import mock

import numpy as np
from stand_ins import Here, not_drawn
from tqdm import trange

from experiments.cli import running
from experiments.document import figures
from experiments.runs import workers
from ident.errors import InputError

from . import commands
from .damage import NAMES, any_of, damaged

STUCK = 600  # Seconds after which a case is ended together with the process: Python cannot interrupt every library.
HANG = 30  # Processor time in s after which a case counts as hanging; the slowest takes a few.
DRAWN = 40  # One of so many cases draws its figures, which takes longer than all the rest.
CLEAN = ("accepted", "refused")
"""Acceptable endings; others are `traceback`, `hang`, `foreign` for a library's words, `odd` for a bare exit code."""

ROOT = Path(__file__).parents[2]


class Hang(BaseException):
    """A case took too long."""


def hang(*_):
    """Ends a case."""
    raise Hang


@contextmanager
def runner(seed):
    """Function that runs case k: the kind of its ending, the sentence or the place of the error, and all its output."""
    with ExitStack() as stack:
        name = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="fuzz-")))
        stack.enter_context(mock.patch.object(workers, "Processes", Here))
        # MuJoCo logs warnings into the working directory.
        stack.enter_context(chdir(name))
        stack.enter_context(warnings.catch_warnings(action="ignore"))
        stack.callback(signal.signal, signal.SIGPROF, signal.signal(signal.SIGPROF, hang))
        corpus, folder = name / "corpus", name / "case"
        corpus.mkdir()
        commands.write_corpus(corpus)

        def run(case):
            shutil.rmtree(folder, ignore_errors=True)
            rng = np.random.default_rng((seed, case))
            command = any_of(rng, commands.COMMANDS)
            arguments = [*arguments_of(command, corpus, folder, rng), "--out", str(folder / "out")]
            draw = figures.drawn if case % DRAWN == 0 else not_drawn
            drawing, out, err = mock.patch.object(figures, "drawn", draw), StringIO(), StringIO()
            with drawing, redirect_stdout(out), redirect_stderr(err):
                kind, what = ending(command.module, arguments, err)
            story = [f"{command.module.__name__} {' '.join(arguments)}", out.getvalue(), err.getvalue()]
            return kind, what, "\n".join(filter(None, [*story, f"{kind}: {what}"]))

        yield run


def arguments_of(command, corpus, folder, rng):
    """Arguments of one case with one or two kinds of errors, whose files are written into its folder."""
    kinds = ("model", "log", "log", "columns", "options")
    wrong = {any_of(rng, kinds) for _ in range(any_of(rng, (1, 1, 1, 2)))}

    def file(kind, name):
        """A copy of a file, damaged if it is to have an error; sometimes with a strange name then."""
        data, path = (corpus / name).read_bytes(), folder / name
        if kind in wrong:
            for _ in range(any_of(rng, (1, 1, 1, 2, 3))):
                data = damaged(data, path.suffix, rng) or b" "
            if rng.random() < 0.05:
                path = path.with_name(any_of(rng, [n for n in NAMES if not {*n} & {*"/\0"}])[:20] + path.suffix)
        path.write_bytes(data)
        return str(path)

    folder.mkdir()
    files = ["+".join(file(kind, each) for each in any_of(rng, names).split("+")) for kind, names in command.files]
    given, chosen = files.copy(), {}
    for option, values in command.right.items():
        needed = option in command.always or ("columns" in wrong and "@columns" in "".join(values))
        if needed or rng.random() < 0.15:
            chosen[option] = values
    if "options" in wrong:
        option = any_of(rng, list(command.wrong))
        chosen[option] = command.wrong[option]
    for option, values in chosen.items():
        given.append(option)
        value = any_of(rng, values) if values else None
        if value is not None:
            given.append(files[0] if value == "@" else file(*value[1:].split()) if value[:1] == "@" else value)
    return given


def ending(module, arguments, err):
    """Kind of a command's ending, and the sentence or the place of the error."""
    refusals = []

    def run(args):
        try:
            module.run(args)
        except Exception as error:
            refusals.append(error)
            raise

    signal.setitimer(signal.ITIMER_PROF, HANG)
    try:
        code = running.run(run, module.parser, arguments)
    except SystemExit as stop:
        code = stop.code
    except Hang:
        return "hang", f"{module.__name__}: longer than {HANG} s"
    except Exception as error:
        err.write(traceback.format_exc())
        return "traceback", place(error)
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
        return "foreign", f"{place(refusals[0])}: {messages[0]}"
    return "refused", messages[0]


def place(error):
    """Place in this project at which an error was raised, or passed through."""
    calls = traceback.extract_tb(error.__traceback__)
    ours = [call for call in calls if Path(call.filename).is_relative_to(ROOT) and ".venv" not in call.filename]
    return f"{type(error).__name__} under {Path(ours[-1].filename).name}:{ours[-1].name}"


def main(argv=None):
    """Entry point; returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--cases", type=int, default=1000, help="number of cases")
    parser.add_argument("--seed", type=int, default=0, help="seed of all cases")
    parser.add_argument("--only", type=int, metavar="K", help="run case K alone and show what it prints")
    options = parser.parse_args(argv)
    counts = Counter()
    with runner(options.seed) as run:
        if options.only is not None:
            print(run(options.only)[2])
            return 0
        for k in trange(options.cases, desc="Cases"):
            faulthandler.dump_traceback_later(STUCK, exit=True, file=sys.__stderr__)
            kind, what, _ = run(k)
            faulthandler.cancel_dump_traceback_later()
            counts[kind] += 1
            if kind not in CLEAN:
                print(f"{kind}: {what} (case {k})", flush=True)
    print(", ".join(f"{count} {kind}" for kind, count in counts.most_common()))
    return 0 if counts.keys() <= {*CLEAN} else 1


if __name__ == "__main__":
    sys.exit(main())
