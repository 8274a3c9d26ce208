"""The files around the code: workflows, hooks, forms and the recipe parse, and agree with the packages."""

import re
import tomllib
from pathlib import Path

import pytest

import ident

ROOT = Path(ident.__file__).parents[1]
pytestmark = [
    pytest.mark.skipif(not (ROOT / ".github").exists(), reason="only a checkout has workflows"),
    pytest.mark.extras,
]
FILES = [*sorted((ROOT / ".github").rglob("*.yml")), ROOT / ".pre-commit-config.yaml", ROOT / ".conda/recipe.yaml"]
TEXTS = [*FILES, *(ROOT / ".github").rglob("*.md"), ROOT / ".conda/README.md", ROOT / "SECURITY.md"]


def parsed(path):
    yaml = pytest.importorskip("yaml", reason="PyYAML comes with the extra 'docs'")
    return yaml.safe_load(path.read_text(encoding="utf-8"))


OWN = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))


def test_yaml_parses_and_named_paths_exist():
    assert [path.name for path in FILES if not isinstance(parsed(path), dict)] == []
    for path in TEXTS:
        text = path.read_text(encoding="utf-8")
        named = re.findall(r"(?<![\w/.])(?:\.ci|\.conda|docs|tests|ident|experiments)/[\w./]+\w", text)
        named += re.findall(r"`([A-Z]+\.md|pyproject\.toml|recipe\.yaml)`", text)
        assert [name for name in named if not ((ROOT / name).exists() or (path.parent / name).exists())] == [], path


def test_workflow_runs_everything_and_builds_wheels_on_three_systems():
    jobs = parsed(ROOT / ".github/workflows/ci.yml")["jobs"]
    steps = [step for job in jobs.values() for step in job["steps"]]
    assert {"run": ".ci/run"} in jobs["everything"]["steps"] and jobs["everything"]["runs-on"].startswith("ubuntu")
    systems = {name.split("-")[0] for name in jobs["wheels"]["strategy"]["matrix"]["os"]}
    assert systems == {"ubuntu", "macos", "windows"}
    assert any("python -m cibuildwheel" in step.get("run", "") for step in jobs["wheels"]["steps"])
    used = [step["uses"] for step in steps if "uses" in step]
    assert len(used) >= 5 and [name for name in used if not re.fullmatch(r"actions/[\w-]+@v\d+", name)] == []


def test_hooks_are_those_of_make_check():
    hooks = {hook["id"]: hook for repo in parsed(ROOT / ".pre-commit-config.yaml")["repos"] for hook in repo["hooks"]}
    own = {name: hook["entry"] for name, hook in hooks.items() if hook["language"] == "system"}
    make = (ROOT / "Makefile").read_text(encoding="utf-8")
    for entry in own.values():
        assert f"$(BIN)/{entry.replace(' --force-exclude', '')}" in make
    assert own.keys() == {"ruff-check", "ruff-format", "mypy"}
    extra = OWN["project"]["optional-dependencies"]["dev"]
    assert {re.match(r"[\w-]+", name)[0] for name in extra} >= {"ruff", "mypy", "pre-commit"}


def test_recipe_agrees_with_the_package():
    recipe, own = parsed(ROOT / ".conda/recipe.yaml"), OWN
    other = {"mujoco-python": "mujoco", "matplotlib-base": "matplotlib"}
    stated = [line.split(" ") for line in recipe["requirements"]["run"] if line != "python"]
    assert [other.get(name, name) + versions for name, versions in stated] == own["project"]["dependencies"]
    assert recipe["context"]["version"] == own["project"]["version"]
    (setuptools,) = (name for name in recipe["requirements"]["host"] if name.startswith("setuptools"))
    assert setuptools.replace(" ", "") == own["build-system"]["requires"][0]
    commands = [f"{name} = {target}" for name, target in own["project"]["scripts"].items()]
    assert recipe["build"]["python"]["entry_points"] == commands
    script = [name for test in recipe["tests"] if "files" in test for name in test["files"]["source"]]
    assert script == [".ci/try_wheel.py"]
