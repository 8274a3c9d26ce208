"""Biases and spreads of estimators with noisy sensors, friction and bad motions, and coverage of their intervals."""

import argparse

from experiments.cli import options, running


def run(args: argparse.Namespace) -> None:
    """Runs the study and writes and prints its results."""
    from experiments.document.provenance import provenance
    from experiments.document.result_folder import writable
    from experiments.document.writer import write
    from experiments.noise import report
    from experiments.noise import study as noise

    conditions, out = noise.chosen(args.conditions), options.output_of(args)
    with writable(args.out):
        workers = options.workers_of(args)
        outcomes = noise.outcomes(conditions, args.recordings, seed=args.seed, folder=args.out, workers=workers)
        study = noise.study(outcomes, args.recordings, conditions)
    choices = {key: getattr(args, key) for key in ("seed", "recordings", "conditions", "formats")}
    write(report.document(study, provenance({**choices, **out.choices})), out)


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.output_parser("noise", __doc__)
    out.add_argument("--seed", type=options.whole_number(0), default=0, help="seed of all noise")
    out.add_argument(
        "--recordings", type=options.whole_number(2, 100_000), default=5, help="recordings of each kind of noise"
    )
    out.add_argument(
        "--conditions",
        nargs="+",
        metavar="NAME",
        help="conditions to look at, by default all of them; a wrong name lists them",
    )
    options.add_workers(out)
    return out


main = running.main(__name__, run, parser)
