"""README's generated table is that of a fresh run, and its example runs."""

import re
from pathlib import Path

import numpy as np
import pytest

import experiments
from experiments import misaligned, readme

README = Path(experiments.__file__).parents[1] / "README.md"
pytestmark = pytest.mark.skipif(not README.exists(), reason="only a checkout has a README.md")


def cells(markdown):
    return [[cell.strip() for cell in line.strip("| \n").split("|")] for line in markdown.strip().splitlines()]


def test_table_3_is_not_stale():
    text = README.read_text(encoding="utf-8")
    printed = cells(re.search(r"<!-- table 3 -->\n(.*?)<!-- end table 3 -->", text, re.DOTALL)[1])
    fresh = cells(readme.table_3(misaligned.study()))
    assert [row[0] for row in printed] == [row[0] for row in fresh]
    assert printed[0] == fresh[0]
    # Other platforms may round the second decimal the other way.
    numbers = [np.array([row[1:] for row in table[2:]], float) for table in (printed, fresh)]
    np.testing.assert_allclose(*numbers, atol=0.0101)


def test_a_block_is_replaced_and_a_missing_one_is_named():
    text = "a\n<!-- t -->\nold\n<!-- end t -->\nb"
    assert readme.with_block(text, "t", "new\n") == "a\n<!-- t -->\nnew\n<!-- end t -->\nb"
    with pytest.raises(ValueError, match="<!-- u -->"):
        readme.with_block(text, "u", "")


def test_the_example_runs(capsys):
    code = re.search(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)[1]
    exec(compile(code, str(README), "exec"), {})
    assert "m2rz2 + 0.425 m3" in capsys.readouterr().out
