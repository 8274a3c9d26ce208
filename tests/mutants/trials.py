"""Runs of tests on a copy of the repository that has a fault."""

import shutil
import subprocess
import sys
from collections.abc import Sequence
from importlib.util import cache_from_source
from pathlib import Path

from .covered import Covered, environment
from .drawn import Mutant

COPIED = ("ident", "sim", "experiments", "scenes", "tests", "docs", "pyproject.toml", "README.md", "constraints.txt")
"""Files of the repository that tests need."""

FIRST = 6.0
"""Total duration of the tests that run first, s; they kill most faults."""

PATIENCE = 20.0, 3.0
"""Seconds until tests count as hanging, and further ones for each second that the tests take without a fault."""


def copied(repository: Path, to: Path) -> Path:
    """Copies the files that tests need."""
    for name in COPIED:
        source = repository / name
        if source.is_dir():
            shutil.copytree(source, to / name, ignore=shutil.ignore_patterns("__pycache__"))
        elif source.exists():
            shutil.copy(source, to / name)
    return to


def trial(copy: Path, covered: Covered, mutant: Mutant, budget: float) -> str:
    """Ending of the tests that execute a fault's line: the quickest, up to a total duration of `budget` s."""
    tests, survived = covered.tests(mutant.path, mutant.line), 0
    for most in (FIRST, budget):
        chosen, seconds = list[str](), 0.0
        while tests and seconds < most:
            seconds += covered.seconds[tests[0]]
            chosen.append(tests.pop(0))
        if chosen and (ending := outcome(copy, mutant, _by_file(mutant, chosen), seconds)):
            return f"killed: {ending}"
        survived += len(chosen)
    return f"survived: {survived} tests" if survived else "survived: no test executes it"


def _by_file(mutant: Mutant, tests: Sequence[str]) -> list[str]:
    """Tests sorted by file, those of the room first, as tests of one file may share costly fixtures."""
    room = f"tests/{Path(mutant.path).parts[1]}/"
    return sorted(tests, key=lambda test: (not test.startswith(room), test.partition("::")[0]))


def outcome(copy: Path, mutant: Mutant, tests: Sequence[str], seconds: float) -> str:
    """The test that fails with a fault in a copy, or another ending; empty if all pass.

    Args:
        copy: The copy.
        mutant: The fault.
        tests: The tests.
        seconds: Their duration without the fault.
    """
    file = copy / mutant.path
    source = file.read_text(encoding="utf-8")
    file.write_text(mutant.applied(source), encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-x", "-q", "--no-header", "--tb=no", "-p", "no:cacheprovider", *tests]
    most = PATIENCE[0] + PATIENCE[1] * seconds
    try:
        run = subprocess.run(command, cwd=copy, env=environment(copy), capture_output=True, text=True, timeout=most)
    except subprocess.TimeoutExpired:
        return "tests hang"
    finally:
        file.write_text(source, encoding="utf-8")
        # All other files stay compiled; this file may get another fault of the same length within a second.
        Path(cache_from_source(str(file))).unlink(missing_ok=True)
    if run.returncode == 0:
        return ""
    failed = [row for row in run.stdout.splitlines() if row.startswith(("FAILED", "ERROR"))]
    return failed[0].split()[1] if failed else f"pytest ends with {run.returncode}"
