"""Symbolic model of a mechanism, its files in LaTeX, Python and C, and a table of its base parameters."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import sympy
from sympy.printing.c import C99CodePrinter
from sympy.printing.pycode import PythonCodePrinter
from sympy.simplify.fu import TR8

from experiments.document import tabular
from experiments.document.typography import parameter_symbol, wrapped
from experiments.symbols import SymbolicModel, decimals, derive, exact_tree, table_1, table_2, with_values
from ident.errors import InputError, ModelError
from ident.mechanism.mechanism import Mechanism
from ident.parameters.base_parameters import STANDARD_GRAVITY, separating_sensors
from sim.models.model_mechanism import mechanism

READABLE = 250
"""Largest number of operations, shared ones counted once, at which LaTeX is expanded in sines of sums of angles."""

LINE = 54
"""Width of the right-hand side of a printed equation, in letters; an article at 11 pt has room for it."""

Definitions = list[tuple[sympy.Symbol, sympy.Expr]]

TABLES = {"table_1": table_1, "table_2": table_2}
"""Models of the paper by the names that the command takes."""

DIGITS, DIGITS_OF_DECIMALS = 12, 6
"""Digits of numbers in the table, with exact coefficients and with decimal ones."""


def plain(text: str) -> str:
    """A name for any comment, docstring or path: ASCII word characters, dots, colons, blanks, hyphens."""
    return re.sub(r"[^\w.: -]", "_", text, flags=re.ASCII)


def python_source(model: SymbolicModel, name: str) -> str:
    """A module with the function `base_wrench_regressor`, which needs numpy only."""
    shared, entries = _shared(model.Y)
    printer = PythonCodePrinter({"fully_qualified_modules": False})
    rows, columns = model.Y.shape
    lengths = "".join(f", {symbol.name}={value!r}" for symbol, value in model.lengths.items())
    body = [f"[{', '.join(s.name for s in symbols)}] = {argument}" for argument, symbols in _arguments(model).items()]
    body += [f"{symbol} = {printer.doprint(x)}" for symbol, x in shared]
    body += [f"Y = np.zeros(({rows}, {columns}))"]
    body += [f"Y[{r}, {c}] = {printer.doprint(x)}" for r, c, x in entries]
    return f'''"""Base-wrench regressor of {plain(name)}, derived symbolically.

{_description(model)}
"""

from math import cos, sin

import numpy as np

PARAMETERS = {model.regrouping.parameters!r}
KEPT = {model.regrouping.kept!r}
"""Columns of the base parameters."""


def base_wrench_regressor(q, dq, ddq, gravity{", *" if lengths else ""}{lengths}):
    """Y with `[F; tau] = Y phi` in the base frame ({rows}, {columns})."""
{_indented(body)}
    return Y
'''


def c_source(model: SymbolicModel, name: str) -> str:
    """A C99 file with the function `base_wrench_regressor`."""
    shared, entries = _shared(model.Y)
    printer = C99CodePrinter()
    rows, columns = model.Y.shape
    arguments = _arguments(model) | ({"lengths": list(model.lengths)} if model.lengths else {})
    used = set().union(*(x.free_symbols for x in (*dict(shared).values(), *(x for _, _, x in entries))))
    body = [f"(void){argument};" for argument, symbols in arguments.items() if not used.intersection(symbols)]
    for argument, symbols in arguments.items():
        body += [f"const double {s.name} = {argument}[{k}];" for k, s in enumerate(symbols) if s in used]
    body += [f"const double {symbol} = {printer.doprint(x)};" for symbol, x in shared]
    body += [f"for (int k = 0; k < {rows * columns}; ++k) Y[k] = 0;"]
    body += [f"Y[{r * columns + c}] = {printer.doprint(x)};" for r, c, x in entries]
    signature = ", ".join(f"const double {argument}[{max(1, len(x))}]" for argument, x in arguments.items())
    values = ", ".join(f"{symbol.name} = {value!r}" for symbol, value in model.lengths.items())
    stated = f"Lengths, in this order, with the model's values in m: {values}.\n" if values else ""
    return f"""/* Base-wrench regressor of {plain(name)}, derived symbolically.

{_description(model)}
{stated}Y is a row-major {rows} x {columns} matrix. */
#include <math.h>

