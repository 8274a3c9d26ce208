"""The symbolic model against the numeric one (extra `symbolic`)."""

import ctypes
import re
import shutil
import subprocess
import sys
from functools import cache

import numpy as np
import pytest
from commands import entries_of, refusal
from mechanisms import random_states, random_tree
from scipy.spatial.transform import Rotation
from test_against_opensymoro import DATA, frame_of

import experiments
from experiments import derive
from experiments.data import paper
from ident.geometry import se3
from ident.mechanism.body import BASE, Body
from ident.mechanism.dh import tree_from_mdh
from ident.mechanism.tree import Tree
from ident.model.regressor import base_wrench_regressor
from ident.parameters.base_parameters import find_base_parameters

sympy = pytest.importorskip("sympy", reason="sympy is in the extra 'symbolic'")
symbolic = pytest.importorskip("experiments.symbols")
codegen = pytest.importorskip("experiments.symbols.codegen")

pytestmark = pytest.mark.extras

COMPILER = shutil.which("cc") or shutil.which("gcc") or shutil.which("clang")
WARNINGS = ["-std=c99", "-Wall", "-Wextra", "-Werror"]
TABLE_PSI = {name: name for name in paper.TABLE_3} | {"m1": "m1 + m2 + m3", "m1rx1": "m1rx1 + m2rx2 + m3rx3"}
TABLE_PSI |= {"m2rz2": "m2rz2 + l_1*m3", "Ixx2": "Ixx2 + l_1**2*m3", "Ixz2": "Ixz2 - l_1*m3rx3"}


GOLDEN = "stanford_rrprrr"
"""One of OpenSYMORO's mechanisms: a long chain with a slide."""
KINDS = ("revolute", "prismatic", "helical", "ball")
CASES = [*codegen.TABLES, GOLDEN, "random"]


@cache
def case(name):
    if name in codegen.TABLES:
        tree, lengths = getattr(symbolic, name)()
        return symbolic.with_values(tree, lengths), symbolic.derive(tree, lengths)
    if name == "random":
        tree = random_tree(np.random.default_rng(1), 3, kinds=KINDS, massless=0.2)
    else:
        golden = entries_of(next(path for path in DATA if path.stem == name))
        tree = tree_from_mdh([frame_of(row) for row in golden["frames"]])
    return tree, symbolic.derive(*symbolic.exact_tree(tree))


def generated_python(model):
    namespace = {}
    exec(codegen.python_source(model, "a mechanism"), namespace)
    assert namespace["PARAMETERS"] == model.regrouping.parameters
    assert namespace["KEPT"] == model.regrouping.kept
    return namespace["base_wrench_regressor"]


def chain(folder, *bodies, name="arm.xml"):
    """A model file of a chain of bodies, given the attributes of each body, its joint and its geom."""
    parts = [f"<body {body}><joint {joint}/><geom {geom}/>" for body, joint, geom in bodies]
    text = f"<worldbody>{''.join(parts)}{'</body>' * len(bodies)}</worldbody>"
    path = folder / name
    path.write_text(f'<mujoco><compiler angle="radian"/>{text}</mujoco>', encoding="utf-8")
    return path


def assert_is_the_regressor(tree, function):
    rng = np.random.default_rng(0)
    states = random_states(rng, tree, 5)
    gravity = rng.normal(size=3)
    expected = base_wrench_regressor(tree, *states, gravity=gravity)
    for k, state in enumerate(zip(*states, strict=True)):
        np.testing.assert_allclose(function(*state, gravity), expected[k], rtol=0, atol=1e-12 * abs(expected[k]).max())


@pytest.mark.parametrize("table", codegen.TABLES)
def test_base_parameters_of_the_double_pendulum(table):
    _, model = case(table)
    assert model.exact
    expressions = model.base_expressions()
    assert list(expressions) == list(TABLE_PSI)
    for name, expression in TABLE_PSI.items():
        assert sympy.expand(expressions[name] - sympy.sympify(expression, {"l_1": symbolic.Symbol("l_1")})) == 0


def test_both_tables_give_one_model():
    """Its parallel axes leave exactly nothing of the force along them."""
    (tree_1, model_1), (tree_2, model_2) = case("table_1"), case("table_2")
    assert all(sympy.expand(x) == 0 for x in (model_1.Y - model_2.Y).flat)
    for a, b in zip(tree_1.bodies, tree_2.bodies, strict=True):
        np.testing.assert_array_equal(a.home, b.home)
        np.testing.assert_array_equal(a.twist, b.twist)
    assert all(sympy.trigsimp(sympy.expand(x)) in (0, -model_2.mechanism.gravity[0]) for x in model_2.Y[0])


@pytest.mark.parametrize("name", CASES)
def test_generated_python_is_the_regressor(name):
    tree, model = case(name)
    assert_is_the_regressor(tree, generated_python(model))


@pytest.mark.skipif(COMPILER is None, reason="no C compiler")
@pytest.mark.parametrize("name", CASES)
def test_generated_c_is_the_regressor(name, tmp_path):
    tree, model = case(name)
    source, library = tmp_path / "regressor.c", tmp_path / "regressor.so"
    source.write_text(codegen.c_source(model, name), encoding="utf-8")
    subprocess.run([COMPILER, *WARNINGS, "-shared", "-fPIC", "-o", library, source, "-lm"], check=True)
    function = ctypes.CDLL(str(library)).base_wrench_regressor

    def regressor(*arguments):
        lengths = [list(model.lengths.values())] if model.lengths else []
        arrays = [np.array(x, float) for x in (*arguments, *lengths)]
        Y = np.full(model.Y.shape, np.nan)
        function(*(x.ctypes.data_as(ctypes.c_void_p) for x in (*arrays, Y)))
        return Y

    assert_is_the_regressor(tree, regressor)


