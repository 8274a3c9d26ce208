"""Runs everything: the mechanism, both studies, several contacts at once, and a person; and writes one page of all."""

import argparse
from collections.abc import Callable
from functools import partial

from experiments import human, mechanism, misaligned, multicontact
from experiments.cli import options, print_options

PERSON = ("--seconds", "3")
"""Options of the study of a person: long enough to predict all channels of unseen motions at least three times better
than the prior, with and without a rail to hold (`docs/human.md`), and short enough to take a minute or two.
"""


def run(args: argparse.Namespace) -> None:
    """Runs every study with its defaults, into folders of their own."""
    from experiments.document.index import write_index
    from experiments.document.results import Results
    from experiments.reports import human_report, study_report
    from experiments.studies import mechanism as drawn
    from experiments.studies.study_entries import packaged
    from experiments.studies.trials import FILE

    # The page embeds the figures as PNG.
    formats = list(dict.fromkeys(["png", *args.formats]))
    trials = ["--trials", str(args.trials), "--workers", str(args.workers), "--redraw", args.redraw]
    trials += ["--trajectory-trials", str(args.trajectory_trials)]
    trials += ["--scheduler", args.scheduler] if args.scheduler else []
    trials += ["--tls", *args.tls] if args.tls else []
    studies: dict[str, tuple[Callable[[argparse.Namespace], Results], options.MakeParser, list[str]]] = {
        "mechanism": (drawn.run, mechanism.parser, [])
    }
    for name in ("misaligned", "multicontact", "several_contacts"):
        make_parser = misaligned.parser if name == "misaligned" else multicontact.parser
        studies[name] = partial(study_report.run, file=packaged(name)), make_parser, trials
    studies["human"] = human_report.run, human.parser, [*PERSON, "--workers", str(args.workers)]
    results = {}
    for folder, (study, make_parser, more) in studies.items():
        out = args.out / folder
        # A study that the interrupted run had not begun starts from the beginning.
        resume = ["--resume"] if args.resume and (out / FILE).exists() else []
        page = ["--page-columns", str(args.page_columns), *(["--style", str(args.style)] if args.style else [])]
        given = ["--out", str(out), "--formats", *formats, *page, *more, *resume]
        results[folder] = study(make_parser().parse_args(given))
        print()
    write_index(args.out, results, formats)
    print(f"Everything on one page: {args.out / 'index.html'}")


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.command_parser("", __doc__)
    options.add_formats(out)
    print_options.add_page(out)
    options.add_trials(out)
    return out


main = options.main(__name__, run, parser)