void base_wrench_regressor({signature}, double Y[{rows * columns}])
{{
{_indented(body)}
}}
"""


def latex_source(model: SymbolicModel, name: str) -> str:
    """The base parameters and their columns of the regressor, for inclusion in a document with amsmath."""
    columns = model.regrouping.reduce(model.Y)
    shared, entries = _shared(columns)
    # Counted without sharing, the operations of a long chain grow without bounds.
    if sum(sympy.count_ops(x) for x in (*dict(shared).values(), *(x for _, _, x in entries))) <= READABLE:
        columns = np.array([[_readable(x, list(model.lengths)) for x in row] for row in columns], dtype=object)
        shared, entries = _waves(columns)
    names = _latex_names(model)

    def tex(x: sympy.Expr) -> str:
        return sympy.latex(decimals(x, 6), symbol_names=names, fold_short_frac=True)

    left = [parameter_symbol(key).strip("$") for key in model.regrouping.names]
    psi = [rf"\left({k}\right)_R &= {tex(x)}" for k, x in zip(left, model.base_expressions().values(), strict=True)]
    lines = [rf"{tex(symbol)} &= {tex(x)}" for symbol, x in shared]
    equations = [rf"Y_{{{r + 1},{c + 1}}} &= {tex(x)}" for r, c, x in entries]
    head = f"Dynamic identification model of {plain(name)}, derived symbolically. Needs amsmath.\n{_description(model)}"
    of_entries = (
        "Entries of the base parameters' columns that are not zero; rows are F_x, F_y, F_z, tau_x, tau_y, tau_z"
    )
    parts = (("Base parameters", psi), ("Common subexpressions", lines), (of_entries, equations))
    text = [f"% {line}" for line in head.splitlines()]
    for title, rows in parts:
        text += [f"% {title}", *_align(rows)]
    return "\n".join(text) + "\n"


def _arguments(model: SymbolicModel) -> dict[str, list[sympy.Symbol]]:
    """Arguments of the generated functions, with the symbols of their entries."""
    arguments = zip(("q", "dq", "ddq", "gravity"), (*model.motion.states, model.mechanism.gravity), strict=True)
    return {name: list(symbols) for name, symbols in arguments}


def _description(model: SymbolicModel) -> str:
    """Order of joints and columns, and units, as plain text for a comment."""
    joints = ", ".join(map(plain, model.mechanism.tree.joints))
    return f"""Joints: {joints or "none"}.
SI units, radians; a ball joint has a quaternion w, x, y, z. Gravity is its acceleration in the base frame.
Columns of Y for each body, about its frame's origin: m, m rx, m ry, m rz, Ixx, Iyy, Izz, Ixy, Ixz, Iyz."""


def _indented(lines: Sequence[str]) -> str:
    """The lines of a function's body."""
    return "\n".join(f"    {line}" for line in lines)


def _shared(Y: np.ndarray) -> tuple[Definitions, list[tuple[int, int, sympy.Expr]]]:
    """Common subexpressions, and the entries that are not zero as row, column and expression."""
    places = [(r, c) for (r, c), x in np.ndenumerate(Y) if x != 0]
    symbols = sympy.numbered_symbols("x", start=1)
    shared, reduced = sympy.cse([Y[place] for place in places], symbols=symbols, order="none")
    entries = [(r, c, decimals(x, 17)) for (r, c), x in zip(places, reduced, strict=True)]
    return [(symbol, decimals(x, 17)) for symbol, x in shared], entries


def _waves(Y: np.ndarray) -> tuple[Definitions, list[tuple[int, int, sympy.Expr]]]:
    """As `_shared`, but only for sines and cosines."""
    atoms = set().union(*(x.atoms(sympy.sin, sympy.cos) for x in Y.flat))
    symbols = {x: sympy.Symbol(f"x{k}") for k, x in enumerate(sorted(atoms, key=sympy.default_sort_key), start=1)}
    entries = [(r, c, x.xreplace(symbols)) for (r, c), x in np.ndenumerate(Y) if x != 0]
    return [(symbol, x) for x, symbol in symbols.items()], entries


def _readable(x: sympy.Expr, lengths: Sequence[sympy.Symbol]) -> sympy.Expr:
    """A sum over sines and cosines of sums of angles, each factor a sum over the lengths."""
    expanded = sympy.expand(TR8(sympy.expand(x)))
    waves = sorted(expanded.atoms(sympy.sin, sympy.cos), key=sympy.default_sort_key)
    return sympy.collect(expanded, waves, lambda factor: sympy.collect(factor, lengths, sympy.factor))


