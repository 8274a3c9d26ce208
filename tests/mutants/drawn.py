"""Faults that can be put into a source text, and a random draw of them."""

import ast
import random
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

PAIRS = (
    *((ast.Lt, ast.Gt), (ast.LtE, ast.GtE), (ast.Eq, ast.NotEq), (ast.Is, ast.IsNot), (ast.In, ast.NotIn)),
    *((ast.And, ast.Or), (ast.Add, ast.Sub), (ast.Mult, ast.Div), (ast.BitAnd, ast.BitOr)),
)
SWAPPED: Mapping[type[ast.AST], type[ast.AST]] = {
    **dict(PAIRS),
    **{b: a for a, b in PAIRS},
    **dict.fromkeys((ast.FloorDiv, ast.Mod, ast.Pow), ast.Mult),
}
"""Operators that replace each other."""

BOUNDARY: Mapping[type[ast.AST], type[ast.AST]] = {ast.Lt: ast.LtE, ast.LtE: ast.Lt, ast.Gt: ast.GtE, ast.GtE: ast.Gt}
"""Comparisons that differ at equality: a fault for counts, but unnoticeable for measured numbers."""

GUARD = 1e-6
"""Size below which a number only guards against zero: doubling it would change nothing."""

UNTESTED_KEYWORDS = ("strict", "maxsize", "desc", "unit", "dtype", "copy", "stacklevel")
"""Keywords whose constants affect only speed, progress or wrong calls."""

UNTESTED_CALLS = ("print", "tqdm", "warn", "TypeVar", "cast", "getLogger")
"""Functions whose arguments are words, types or progress."""


@dataclass(frozen=True)
class Mutant:
    """One fault.

    Attributes:
        path: The file, from the repository's folder.
        line: Line of the change.
        kind: Kind of the change.
        before: The text that is replaced.
        after: The text in its place.
        start: Offset in the file's bytes.
    """

    path: str
    line: int
    kind: str
    before: str
    after: str
    start: int

    def applied(self, source: str) -> str:
        """The source text with the fault."""
        raw, before = source.encode(), self.before.encode()
        assert raw[self.start : self.start + len(before)] == before
        return (raw[: self.start] + self.after.encode() + raw[self.start + len(before) :]).decode()


def mutants_of(path: str, source: str) -> list[Mutant]:
    """All faults for a file, without texts, annotations, `__all__`, error messages and progress."""
    raw = source.encode()
    starts = [0]
    for row in raw.splitlines(keepends=True):
        starts.append(starts[-1] + len(row))
    out = []
    for node, kind, after in _faults(ast.parse(source)):
        start, end = starts[node.lineno - 1] + node.col_offset, starts[node.end_lineno - 1] + node.end_col_offset
        before = raw[start:end].decode()
        out.append(Mutant(path, node.lineno, kind, before, after, start))
    return out


def drawn(mutants: list[Mutant], number: int, seed: int) -> list[Mutant]:
    """A random draw of so many faults, at most one in a line, in order."""
    rng, lines = random.Random(seed), dict[tuple[str, int], Mutant]()
    for mutant in rng.sample(mutants, len(mutants)):
        if len(lines) < number:
            lines.setdefault((mutant.path, mutant.line), mutant)
    return sorted(lines.values(), key=lambda mutant: (mutant.path, mutant.start))


def _faults(tree: ast.Module) -> Iterator[tuple[ast.expr | ast.stmt, str, str]]:
    """Yields the replaced node, the kind, and the new text."""
    for node in _code(tree):
        if isinstance(node, ast.stmt):
            yield from _of_statement(node)
        else:
            yield from _of_expression(node)


def _code(node: ast.AST) -> Iterator[ast.expr | ast.stmt]:
    """Statements and expressions below a node in which a test could notice a change."""
    for name, value in ast.iter_fields(node):
        if name in ("annotation", "returns", "decorator_list", "format_spec", "bases"):
            continue
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or _is_untested(child):
                continue
            if isinstance(child, ast.expr | ast.stmt):
                yield child
            # Any negative number leaves a length to `reshape`.
            length = isinstance(node, ast.Call) and ast.unparse(node.func).endswith("reshape") and name == "args"
            if not isinstance(child, ast.Raise | ast.Assert) and not (length and isinstance(child, ast.UnaryOp)):
                yield from _code(child)


