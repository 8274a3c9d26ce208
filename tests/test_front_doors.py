"""Names in `import ident` and `import sim`, modules that they do not import yet, and typed clients."""

import re
import subprocess
import sys
from importlib.util import find_spec

import driven_arm
import pytest

import ident
import multicontact as mc
import scenes
import sim
from ident.errors import InputError
from ident.estimate import PAGES

CLIENT = """
import ident
import multicontact as mc
import sim
from ident import Frame, Mechanism, Motion, find_base_parameters, tree_from_mdh

arm: Mechanism = sim.mechanism(mc.scenes.load("arm"))
tree = tree_from_mdh([Frame("1", None, "revolute")])
expressions: tuple[str, ...] = find_base_parameters(tree, gravity=arm.gravity).expressions()
first, second = ident.identify(arm, "run.csv"), mc.identify(arm, ["log.csv"], columns={"time": "t"}, held_out="run.csv")
p: float = first.compare(second).p_value
low, high = second["m3rz3"].interval(0.9, setup=False)
print(low + high, second.summary(), second.to_dict()["std"], second.plot().axes, second.by_body["hand"][0].unit)


def largest(motion: Motion, recording: ident.Recording) -> float:
    return float(mc.Estimate.load("arm.npz").predict(motion).max() + recording["hip_position"].max())


page: str = mc.report(second, "results").read_text()
release = ".".join((mc.__version__, "post1"))
"""

MISTAKEN = {
    "import ident\n\nident.idntify\n": '"idntify"',
    "import multicontact as mc\n\nmc.idntify\n": '"idntify"',
    "import sim\n\nsim.mechanisms\n": '"mechanisms"',
    "from multicontact import idntify\n": '"idntify"',
}
"""Clients with a mistake, and the name that the message needs."""


@pytest.mark.parametrize(("package", "most"), [(ident, 30), (sim, 30), (mc, 62)])
def test_public_names_are_few_there_and_described_and_others_are_refused(package, most):
    assert len(package.__all__) <= most
    with pytest.raises(AttributeError, match=f"module '{package.__name__}' has no attribute 'robot'"):
        _ = package.robot
    for name in package.__all__ if package is not mc else ():
        assert getattr(package, name).__name__ == name
        assert re.search(rf"\n    {name}\b", package.__doc__) and name in dir(package)


def test_libraries_are_imported_when_they_are_needed():
    code = (
        "import ident, sim, multicontact, sys; "
        "assert not {'mujoco', 'numpy', 'scipy', 'experiments'} & set(sys.modules); "
        "ident.Tree; sim.mechanism; assert {'mujoco', 'numpy'} <= set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


@pytest.mark.parametrize("name", ["sim", "ident"])
def test_scripts_named_like_its_packages_are_one_sentence(tmp_path, name):
    script = tmp_path / f"{name}.py"
    script.write_text("import multicontact", encoding="utf-8")
    ended = subprocess.run([sys.executable, script], capture_output=True, text=True, cwd=tmp_path)
    message = (
        f"ImportError: multicontact needs its own package '{name}', but {script.resolve()} comes first on Python's"
    )
    assert message in ended.stderr.splitlines()[-1]


@pytest.mark.slow
@pytest.mark.skipif(find_spec("mypy") is None, reason="mypy comes with the extra 'dev'")
def test_clients_are_typed(tmp_path, pytestconfig):
    known = pytestconfig.cache.mkdir("clients")
    for k, code in enumerate([CLIENT, *MISTAKEN]):
        (tmp_path / f"{'mistaken' if k else 'right'}_{k}.py").write_text(code, encoding="utf-8")
    arguments = ["--strict", "--follow-imports=silent", "--config-file=", f"--cache-dir={known}"]
    command = [sys.executable, "-m", "mypy", *arguments, *map(str, tmp_path.glob("*.py"))]
    checked = subprocess.run(command, capture_output=True, text=True, cwd=tmp_path)
    *errors, _ = checked.stdout.splitlines()
    assert all(error.startswith("mistaken_") for error in errors), checked.stdout
    for k, name in enumerate(MISTAKEN.values(), start=1):
        assert any(error.startswith(f"mistaken_{k}.py") and name in error for error in errors), checked.stdout


def test_it_has_the_names_of_both_packages_and_no_others():
    assert {*mc.__all__} == {*ident.__all__, *sim.__all__, "scenes", "report"} and mc.__all__ == sorted(mc.__all__)
    for package in (ident, sim):
        assert all(getattr(mc, name) is getattr(package, name) for name in package.__all__)
    assert mc.scenes is scenes and mc.__version__ == ident.__version__ and dir(mc) == mc.__all__


def test_a_report_is_the_page_of_the_command_and_the_notebook_links_it(tmp_path, monkeypatch):
    estimate = driven_arm.quick()
    monkeypatch.setitem(PAGES, estimate, None)  # Left as before at the end.
    page = mc.report(estimate, tmp_path / "arm")
    assert page == tmp_path / "arm" / "report.html" and "Replay" in estimate._repr_html_()
    names = {path.name for path in page.parent.iterdir()}
    assert {"estimate.json", "model.xml", "table_base_parameters.csv", "figure_held_out.png"} <= names
    assert not any(name.endswith((".pdf", ".svg")) for name in names)
    assert "A mechanism, identified from 1 recording" in page.read_text(encoding="utf-8")
    assert mc.mechanism(page.parent / "model.xml").known == pytest.approx(estimate.consistent().phi, abs=1e-9)
    for formats in ("png", [], ["gif"]):
        with pytest.raises(InputError, match="formats needs some of pdf, png, svg; got"):
            mc.report(estimate, tmp_path / "arm", formats=formats)
