"""Runs everything: the mechanism, both studies, several contacts at once, and a person; and writes one page of all."""

import argparse
from dataclasses import replace

from experiments import human, mechanism, study
from experiments.cli import options, running

PERSON = ["--seconds", "3"]
"""Options of the simulated person: recordings long enough to predict all channels of unseen motions at least three
times better than the prior, with and without a rail (`docs/human.md`), and short enough to take a minute or two."""

STUDIES = ("misaligned", "multicontact", "several_contacts")
"""Simulated studies."""


def run(args: argparse.Namespace) -> None:
    """Runs every study with its defaults, into folders of their own."""
    from experiments.reports.index import write_index
    from experiments.studies.simulation import FILE
    from experiments.studies.study_entries import packaged

    out = options.output_of(args)
    documents = {"mechanism": mechanism.report(replace(out, folder=args.out / "mechanism"))}
    print()
    for name in STUDIES:
        own = replace(out, folder=args.out / name)
        # A study that the interrupted run had not begun starts from the beginning.
        trials = study.trials_of(args)
        resume = args.resume and (own.folder / FILE).exists()
        trials = replace(trials, workers=replace(trials.workers, resume=resume))
        documents[name] = study.report(packaged(name), own, trials)
        print()
    person = human.parser().parse_args([*PERSON, "--workers", str(args.workers)])
    documents["human"] = human.report(person, replace(out, folder=args.out / "human"))
    print()
    write_index(args.out, documents, out.formats)
    print(f"Everything on one page: {args.out / 'index.html'}")


OPTIONS: options.Options = {**options.output("results", *options.PRINTED), **options.TRIALS}
"""Options of the command."""

parser, main = running.command(__name__, "experiments", __doc__, run, OPTIONS)