def _is_untested(node: ast.AST) -> bool:
    if isinstance(node, ast.Assign | ast.AnnAssign):
        targets = node.targets if isinstance(node, ast.Assign) else [node.target]
        return any(isinstance(target, ast.Name) and target.id == "__all__" for target in targets)
    if isinstance(node, ast.If):
        return any(word in ast.unparse(node.test) for word in ("TYPE_CHECKING", "__name__"))
    if isinstance(node, ast.Call):
        return ast.unparse(node.func).rpartition(".")[2] in UNTESTED_CALLS or ast.unparse(node.func).endswith("Error")
    if isinstance(node, ast.keyword):
        return node.arg in UNTESTED_KEYWORDS
    return isinstance(node, ast.JoinedStr | ast.Import | ast.ImportFrom)


def _of_statement(node: ast.stmt) -> Iterator[tuple[ast.expr | ast.stmt, str, str]]:
    match node:
        case ast.If() | ast.While():
            yield node.test, "condition negated", f"not ({ast.unparse(node.test)})"
        case ast.Return(value=ast.expr()) if not isinstance(node.value, ast.Constant):
            yield node, "return dropped", "return None"
        case ast.Expr(value=ast.Call()) | ast.AugAssign() | ast.Continue() | ast.Break() | ast.Raise():
            yield node, "statement dropped", "pass"
        case ast.Assign(targets=[ast.Subscript() | ast.Attribute()]):
            yield node, "statement dropped", "pass"
    if isinstance(node, ast.AugAssign) and type(node.op) in SWAPPED:
        other = ast.AugAssign(node.target, SWAPPED[type(node.op)](), node.value)
        yield node, "arithmetic", ast.unparse(other)


def _of_expression(node: ast.expr) -> Iterator[tuple[ast.expr | ast.stmt, str, str]]:
    match node:
        case ast.Compare(ops=[op]) if type(op) in SWAPPED:
            to = BOUNDARY if type(op) in BOUNDARY and _is_count(node) else SWAPPED
            yield node, "comparison", _text(ast.Compare(node.left, [to[type(op)]()], node.comparators))
        case ast.BinOp() if type(node.op) in SWAPPED and not _has_text(node):
            yield node, "arithmetic", _text(ast.BinOp(node.left, SWAPPED[type(node.op)](), node.right))
        case ast.BoolOp():
            yield node, "and/or", _text(ast.BoolOp(SWAPPED[type(node.op)](), node.values))
        case ast.UnaryOp(op=ast.Not() | ast.USub() | ast.Invert()):
            yield node, "sign or not dropped", _text(node.operand)
        case ast.IfExp():
            yield node.test, "condition negated", f"(not ({ast.unparse(node.test)}))"
        case ast.Constant(value=bool()):
            yield node, "constant", str(not node.value)
        case ast.Constant(value=int() | float()):
            yield node, "constant", _other_number(node.value)


def _text(node: ast.expr) -> str:
    return f"({ast.unparse(ast.fix_missing_locations(node))})"


def _other_number(x: float) -> str:
    if isinstance(x, int):
        return str(x + 1)
    return repr(1.0 if x == 0 else 2 * x if abs(x) >= GUARD else 1e6 * x)


def _is_count(node: ast.Compare) -> bool:
    """True where one side is an integer or a length."""
    return any(
        (isinstance(side, ast.Constant) and isinstance(side.value, int))
        or (isinstance(side, ast.Call) and ast.unparse(side.func) in ("len", "sum", "np.count_nonzero"))
        for side in (node.left, *node.comparators)
    )


def _has_text(node: ast.BinOp) -> bool:
    return any(
        isinstance(x, ast.JoinedStr) or (isinstance(x, ast.Constant) and isinstance(x.value, str))
        for x in ast.walk(node)
    )
