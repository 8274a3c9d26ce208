"""Derivation of a mechanism's symbolic model: files in LaTeX, Python and C, and a table of the base parameters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from experiments.document import tabular
from experiments.document.terminal import wrapped
from experiments.symbols import codegen, symbolic
from ident.errors import InputError, ModelError
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.parameters.base_parameters import STANDARD_GRAVITY, separating_sensors
from sim.models.mechanism import mechanism

TABLES = ("table_1", "table_2")


@dataclass(frozen=True, eq=False)
class Derivation:
    """A mechanism's symbolic model.

    Attributes:
        name: Name of the mechanism, for files and titles.
        model: The model.
        gained: Parameters that more sensors would make identifiable separately, by sensors.
    """

    name: str
    model: symbolic.SymbolicModel
    gained: Mapping[str, Sequence[str]]


def derivation(given: str, base: str | None, ignore: Sequence[str]) -> Derivation:
    """Symbolic model of a mechanism.

    Args:
        given: Model file, or one of `TABLES`.
        base: Body whose frame is {0}, by default the world.
        ignore: Equality constraints and tendons to leave out.

    Raises:
        InputError: The model cannot be read, or a table is given options.
    """
    name = codegen.plain(Path(given).stem)
    if given not in TABLES:
        tree, lengths = symbolic.exact_tree(_tree(given, base, ignore))
    elif base is None and not ignore:
        tree, lengths = getattr(symbolic, given)()
    else:
        raise InputError(f"The options --base and --ignore need an MJCF or URDF file, got '{given}'.")
    gained = separating_sensors(Mechanism(symbolic.with_values(tree, lengths), STANDARD_GRAVITY))
    return Derivation(name if name.strip(". ") else "model", symbolic.derive(tree, lengths), gained)


def _tree(path: str, base: str | None, ignore: Sequence[str]) -> Tree:
    """The mechanism of a model file, which must have mass."""
    arm = mechanism(path, base, ignore=ignore)
    if arm.prior is None:
        raise ModelError(f"A mechanism needs mass; {', '.join(arm.bodies)} have none.")
    return arm.tree


DIGITS, DIGITS_OF_DECIMALS = 12, 6
"""Digits of numbers in the table, with exact coefficients and with decimal ones."""


def table(derived: Derivation) -> tabular.Table:
    """Base parameters in symbols."""
    model, digits = derived.model, DIGITS if derived.model.exact else DIGITS_OF_DECIMALS
    rows = tuple((key, str(symbolic.decimals(x, digits))) for key, x in model.base_expressions().items())
    title = f"Base parameters of {derived.name}: {model.regrouping.rank}"
    return tabular.Table(title, ("parameter", "expression"), rows)


def sources(derived: Derivation) -> dict[str, str]:
    """Contents of the files by name."""
    model, name = derived.model, derived.name
    return {
        "dim.tex": codegen.latex_source(model, name),
        "regressor.py": codegen.python_source(model, name),
        "regressor.c": codegen.c_source(model, name),
        "base_parameters.csv": table(derived).csv(),
    }


def text(derived: Derivation) -> str:
    """Text for the terminal."""
    model = derived.model
    lines = [table(derived).text()]
    if not model.exact:
        lines.append(f"The coefficients are decimals, because {model.reason}.")
    lines.append(wrapped(f"Without effect on the wrench: {', '.join(model.regrouping.unseen) or 'nothing'}."))
    if model.regrouping.remark:
        lines.append(wrapped(model.regrouping.remark))
    for sensors, gained in derived.gained.items():
        lines.append(wrapped(f"Separately identifiable {sensors}: {', '.join(gained) or 'nothing'}."))
    return "\n".join(lines)
