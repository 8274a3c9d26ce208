"""Imports point one way: multicontact -> experiments -> sim -> scenes, all -> ident, and down the rooms."""

import ast
import sys
from collections import Counter
from functools import cache
from graphlib import TopologicalSorter
from pathlib import Path

import ident

ROOT = Path(ident.__file__).parents[1]
LADDER = (
    *("geometry", "mechanism", "model", "parameters", "files"),
    *("recordings", "estimation", "regression", "trajectory", "judgement"),
)
"""Rooms of `ident`; each imports from those before it, and from `errors`."""

WITHIN = {
    "runs": set(),
    "data": set(),
    "guesses": set(),
    "document": {"runs"},
    "studies": {"data", "runs"},
    "reports": {"data", "document", "studies"},
    "symbols": {"data", "document"},
    "cli": {"data", "document", "runs"},
}
"""Rooms of `experiments`, and those that each imports from; commands import from all."""

ABOVE = {"estimate", "estimators", "identification", "payload", "problem"}
"""Parts of `ident` that no room of the ladder imports, not even for types."""

ALLOWED = {
    "ident": {"numpy", "scipy"},
    "scenes": {"numpy", "mujoco", "ident"},
    "sim": {"numpy", "scipy", "mujoco", "scenes", "ident"},
    "experiments": {"numpy", "scipy", "mujoco", "matplotlib", "tqdm", "jinja2", "scenes", "ident", "sim"},
    "multicontact": {"scenes", "ident", "sim", "experiments"},
}
EXTRAS = {
    "__main__.py": {"argcomplete"},
    "symbols": {"sympy"},
    "document": {"PIL", "rerun"},
    "files": {"ezc3d", "rosbags", "pyarrow"},
    "display": {"matplotlib", "pandas"},
    "models": {"xacro", "xacrodoc"},
    "estimate.py": {"matplotlib", "pandas"},
    "recordings": {"matplotlib", "pandas"},
}
"""Packages that a room imports where they are needed, or for types: optional ones, and matplotlib for plots."""

MODULES = [path for package in ALLOWED for path in sorted((ROOT / package).rglob("*.py"))]


@cache
def parsed(path):
    return ast.parse(path.read_text(encoding="utf-8"))


@cache
def imported(path):
    """Dotted names of a module's imports, of modules and of names in them alike."""
    names = []
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            names += [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{path} imports relatively"
            names += [f"{node.module}.{alias.name}" for alias in node.names]
    return names


def test_imports_point_one_way():
    """Packages that only a clone has, such as `docs`, are not among these."""
    for path in MODULES:
        package, room = path.relative_to(ROOT).parts[:2]
        packages = {name.partition(".")[0] for name in imported(path)} - sys.stdlib_module_names
        assert packages <= ALLOWED[package] | {package} | EXTRAS.get(room, set()), path
        if package == "ident" and room in LADDER:
            used = {name.split(".")[1] for name in imported(path) if name.startswith("ident.")}
            assert used.isdisjoint({*LADDER[LADDER.index(room) + 1 :], *ABOVE}), path


def test_studies_know_no_output_and_reports_compute_nothing():
    for room, others in WITHIN.items():
        for path in sorted((ROOT / "experiments" / room).glob("*.py")):
            used = [name.split(".") for name in imported(path) if name.startswith("experiments.")]
            assert {name[1] for name in used} <= others | {room}, path
            if room == "reports":
                assert all(name[-1][0].isupper() for name in used if name[1] == "studies"), path


def test_no_modules_import_each_other():
    """Also for types alone, and within functions; a tree that is closed holds a closure, which holds trees."""
    dotted = {path: ".".join(path.relative_to(ROOT).with_suffix("").parts) for path in MODULES}
    names = {name.removesuffix(".__init__"): path for path, name in dotted.items()}
    graph = {}
    for name, path in names.items():
        modules = {each if each in names else each.rpartition(".")[0] for each in imported(path)}
        graph[name] = modules & names.keys() - {name}
    graph["ident.mechanism.closure"].discard("ident.mechanism.tree")
    TopologicalSorter(graph).prepare()


SHARED = {"Table"}  # Public classes of one name: of logs and of documents.


def test_public_classes_have_names_of_their_own():
    classes = Counter(node.name for path in MODULES for node in parsed(path).body if isinstance(node, ast.ClassDef))
    assert {name for name, number in classes.items() if number > 1 and name[0] != "_"} <= SHARED
