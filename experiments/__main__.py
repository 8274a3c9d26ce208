"""Runs everything: the mechanism, both studies, that of contacts also with several at once, and a page of them all."""

import argparse
from typing import Any

import scenes
from experiments import mechanism, misaligned, multicontact
from experiments.cli import options


def run(args: argparse.Namespace) -> None:
    """Runs every study with its defaults, into folders of their own."""
    from experiments.output.index import write_index
    from experiments.studies.trials import FILE

    # The page embeds the figures as PNG.
    formats = ["--formats", *dict.fromkeys(["png", *args.formats])]
    trials = ["--trials", str(args.trials), "--workers", str(args.workers), "--redraw", args.redraw]
    trials += ["--scheduler", args.scheduler] if args.scheduler else []
    trials += ["--tls", *args.tls] if args.tls else []
    studies: tuple[tuple[str, Any, list[str]], ...] = (
        ("mechanism", mechanism, []),
        ("misaligned", misaligned, trials),
        ("multicontact", multicontact, trials),
        ("several_contacts", multicontact, [*trials, "--contact", *scenes.CONTACTS]),
    )
    for folder, study, more in studies:
        out = args.out / folder
        # A study that the interrupted run had not reached starts from the beginning.
        resume = ["--resume"] if more and args.resume and (out / FILE).exists() else []
        study.run(study.parser().parse_args(["--out", str(out), *formats, *more, *resume]))
        print()
    write_index(args.out)
    print(f"Everything on one page: {args.out / 'index.html'}")


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.output_parser("", __doc__)
    options.add_trials(out)
    return out


main = options.main(__name__, run, parser)
