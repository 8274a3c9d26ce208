"""Derivation of a mechanism's symbolic model: from its name or model file to files in LaTeX, Python and C."""

from collections.abc import Sequence
from pathlib import Path

from experiments.document import tabular
from experiments.document.provenance import provenance
from experiments.document.result_folder import results_folder, write_json
from experiments.document.terminal import wrapped
from experiments.symbols import codegen, symbolic
from ident.errors import InputError, ModelError
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.parameters.base_parameters import STANDARD_GRAVITY, separating_sensors
from sim.models.mechanism import mechanism

TABLES = ("table_1", "table_2")


def run(given: str, base: str | None, ignore: Sequence[str], parent: Path) -> None:
    """Derives a model and writes it.

    Args:
        given: Model file, or one of `TABLES`.
        base: Body whose frame is {0}, by default the world.
        ignore: Equality constraints and tendons to leave out.
        parent: Folder for the folder of the results.

    Raises:
        InputError: The model cannot be read, or a table is given options.
    """
    name = codegen.plain(Path(given).stem)
    name = name if name.strip(". ") else "model"
    out = parent / name
    if given not in TABLES:
        tree, lengths = symbolic.exact_tree(_tree(given, base, ignore))
    elif base is None and not ignore:
        tree, lengths = getattr(symbolic, given)()
    else:
        raise InputError(f"The options --base and --ignore need an MJCF or URDF file, got '{given}'.")
    model = symbolic.derive(tree, lengths)
    digits = 12 if model.exact else 6
    rows = tuple((key, str(symbolic.decimals(x, digits))) for key, x in model.base_expressions().items())
    table = tabular.Table(f"Base parameters of {name}: {model.regrouping.rank}", ("parameter", "expression"), rows)
    sources = {
        "dim.tex": codegen.latex_source(model, name),
        "regressor.py": codegen.python_source(model, name),
        "regressor.c": codegen.c_source(model, name),
        "base_parameters.csv": table.csv(),
    }
    with results_folder(out, inputs=[Path(given)]) as folder:
        for file, text in sources.items():
            (folder / file).write_text(text, encoding="utf-8")
        choices = {"mechanism": given, "base": base, "ignore": ignore}
        write_json(folder / "provenance.json", provenance(choices))
    print(table.text())
    if not model.exact:
        print(f"The coefficients are decimals, because {model.reason}.")
    print(wrapped(f"Without effect on the wrench: {', '.join(model.regrouping.unseen) or 'nothing'}."))
    if model.regrouping.remark:
        print(wrapped(model.regrouping.remark))
    for what, gained in separating_sensors(Mechanism(symbolic.with_values(tree, lengths), STANDARD_GRAVITY)).items():
        print(wrapped(f"Separately identifiable {what}: {', '.join(gained) or 'nothing'}."))
    print(f"LaTeX, Python and C are in {out}.")


def _tree(path: str, base: str | None, ignore: Sequence[str]) -> Tree:
    """The mechanism of a model file, which must have mass."""
    arm = mechanism(path, base, ignore=ignore)
    if arm.prior is None:
        raise ModelError(f"A mechanism needs mass; {', '.join(arm.bodies)} have none.")
    return arm.tree
