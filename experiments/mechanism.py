"""Shows the double pendulum itself: Figure 1 and Table II from the scene's own geometry, and Table I as printed."""

import argparse
from typing import TYPE_CHECKING

from experiments.cli import options, running
from experiments.data.paper import SCENE

if TYPE_CHECKING:
    from experiments.document.writer import Document, Output


def run(args: argparse.Namespace) -> None:
    """Writes and prints the mechanism."""
    report(options.output_of(args))


def report(out: "Output") -> "Document":
    """Writes and prints the mechanism, and returns its document."""
    from experiments.data.paper import difference_of_tables, drawing
    from experiments.document.result_folder import provenance
    from experiments.document.writer import write
    from experiments.reports import paper_report

    drawn, origin = drawing(), provenance({"formats": out.formats}, {"scene": SCENE})
    return write(paper_report.mechanism_document(drawn, difference_of_tables(drawn.tree), origin), out)


OPTIONS = options.output("results/mechanism", *options.PRINTED)
parser, main = running.command(__name__, "experiments.mechanism", __doc__, run, OPTIONS)