def _latex_names(model: SymbolicModel) -> dict[sympy.Symbol, str]:
    states = zip(("q", r"\dot{q}", r"\ddot{q}"), model.motion.states, strict=True)
    names = {s: f"{name}_{{{k}}}" for name, symbols in states for k, s in enumerate(symbols, start=1)}
    for symbol in model.lengths:
        if match := re.fullmatch(r"([lc])(\d+)([xyz])(_*)", symbol.name):
            kind, body, axis, more = match.groups()
            names[symbol] = r"\bar{" * len(more) + kind + "}" * len(more) + f"_{{{axis},{body}}}"
    names |= {sympy.Symbol(key): parameter_symbol(key).strip("$") for key in model.regrouping.parameters}
    return names


def _align(rows: Sequence[str]) -> list[str]:
    """Equations one below the other, over several pages if necessary."""
    if not rows:
        return []
    body = " \\\\\n".join(map(_broken, rows))
    return [r"{\allowdisplaybreaks", r"\begin{align*}", body, r"\end{align*}", "}"]


def _broken(row: str) -> str:
    """An equation over several lines, cut before plus and minus signs within as few parentheses as possible."""
    left, equals, right = row.partition("&= ")
    right = right.replace(r"\left(", "(").replace(r"\right)", ")")
    cuts, braces, parentheses = [], 0, 0
    for match in re.finditer(r"[{}()]| (?=[+-] )", right):
        braces += (match[0] == "{") - (match[0] == "}")
        parentheses += (match[0] == "(") - (match[0] == ")")
        if match[0] == " " and not braces:
            cuts.append((parentheses, -match.start()))
    lines, start = [], 0
    while _width(right[start:]) > LINE:
        ahead = [cut for cut in cuts if -cut[1] > start]
        fitting = [cut for cut in ahead if _width(right[start : -cut[1]]) <= LINE]
        long = [cut for cut in fitting if _width(right[start : -cut[1]]) > LINE / 2]
        if not ahead:
            break
        end = -min(long or fitting[-1:] or ahead[:1])[1]
        lines.append(right[start:end])
        start = end + 1
    return left + equals + " \\\\\n&\\quad ".join([*lines, right[start:]])


def _width(tex: str) -> float:
    """Width of a piece of an equation, in letters; signs have room on both sides."""
    return len(re.sub(r"\\(?!sin|cos)[a-z]+|[{}_^ ]", "", tex)) + 1.5 * len(re.findall(r" [+-] ", tex))


@dataclass(frozen=True, eq=False)
class Derivation:
    """A mechanism's symbolic model.

    Attributes:
        name: Name of the mechanism, for files and titles.
        model: The model.
        gained: Parameters that more sensors would make identifiable separately, by sensors.
    """

    name: str
    model: SymbolicModel
    gained: Mapping[str, Sequence[str]]


def derivation(given: str, base: str | None, ignore: Sequence[str]) -> Derivation:
    """Symbolic model of a mechanism.

    Args:
        given: Model file, or a name of `TABLES`.
        base: Body whose frame is {0}, by default the world.
        ignore: Equality constraints and tendons to leave out.

    Raises:
        InputError: The model cannot be read, or a table is given options.
    """
    name = plain(Path(given).stem)
    if given not in TABLES:
        arm = mechanism(given, base, ignore=ignore)
        if arm.prior is None:
            raise ModelError(f"A mechanism needs mass; {', '.join(arm.bodies)} have none.")
        tree, lengths = exact_tree(arm.tree)
    elif base is None and not ignore:
        tree, lengths = TABLES[given]()
    else:
        raise InputError(f"The options --base and --ignore need an MJCF or URDF file, got '{given}'.")
    gained = separating_sensors(Mechanism(with_values(tree, lengths), STANDARD_GRAVITY))
    return Derivation(name if name.strip(". ") else "model", derive(tree, lengths), gained)


def table(derived: Derivation) -> tabular.Table:
    """Base parameters in symbols."""
    model, digits = derived.model, DIGITS if derived.model.exact else DIGITS_OF_DECIMALS
    rows = tuple((key, str(decimals(x, digits))) for key, x in model.base_expressions().items())
    title = f"Base parameters of {derived.name}: {model.regrouping.rank}"
    return tabular.Table(title, ("parameter", "expression"), rows)


def sources(derived: Derivation) -> dict[str, str]:
    """Contents of the files by name."""
    model, name = derived.model, derived.name
    return {
        "dim.tex": latex_source(model, name),
        "regressor.py": python_source(model, name),
        "regressor.c": c_source(model, name),
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
