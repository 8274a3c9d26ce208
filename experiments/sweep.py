"""A study over the values of one of its options and several seeds: a table, a chart, and all its numbers."""

import argparse

from experiments.cli import options, running


def run(args: argparse.Namespace) -> None:
    """Runs the sweep and writes and prints its results."""
    from experiments.document.provenance import provenance
    from experiments.document.result_folder import writable
    from experiments.document.writer import write
    from experiments.reports import sweep_report
    from experiments.studies.study_entries import packaged
    from experiments.studies.sweep import swept, values_of

    option, *texts = args.over
    values = values_of(args.study, option, texts)
    out = options.output_of(args, args.out / args.study / option)
    with writable(out.folder):
        workers = options.workers_of(args)
        result = swept(args.study, option, values, args.seeds, folder=out.folder, workers=workers)
    choices = {key: getattr(args, key) for key in ("study", "over", "seeds", "numbers", "formats")}
    origin, title = provenance({**choices, **out.choices}), packaged(args.study).title
    write(sweep_report.document(result, args.study, title, args.numbers, origin), out, stale=())


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.output_parser("sweep", __doc__, options.PRINTED)
    out.add_argument("study", choices=("misaligned", "multicontact"), help="study to run")
    out.add_argument(
        "--over", nargs="+", required=True, metavar=("OPTION", "VALUE"), help="option of the study, and its values"
    )
    out.add_argument("--seeds", type=options.whole_number(1, 10_000), default=1, help="runs of each value")
    out.add_argument("--numbers", nargs="+", metavar="NAME", help="numbers of the study's summary that the chart shows")
    options.add_workers(out)
    return out


main = running.main(__name__, run, parser)
