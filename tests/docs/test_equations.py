"""The page of the paper's equations names functions of each, and their docstrings name the equation."""

import importlib
import re
from pathlib import Path

import pytest

import experiments

PAGE = Path(experiments.__file__).parents[1] / "docs" / "equations.md"
pytestmark = pytest.mark.skipif(not PAGE.exists(), reason="only a checkout has docs")
NUMBERS = r"\d+(?:-\d+)?(?:(?:,| and)\s\d+(?:-\d+)?)*"


def numbers(text):
    """Numbers of a list such as `1-3, 5`."""
    ranges = ((int(a), int(b or a)) for a, b in re.findall(r"(\d+)(?:-(\d+))?", text))
    return {k for first, last in ranges for k in range(first, last + 1)}


def functions():
    """Names of functions by equation."""
    text = PAGE.read_text(encoding="utf-8").split("## Axes from poses")[0]
    parts = re.split(rf"^Eqs?\. ({NUMBERS})", text, flags=re.MULTILINE)
    out = {}
    for listed, block in zip(parts[1::2], parts[2::2], strict=True):
        for number in numbers(listed):
            out[number] = re.findall(r"`(ident(?:\.\w+)+)`", block)
    return out


def test_every_equation_has_functions():
    assert sorted(functions()) == list(range(1, 19))
    assert [number for number, names in functions().items() if not names] == []


@pytest.mark.parametrize("number", range(1, 19))
def test_its_functions_name_it(number):
    for name in functions()[number]:
        module, _, function = name.rpartition(".")
        described = getattr(importlib.import_module(module), function).__doc__
        mentioned = set().union(*(numbers(each) for each in re.findall(rf"Eqs?\.\s({NUMBERS})", described)))
        assert number in mentioned, name
