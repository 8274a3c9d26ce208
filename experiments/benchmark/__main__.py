"""Measures the speed of regressor, identification, simulation and trials, as ratios to other ways in one process.

Ours and theirs take turns, and their medians are compared, after a check that their results are the same. All use one
thread for linear algebra. Nothing is asserted: machines differ, and are noisy.
"""

import argparse

from experiments.cli import options, running


def run(args: argparse.Namespace) -> None:
    """Measures, and writes and prints the results."""
    from experiments.benchmark import sections
    from experiments.benchmark.timing import QUICK, Effort
    from experiments.document.provenance import provenance
    from experiments.document.result_folder import writable
    from experiments.document.writer import write

    out = options.output_of(args)
    with writable(args.out):
        origin = provenance({**options.as_text(args), **out.choices})
        results = sections.measured(QUICK if args.quick else Effort()) | {"provenance": origin}
    write(sections.document(results), out)


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.output_parser("benchmark", __doc__)
    out.add_argument("--quick", action="store_true", help="few samples and repetitions, to see that everything runs")
    return out


main = running.main(__name__, run, parser)
