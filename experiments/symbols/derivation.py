"""Derivation of a mechanism's symbolic model: from its name or model file to files in LaTeX, Python and C."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from experiments.document import report
from experiments.document.terminal import wrapped
from experiments.symbols import codegen, symbolic
from ident.errors import InputError, ModelError
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.parameters.base_parameters import STANDARD_GRAVITY, separating_sensors
from sim.models.mechanism import mechanism

TABLES = ("table_1", "table_2")


def run(args: argparse.Namespace) -> None:
    """Derives a model and writes it."""
    name = codegen.plain(Path(args.mechanism).stem)
    name = name if name.strip(". ") else "model"
    out = args.out / name
    if args.mechanism not in TABLES:
        tree, lengths = symbolic.exact_tree(_tree(args.mechanism, args.base, args.ignore))
    elif args.base is None and not args.ignore:
        tree, lengths = getattr(symbolic, args.mechanism)()
    else:
        raise InputError(f"The options --base and --ignore need an MJCF or URDF file, got '{args.mechanism}'.")
    model = symbolic.derive(tree, lengths)
    digits = 12 if model.exact else 6
    rows = tuple((key, str(symbolic.decimals(x, digits))) for key, x in model.base_expressions().items())
    table = report.Table(f"Base parameters of {name}: {model.regrouping.rank}", ("parameter", "expression"), rows)
    sources = {
        "dim.tex": codegen.latex_source(model, name),
        "regressor.py": codegen.python_source(model, name),
        "regressor.c": codegen.c_source(model, name),
        "base_parameters.csv": table.csv(),
    }
    with report.results_folder(out, inputs=[Path(args.mechanism)]) as folder:
        for file, text in sources.items():
            (folder / file).write_text(text, encoding="utf-8")
        given = {"mechanism": args.mechanism, "base": args.base, "ignore": args.ignore}
        report.write_json(folder / "provenance.json", report.provenance(given))
    print(table.text())
    if not model.exact:
        print(f"The coefficients are decimals, because {model.reason}.")
    print(wrapped(f"Not seen at all: {', '.join(model.regrouping.unseen) or 'nothing'}."))
    if model.regrouping.remark:
        print(wrapped(model.regrouping.remark))
    for what, gained in separating_sensors(Mechanism(symbolic.with_values(tree, lengths), STANDARD_GRAVITY)).items():
        print(wrapped(f"Seen apart besides, {what}: {', '.join(gained) or 'nothing'}."))
    print(f"LaTeX, Python and C are in {out}.")


def _tree(path: str, base: str | None, ignore: Sequence[str]) -> Tree:
    """The mechanism of a model file, which must have mass."""
    arm = mechanism(path, base, ignore=ignore)
    if arm.prior is None:
        raise ModelError(f"A mechanism needs mass; {', '.join(arm.bodies)} have none.")
    return arm.tree
