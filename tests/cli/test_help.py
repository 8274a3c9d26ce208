"""Help texts of the commands, and who computes the pieces of an estimate."""

import argparse
import gc
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from stand_ins import Here

import experiments
from experiments import identify
from experiments.cli.command import COMMANDS, main
from experiments.runs.environment import THREADS

TOP = Path(experiments.__file__).parent
HELP = """
import sys
from experiments.cli.command import COMMANDS, parser
parser().format_help()
for command in COMMANDS.values():
    command.parser().format_help()
print(*(sys.modules.keys() & {"mujoco", "numpy", "scipy", "matplotlib", "jinja2"}))
"""


def python(*arguments, **environment):
    command = [sys.executable, *arguments]
    return subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ | environment).stdout


def test_help_imports_nothing_that_computes():
    assert python("-c", HELP) == "\n"


def test_garbage_is_collected_as_before_where_python_calls_a_command():
    before = gc.get_threshold()
    gc.set_threshold(700)
    try:
        with pytest.raises(SystemExit):
            main(["no"])
        assert gc.get_threshold()[0] == 700
    finally:
        gc.set_threshold(*before)


def test_every_file_on_top_is_a_command():
    files = [path.resolve() for path in TOP.glob("*.py") if path.name != "__init__.py"]
    assert sorted(files) == sorted(Path(module.__file__).resolve() for module in COMMANDS.values())


def test_every_command_is_listed_with_a_line(capsys, monkeypatch):
    monkeypatch.setenv("COLUMNS", "200")
    with pytest.raises(SystemExit) as stop:
        main(["--help"])
    assert stop.value.code == 0
    output = " ".join(capsys.readouterr().out.split())
    for name, module in COMMANDS.items():
        assert f" {name} {module.__doc__.splitlines()[0]}" in output


@pytest.mark.parametrize("name", COMMANDS)
def test_options_are_those_of_the_module(name, capsys):
    with pytest.raises(SystemExit) as stop:
        main([name, "--help"])
    assert stop.value.code == 0
    usage, options = capsys.readouterr().out.split("\n\n", 1)
    assert usage.startswith(f"usage: multicontact {name} ")
    assert options == COMMANDS[name].parser().format_help().split("\n\n", 1)[1]


def test_help_has_no_default_of_a_flag():
    texts = {name: module.parser().format_help() for name, module in COMMANDS.items()}
    assert "(default: False)" not in str(texts)
    assert "(default: pdf png)" in " ".join(texts["misaligned"].split()) and "(default: [" not in str(texts)
    assert "(default: True)" not in texts["human"] and "(default: True)" in texts["identify"]


def test_defaults_are_those_that_pages_state():
    study = {"seed": None, "samples": None, "noise_scale": None, "tilt_deg": None, "azimuth_deg": None, "workers": 1}
    trials = {"trials": 0, "trajectory_trials": 100, "redraw": "all", "resume": False}
    own = {"estimator": "trajectory", "holdout": 0.4, "prior": "auto", "drive": ["auto"], "offsets": True, "own": []}
    ours = {"logs": [Path("b")], "held_out": [], "out": Path("results"), "formats": ["svg"], "workers": None}
    for name, arguments, expected in (
        ("misaligned", [], study | trials | {"out": Path("results/misaligned"), "formats": ["pdf", "png"]}),
        ("identify", ["a", "b"], own | ours),
        ("stream", ["a", "b"], own | ours | {"estimator": "ordinary", "holdout": 0.0}),
        ("study", ["a"], {"out": None, "contact": None, "file": Path("a")}),
        ("human", [], {"seed": 0, "seconds": 4, "rate": 50, "source": "angles", "persons": 1, "rail": True}),
        ("excite", ["a"], {"harmonics": 5, "starts": 24, "iterations": 100, "drive": ["none"], "clearance": 0.005}),
    ):
        given = vars(COMMANDS[name].parser().parse_args(arguments))
        assert {key: given[key] for key in expected} == expected, name


@pytest.mark.extras
def test_the_shell_completes_commands_and_options(tmp_path):
    pytest.importorskip("argcomplete")
    for line, expected in (("multicontact ident", ["identify "]), ("multicontact identify --held", ["--held-out "])):
        completions = tmp_path / "completions"
        shell = {"COMP_LINE": line, "COMP_POINT": str(len(line)), "IFS": "\n", "_ARGCOMPLETE_IFS": "\n"}
        shell |= {"_ARGCOMPLETE": "1", "_ARGCOMPLETE_STDOUT_FILENAME": str(completions)}
        python("-c", "from experiments.cli.command import main; main()", **shell)
        assert completions.read_text().split("\n") == expected


@pytest.mark.usefixtures("here")
@pytest.mark.parametrize(
    ("work", "workers", "threads", "kind"),
    [
        (identify.THREADED - 1, None, "1", type(None)),
        (identify.THREADED, None, "1", ThreadPoolExecutor),
        (identify.THREADED, 1, "1", type(None)),
        (identify.THREADED, 2, "1", Here),
        (identify.THREADED, None, "4", type(None)),
        (identify.PAYS, None, "1", Here),
    ],
)
def test_threads_share_pieces_of_recordings_of_medium_length(monkeypatch, work, workers, threads, kind):
    """Unless linear algebra has threads of its own, or one worker is asked for."""
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    for name in THREADS:
        monkeypatch.setenv(name, threads)
    log = SimpleNamespace(samples=SimpleNamespace(motion=SimpleNamespace(q=np.zeros((work, 1)))))
    with identify._workers(argparse.Namespace(workers=workers, estimator="trajectory"), [log]) as executor:
        assert type(executor) is kind
