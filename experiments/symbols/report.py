"""Report on a derivation: files in LaTeX, Python and C, a table of the base parameters, and the terminal's text."""

from experiments.document import tabular
from experiments.document.terminal import wrapped
from experiments.symbols import codegen, symbolic
from experiments.symbols.derivation import Derivation

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
