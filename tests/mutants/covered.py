"""Tests by executed line: recorded with `coverage`, and again after changes of code or tests."""

import ast
import hashlib
import json
import os
import re
import subprocess
import sys
from collections.abc import Iterable, Mapping, Sequence
from functools import cached_property
from pathlib import Path

LEFT_OUT = ("output", "docs", "cli", "runs", "simulation", "motion", "models", "test_fuzz.py", "test_mutants.py")
"""Slow tests that are about other rooms."""

SECONDS = "MUTANTS_SECONDS"
"""Environment variable with the file of durations of passing tests."""


class Covered:
    """Lines executed by tests, and the duration of each test.

    Args:
        repository: The repository's folder.
        folder: Folder of the recorded data.
        copy: A copy of the repository to run tests in.
    """

    def __init__(self, repository: Path, folder: Path, copy: Path) -> None:
        self.repository, self.folder = repository, folder
        folder.mkdir(parents=True, exist_ok=True)
        self._file, kept = folder.resolve() / "coverage", folder / "gathered.json"
        known = json.loads(kept.read_text(encoding="utf-8")) if kept.exists() else {}
        code = _digest(sorted((repository / "ident").rglob("*.py")))
        if known.get("code") != code:
            self._file.unlink(missing_ok=True)
            known = {"code": code, "files": {}, "seconds": {}}
        now = {str(file.relative_to(repository)): _digest([file]) for file in test_files(repository)}
        stale = [file for file, digest in now.items() if known["files"].get(file) != digest]
        fresh = set(now) - set(stale)
        self.seconds: dict[str, float] = {k: x for k, x in known["seconds"].items() if k.partition("::")[0] in fresh}
        if stale:
            self.seconds |= self._gathered(stale, copy)
            kept.write_text(json.dumps({"code": code, "files": now, "seconds": self.seconds}), encoding="utf-8")

    def _gathered(self, files: Sequence[str], copy: Path) -> dict[str, float]:
        """Duration of each passing test of some files, s; executed lines go into the file of coverage."""
        seconds = self.folder.resolve() / "seconds.json"
        command = [sys.executable, "-m", "coverage", "run", "--append", "--source", "ident"]
        command += ["-m", "pytest", "-q", "-p", "no:cacheprovider", "-p", "tests.mutants.contexts", *files]
        subprocess.run(
            command, cwd=copy, env=environment(copy) | {"COVERAGE_FILE": str(self._file), SECONDS: str(seconds)}
        )
        return json.loads(seconds.read_text(encoding="utf-8"))

    @cached_property
    def _lines(self) -> dict[str, dict[int, list[str]]]:
        """Tests by file and line; files from the repository's folder."""
        # Listing faults needs only Python, not `coverage`.
        from coverage import CoverageData

        data = CoverageData(str(self._file))
        data.read()
        out: dict[str, dict[int, list[str]]] = {}
        for file in data.measured_files():
            # Copies have different folders.
            name = "ident/" + Path(file).as_posix().rpartition("/ident/")[2]
            lines = out.setdefault(name, {})
            for line, tests in data.contexts_by_lineno(file).items():
                lines.setdefault(line, []).extend(tests)
        return out

    def tests(self, path: str, line: int) -> list[str]:
        """Tests that execute a line, the quickest first; for a line executed on import, the tests of its names.

        Studies come last, as their tests share slow simulations.
        """
        tree = ast.parse((self.repository / path).read_text(encoding="utf-8"))
        body = _body(tree, line)
        covering = self._of_lines({path: body}) if body else self._of_names(path, _assigned(tree, line))
        covering = covering or self._of_lines({path: self._lines.get(path, {})})
        return sorted(covering, key=lambda test: (test.startswith("tests/studies/"), self.seconds[test]))

    def _of_lines(self, places: Mapping[str, Iterable[int]]) -> set[str]:
        every = (self._lines.get(path, {}).get(line, ()) for path, lines in places.items() for line in lines)
        return {test for tests in every for test in tests if test in self.seconds}

    def _of_names(self, path: str, names: Sequence[str]) -> set[str]:
        """Tests that execute lines with these names, in their own file or else in others, or that mention them."""
        if not names:
            return set()
        pattern, places = re.compile(rf"\b({'|'.join(names)})\b"), dict[str, list[int]]()
        for file in sorted((self.repository / "ident").rglob("*.py")):
            rows = file.read_text(encoding="utf-8").splitlines()
            places[str(file.relative_to(self.repository))] = [k for k, x in enumerate(rows, 1) if pattern.search(x)]
        files = {test.partition("::")[0] for test in self.seconds}
        naming = {file for file in files if pattern.search((self.repository / file).read_text(encoding="utf-8"))}
        named = {test for test in self.seconds if test.partition("::")[0] in naming}
        # The same name may have other meanings in other files.
        return named | (self._of_lines({path: places[path]}) or self._of_lines(places))


def _body(tree: ast.AST, line: int) -> list[int]:
    """A line in a function's body, the whole body for a line of its signature, or none for lines executed on import."""
    out: list[int] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef) and node.lineno <= line <= (node.end_lineno or 0):
            first = node.body[0].lineno
            out = [line] if line >= first else list(range(first, (node.end_lineno or first) + 1))
    return out


def _assigned(tree: ast.AST, line: int) -> list[str]:
    """Names assigned by the statement at a line."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Assign | ast.AnnAssign) and node.lineno <= line <= (node.end_lineno or 0):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            return [x.id for target in targets for x in ast.walk(target) if isinstance(x, ast.Name)]
    return []


def test_files(repository: Path) -> list[Path]:
    """Test files without those of `LEFT_OUT`."""
    files = sorted((repository / "tests").rglob("test_*.py"))
    return [file for file in files if file.relative_to(repository).parts[1] not in LEFT_OUT]


def environment(copy: Path) -> dict[str, str]:
    """Variables for importing from a copy, with one thread."""
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    # Compiling all modules for each fault would take most of the time.
    others = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    path = os.pathsep.join([str(copy), *filter(None, [os.environ.get("PYTHONPATH")])])
    return others | threads | {"PYTHONPATH": path}


def _digest(files: Sequence[Path]) -> str:
    return hashlib.sha256(b"".join(file.read_bytes() for file in files)).hexdigest()
