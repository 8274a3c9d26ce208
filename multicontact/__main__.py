# PYTHON_ARGCOMPLETE_OK
"""The command `multicontact`, also as `python -m multicontact`: `multicontact NAME` is `python -m experiments.NAME`."""

import argparse
import importlib.metadata
import os
import re
import sys
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import NoReturn

# A folder named experiments where Python was started would come first.
sys.path.insert(0, str(Path(__file__).resolve().parents[1]))

import experiments.__main__
from experiments.cli import running
from experiments.runs import seldom_collected
from ident.arguments import near

NAMES = (
    *("mechanism", "misaligned", "multicontact", "study", "human", "sweep", "angles", "columns", "identify"),
    *("batch", "compare", "payload", "stream", "excite", "derive", "validate"),
)
COMMANDS = {"paper": experiments.__main__} | {name: import_module(f"experiments.{name}") for name in NAMES}
"""Modules of the subcommands."""


class _Commands(argparse.ArgumentParser):
    """A parser of subcommands that names those which a misspelt one is near."""

    def error(self, message: str) -> NoReturn:
        """Ends with one sentence and exit code 2."""
        if wrong := re.match(r"argument COMMAND: invalid choice: '(.*?)'", message):
            message = f"there is no command '{wrong[1]}'; {near(wrong[1], COMMANDS, len(COMMANDS))}"
        super().error(message)


def run(args: argparse.Namespace) -> None:
    """Runs the chosen subcommand."""
    vars(args).pop("run")(args)


def parser() -> argparse.ArgumentParser:
    """Command-line options of all subcommands."""
    package = importlib.metadata.metadata("multicontact")
    out = _Commands("multicontact", description=package["Summary"])
    out.add_argument("--version", action="version", version=f"%(prog)s {package['Version']}")
    commands = out.add_subparsers(metavar="COMMAND", required=True, parser_class=argparse.ArgumentParser)
    for name, module in COMMANDS.items():
        one = module.parser()
        commands.add_parser(
            name,
            parents=[one],
            add_help=False,
            help=str(one.description).partition("\n")[0],
            description=one.description,
            epilog=one.epilog,
            formatter_class=one.formatter_class,
        ).set_defaults(run=module.run)
    return out


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    if "_ARGCOMPLETE" in os.environ:
        import argcomplete

        argcomplete.autocomplete(parser())
    if argv is None:
        # Python that calls this keeps its own collection: each of its figures is 15 MB of cycles.
        seldom_collected()
    return running.run(run, parser, argv)


if __name__ == "__main__":
    sys.exit(main())
