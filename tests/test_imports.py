"""Imports point one way: experiments -> sim -> scenes, experiments and sim -> ident, and down the ladder of ident."""

import ast
import sys
from pathlib import Path

import pytest

import ident
from experiments.cli.command import FROM_A_CLONE

ROOT = Path(ident.__file__).parents[1]
LADDER = (
    "geometry",
    "mechanism",
    "model",
    "parameters",
    "files",
    "recordings",
    "estimation",
    "regression",
    "trajectory",
    "judgement",
)
"""Rooms of `ident`; each imports from those before it, and from `errors`."""

ALLOWED = {
    "ident": {"numpy", "scipy"},
    "scenes": {"numpy", "mujoco", "ident"},
    "sim": {"numpy", "scipy", "mujoco", "scenes", "ident"},
    "experiments": {"numpy", "scipy", "mujoco", "matplotlib", "tqdm", "jinja2", "scenes", "ident", "sim"},
}
EXTRAS = {
    "cli": {"argcomplete"},
    "symbols": {"sympy"},
    "runs": {"distributed"},
    "benchmark": {"pinocchio"},
    "document": {"PIL"},
    "files": {"ezc3d", "rosbags", "pyarrow"},
}
"""Optional packages that a room imports."""

MODULES = [path for package in ALLOWED for path in sorted((ROOT / package).rglob("*.py"))]


def imported(path):
    """Dotted names of a module's imports, of modules and of names in them alike."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively"
            yield from (f"{node.module}.{alias.name}" for alias in node.names)


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_point_one_way(path):
    package, room = path.relative_to(ROOT).parts[:2]
    packages = {name.partition(".")[0] for name in imported(path)} - sys.stdlib_module_names
    assert packages <= ALLOWED[package] | {package} | EXTRAS.get(room, set())
    if package == "ident" and room in LADDER:
        used = {name.split(".")[1] for name in imported(path) if name.startswith("ident.")}
        assert used.isdisjoint(LADDER[LADDER.index(room) + 1 :])


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_what_is_installed_needs_nothing_that_only_a_clone_has(path):
    room = path.relative_to(ROOT).parts[1]
    if room not in FROM_A_CLONE:
        assert {name.split(".")[1] for name in imported(path) if name.startswith("experiments.")}.isdisjoint(
            FROM_A_CLONE
        )
