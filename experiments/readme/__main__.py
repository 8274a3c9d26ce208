"""Writes the generated parts of README.md and docs, from the root of a checkout: for maintainers."""

import argparse
from pathlib import Path

from experiments.cli import running


def run(args: argparse.Namespace) -> None:
    """Writes the generated parts of the pages, their figures and the benchmark's record."""
    from experiments.readme import blocks

    blocks.write(args.root)


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = argparse.ArgumentParser(prog="python -m experiments.readme", description=__doc__)
    out.add_argument("--root", type=Path, default=Path(), help="root of the checkout")
    return out


main = running.main(__name__, run, parser)
