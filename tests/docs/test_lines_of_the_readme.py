"""The README's lines of Python run as they stand, in a clone, and its commands have the files that they name."""

import re
import shlex
from pathlib import Path

import pytest

import experiments
from experiments import columns, identify

ROOT = Path(experiments.__file__).parents[1]
README = ROOT / "README.md"


@pytest.mark.skipif(not README.exists(), reason="only a checkout has a README")
def test_python_and_the_commands_behind_it_run(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scenes").symlink_to(ROOT / "scenes")
    text = README.read_text(encoding="utf-8").partition("## Ten lines of Python")[2]
    exec(re.search(r"```python\n(.*?)```", text, re.DOTALL)[1], {})
    assert Path("identified.xml").exists() and "base parameters" in capsys.readouterr().out
    commands = re.search(r"```sh\n(.*?)```", text, re.DOTALL)[1].splitlines()
    first, second = (shlex.split(line, comments=True) for line in commands)
    assert first[2] == "experiments.columns" and columns.main(first[3:]) in (None, 0)
    assert second[2] == "experiments.identify"
    args = identify.parser().parse_args(second[3:])
    assert args.base == "base" and all(Path(path).exists() for path in (args.model, *args.logs, args.columns))
