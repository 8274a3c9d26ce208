"""Derives the dynamic identification model of a mechanism in closed form: LaTeX, Python and C."""

import argparse
from pathlib import Path

from experiments.cli import options, running


def run(args: argparse.Namespace) -> None:
    """Derives a model, and writes and prints it."""
    from experiments.document.result_folder import provenance, results_folder, write_json
    from ident.files.limits import library

    with library("symbolic", "This"):
        from experiments.symbols import codegen

    options.check_model(args.mechanism, codegen.TABLES)
    derived = codegen.derivation(args.mechanism, args.base, args.ignore)
    out = args.out / derived.name
    with results_folder(out, inputs=[Path(args.mechanism)]) as folder:
        for file, text in codegen.sources(derived).items():
            (folder / file).write_text(text, encoding="utf-8")
        choices = {"mechanism": args.mechanism, "base": args.base, "ignore": args.ignore}
        write_json(folder / "provenance.json", provenance(choices))
    print(codegen.text(derived))
    print(f"LaTeX, Python and C are in {out}.")


EPILOG = (
    "The regressor Y and the base parameters are those of the wrench at the base, which rests; parameters are "
    "regrouped with gravity along -Z of the base frame."
)
"""Text below the help."""

OPTIONS: options.Options = {
    **options.output("results/derive"),
    "mechanism": ("table_1 or table_2 for the paper's double pendulum, or an MJCF or URDF file", {}),
    "--base": ("body that is the base, by default the world", {}),
    "--ignore": ("equality constraints and tendons to leave out", options.NAMES),
}
"""Options of the command."""

parser, main = running.command(__name__, "experiments.derive", __doc__, run, OPTIONS, EPILOG)
