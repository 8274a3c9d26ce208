"""One version everywhere, with the date of its release."""

import re
import tomllib
from pathlib import Path

import pytest

import experiments

ROOT = Path(experiments.__file__).parents[1]


@pytest.mark.skipif(not (ROOT / "CITATION.cff").exists(), reason="only a checkout has a CITATION.cff")
def test_one_version_everywhere():
    with (ROOT / "pyproject.toml").open("rb") as file:
        version = tomllib.load(file)["project"]["version"]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    cited = dict(re.findall(r"^(version|date-released): (\S+)$", citation, re.MULTILINE))
    changes = (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")
    newest, day = re.search(r"^## (\S+) \((\d{4}-\d\d-\d\d)\)$", changes, re.MULTILINE).groups()
    assert cited == {"version": version, "date-released": day}
    assert newest == version
