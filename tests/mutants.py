"""Puts faults into a file or folder one at a time, drawn by chance, and lists those that no given test notices."""

import argparse
import ast
import random
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Sequence
from pathlib import Path

REPOSITORY = Path(__file__).parents[1]
COPIED = ("ident", "sim", "experiments", "scenes", "multicontact", "tests", "docs", "pyproject.toml", "README.md")
"""Files of the repository that tests need."""
SWAPPED = {ast.Lt: ast.GtE, ast.LtE: ast.Gt, ast.Gt: ast.LtE, ast.GtE: ast.Lt, ast.Eq: ast.NotEq, ast.NotEq: ast.Eq}
SWAPPED |= {ast.Is: ast.IsNot, ast.IsNot: ast.Is, ast.In: ast.NotIn, ast.NotIn: ast.In, ast.And: ast.Or}
SWAPPED |= {ast.Or: ast.And, ast.Add: ast.Sub, ast.Sub: ast.Add, ast.Mult: ast.Div, ast.Div: ast.Mult}
"""Operators that replace each other."""
PATIENCE = 600.0  # Seconds until tests count as hanging.


def faults(source: str) -> list[tuple[int, str, str]]:
    """Line, description and whole text of each fault; none in annotations, docstrings and error messages."""
    lines = source.encode().splitlines(keepends=True)
    out = []
    for node, after in _changes(ast.parse(source)):
        start = sum(map(len, lines[: node.lineno - 1])) + node.col_offset
        end = sum(map(len, lines[: node.end_lineno - 1])) + node.end_col_offset
        raw = source.encode()
        before = " ".join(raw[start:end].decode().split())
        out.append((node.lineno, f"{before[:60]} -> {after[:60]}", (raw[:start] + after.encode() + raw[end:]).decode()))
    return out


def _changes(node: ast.AST) -> Iterator[tuple[ast.AST, str]]:
    """Nodes in which a test could notice a change, and what replaces each."""
    for name, value in ast.iter_fields(node):
        for child in value if isinstance(value, list) else [value]:
            if not isinstance(child, ast.AST) or name in ("annotation", "returns", "decorator_list", "format_spec"):
                continue
            match child:
                case ast.If() | ast.While() | ast.IfExp():
                    yield child.test, f"(not ({ast.unparse(child.test)}))"
                case ast.Compare(ops=[op]) if type(op) in SWAPPED:
                    yield child, f"({ast.unparse(ast.Compare(child.left, [SWAPPED[type(op)]()], child.comparators))})"
                case ast.BinOp() if type(child.op) in SWAPPED and not isinstance(child.left, ast.JoinedStr):
                    yield child, f"({ast.unparse(ast.BinOp(child.left, SWAPPED[type(child.op)](), child.right))})"
                case ast.BoolOp():
                    yield child, f"({ast.unparse(ast.BoolOp(SWAPPED[type(child.op)](), child.values))})"
                case ast.UnaryOp(op=ast.Not() | ast.USub()):
                    yield child, f"({ast.unparse(child.operand)})"
                case ast.Constant(value=bool()):
                    yield child, str(not child.value)
                case ast.Constant(value=int() | float()):
                    yield child, repr(child.value + 1 if isinstance(child.value, int) else 2 * child.value or 1.0)
                case ast.Expr(value=ast.Call()) | ast.AugAssign() | ast.Raise() | ast.Continue() | ast.Break():
                    yield child, "pass"
            if not isinstance(child, ast.Raise | ast.JoinedStr | ast.Import | ast.ImportFrom):
                yield from _changes(child)


def survives(copy: Path, path: Path, text: str, tests: Sequence[str]) -> bool:
    """True if the tests pass with a file's text replaced in a copy of the repository."""
    file = copy / path
    source = file.read_text(encoding="utf-8")
    file.write_text(text, encoding="utf-8")
    command = [sys.executable, "-B", "-m", "pytest", "-x", "-q", "--tb=no", "-p", "no:cacheprovider", *tests]
    try:
        return subprocess.run(command, cwd=copy, capture_output=True, timeout=PATIENCE).returncode == 0
    except subprocess.TimeoutExpired:
        return False
    finally:
        file.write_text(source, encoding="utf-8")


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code: 1 if fewer than the asked share were noticed."""
    parser = argparse.ArgumentParser(prog="python -m tests.mutants", description=__doc__)
    parser.add_argument("place", type=Path, help="file or folder, as ident/judgement")
    parser.add_argument("tests", nargs="+", metavar="TEST", help="tests that should notice, as tests/judgement")
    parser.add_argument("--number", type=int, default=50, help="number of faults")
    parser.add_argument("--seed", type=int, default=0, help="seed of their choice")
    parser.add_argument("--least", type=float, default=0.85, help="share that has to be noticed")
    options = parser.parse_args(argv)
    place = REPOSITORY / options.place
    files = sorted(place.rglob("*.py")) if place.is_dir() else [place]
    every = [(file.relative_to(REPOSITORY), *fault) for file in files for fault in faults(file.read_text("utf-8"))]
    drawn = random.Random(options.seed).sample(every, min(options.number, len(every)))
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder)
        for name in COPIED:
            source = REPOSITORY / name
            (shutil.copytree if source.is_dir() else shutil.copy)(source, copy / name)
        left = 0
        for path, line, change, text in drawn:
            if survives(copy, path, text, options.tests):
                left += 1
                print(f"survived  {path}:{line}  {change}", flush=True)
    print(f"{len(drawn) - left} of {len(drawn)} noticed")
    return 0 if len(drawn) - left >= options.least * len(drawn) else 1


if __name__ == "__main__":
    sys.exit(main())
