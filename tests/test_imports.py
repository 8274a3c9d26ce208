"""Imports point one way: experiments -> sim -> scenes, experiments and sim -> ident."""

import ast
from pathlib import Path

import pytest

import ident

ROOT = Path(ident.__file__).parents[1]
ALLOWED = {
    "ident": {"numpy", "scipy", "ident"},
    "scenes": {"numpy", "mujoco"},
    "sim": {"numpy", "scipy", "mujoco", "sim", "scenes"},
    "experiments": {"numpy", "matplotlib", "tqdm", "experiments", "sim", "scenes", "ident"},
}
MORE = {
    "mujoco_model.py": {"ident"},
    "model_update.py": {"ident"},
    "urdf.py": {"ident"},
    "preparation.py": {"scipy"},
    "excite.py": {"mujoco"},
    "excite_study.py": {"mujoco"},
    "symbolic.py": {"scipy", "sympy"},
    "codegen.py": {"sympy"},
    "cluster.py": {"distributed"},
    "peers.py": {"pinocchio"},
    "simulation.py": {"mujoco"},
}
"""What single modules may import besides: the bridge from MuJoCo a tree, optional ones their extra."""
STANDARD = __import__("sys").stdlib_module_names
MODULES = [path for package in ALLOWED for path in sorted((ROOT / package).rglob("*.py"))]


def imported(path):
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            yield from (alias.name.partition(".")[0] for alias in node.names)
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively"
            yield node.module.partition(".")[0]


@pytest.mark.parametrize("path", MODULES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_point_one_way(path):
    package = path.relative_to(ROOT).parts[0]
    allowed = ALLOWED[package] | MORE.get(path.name, set())
    assert set(imported(path)) - STANDARD <= allowed