def test_exact_coefficients_are_the_numeric_ones():
    tree, model = case(GOLDEN)
    assert model.exact
    pinned = find_base_parameters(tree, kept=model.regrouping.names)
    exact = np.array([[float(sympy.sympify(c).subs(model.lengths)) for c in row] for row in model.regrouping.beta])
    np.testing.assert_allclose(exact, pinned.beta, rtol=0, atol=1e-9 * abs(exact).max())


def test_directions_that_coincide_to_rounding_give_decimals():
    """Two axes along z, one after turns about x and y that no fractions cancel."""
    there, back = np.eye(4), np.eye(4)
    there[:3, :3] = Rotation.from_euler("xy", [0.3, 0.4]).as_matrix()
    back[:3, :3] = there[:3, :3].T @ Rotation.from_euler("z", 0.2).as_matrix()
    z = np.array([0, 0, 0, 0, 0, 1.0])
    mast, bracket = Body("mast", BASE, np.eye(4), z, "slew"), Body("bracket", 0, there, np.zeros(6))
    jib = Body("jib", 1, back @ se3.pose(np.eye(3), np.array([0.5, 0, 0])), z, "swing")
    tree = Tree((mast, bracket, jib))
    model = symbolic.derive(*symbolic.exact_tree(tree))
    assert model.reason == "directions of this model coincide only to rounding"
    assert model.regrouping.rank == find_base_parameters(tree).rank
    assert_is_the_regressor(tree, generated_python(model))


def test_command_writes_latex_python_and_c(tmp_path, capsys):
    assert derive.main(["table_2", "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "m2rz2      l_1*m3 + m2rz2" in printed
    assert "with joint axes that are not parallel: m2rx2, Iyy2, Izz2, m3rx3, Iyy3, Izz3." in printed
    files = {path.name for path in (tmp_path / "table_2").iterdir()}
    assert files == {"dim.tex", "regressor.py", "regressor.c", "base_parameters.csv", "provenance.json"}
    tex = (tmp_path / "table_2" / "dim.tex").read_text(encoding="utf-8")
    assert r"\left(m_{2}r_{z,2}\right)_R &= l_{1} m_{3} + m_{2}r_{z,2}" in tex
    assert tex.count(r"\begin{align*}") == tex.count(r"\end{align*}") == 3


@pytest.mark.slow
def test_a_general_arm_is_derived(tmp_path, capsys):
    rng = np.random.default_rng(1)
    numbers = [[" ".join(f"{x:.4f}" for x in rng.normal(size=3) * size) for size in (0.3, 0.1, 1)] for _ in range(2)]
    path = chain(tmp_path, *((f'pos="{p}"', f'pos="{c}" axis="{axis}"', 'size=".1"') for p, c, axis in numbers))
    assert derive.main([str(path), "--out", str(tmp_path)]) == 0
    printed = capsys.readouterr().out
    assert "are decimals, because there are 12 lengths and directions that are not along frame axes." in printed
    table = printed[: printed.index("The coefficients")]
    assert all(len(digits.replace(".", "").strip("0")) <= 6 for digits in re.findall(r"\d[.\d]+", table))
    assert (tmp_path / "arm" / "dim.tex").read_text(encoding="utf-8").count(r"\begin{align*}") == 3


@pytest.mark.parametrize("name", ['q"""x', "two\nlines", "*/ x", ". .", "größe"])
def test_any_file_name_gives_code_that_compiles(name, tmp_path, capsys):
    path = chain(tmp_path, ("", 'axis="1 0 0"', 'size=".1"'), name=f"{name.replace('/', '')}.xml")
    assert derive.main([str(path), "--out", str(tmp_path / "out")]) == 0
    (folder,) = (tmp_path / "out").iterdir()
    assert re.fullmatch(r"[\w.: -]*\w[\w.: -]*", folder.name, flags=re.ASCII)
    texts = {file.name: file.read_text(encoding="ascii") for file in folder.iterdir() if file.suffix != ".json"}
    compile(texts["regressor.py"], "regressor.py", "exec")
    assert all(line.startswith("%") for line in texts["dim.tex"].split(r"{\allowdisplaybreaks")[0].splitlines())
    if COMPILER is not None:
        subprocess.run([COMPILER, *WARNINGS, "-c", "-o", tmp_path / "o", folder / "regressor.c"], check=True)


def test_what_cannot_be_derived_is_refused(tmp_path, capsys):
    for option in ("--base", "--ignore"):
        expected = "options --base and --ignore need an MJCF or URDF file, got 'table_2'."
        assert expected in refusal(derive.main, ["table_2", option, "foot"], capsys)
    assert "no body besides the world" in refusal(derive.main, [str(chain(tmp_path))], capsys)


def test_the_missing_extra_is_named(monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "sympy", None)
    for module in ("experiments.symbols", "experiments.symbols.codegen"):
        monkeypatch.delitem(sys.modules, module)
    monkeypatch.delattr(experiments, "symbols")
    assert "package 'sympy', which the extra 'symbolic' brings" in refusal(derive.main, ["table_1"], capsys)
