"""Help texts and options of the commands, how they end, and who computes the pieces of an estimate."""

import argparse
import gc
import json
import os
import shlex
import signal
import subprocess
import sys
import traceback
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from functools import partial
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from commands import refusal
from pages import PENDULUM
from stand_ins import Here

import experiments
import scenes
from docs.tools.noise_recordings import sinusoids
from experiments import identify, mechanism
from experiments.cli import options, running
from experiments.document.result_folder import version
from experiments.runs import THREADS
from ident.errors import ExcitationError, InputError, LogError, ModelError
from multicontact.__main__ import COMMANDS, main
from sim.simulation.simulate import simulate

posix = pytest.mark.skipif(os.name != "posix", reason="signals and pipes are otherwise elsewhere")
COMMAND = "python -m experiments.mechanism"


def main_of(error):
    def study(*_):
        raise error

    return partial(running.run, study, mechanism.parser)


@pytest.mark.parametrize(
    "error",
    [
        *(kind("the sentence.") for kind in (InputError, ModelError, LogError, ExcitationError, OSError, MemoryError)),
        OSError(36, "the sentence", "the file"),
    ],
)
def test_what_users_do_wrong_is_one_sentence(capsys, error):
    file = "the file: " if getattr(error, "filename", None) else ""
    assert refusal(main_of(error), [], capsys) == f"{COMMAND}: error: {file}the sentence.\n"


PRINTS = """
import sys
from experiments import mechanism
from experiments.cli import running
sys.exit(running.run(lambda _: print("done"), mechanism.parser))
"""


@posix
@pytest.mark.parametrize(
    ("streams", "code"), [("1>&- 2>&-", 0), (">/dev/full", 2), ("1>&- wrong", 2), ('; echo "$?" >&2) | :', 141)]
)
def test_a_closed_output_is_no_fault(streams, code):
    words = shlex.join([sys.executable, "-c", PRINTS])
    piped = streams.endswith("| :")
    ended = subprocess.run(f"{'(' * piped}{words} {streams}", shell=True, stderr=subprocess.PIPE, text=True)
    assert "Traceback" not in ended.stderr
    assert ended.stderr == f"{code}\n" if piped else ended.returncode == code


@pytest.mark.parametrize("error", [ValueError("of numpy"), np.linalg.LinAlgError("of LAPACK"), KeyError("of ours")])
def test_any_other_error_asks_to_be_reported_below_its_traceback(error):
    with pytest.raises(type(error)) as raised:
        main_of(error)(["--out", "a folder"])
    *_, message, request = traceback.format_exception(raised.value)
    assert str(error) in message and request.count("\n") == 1
    assert "please report it in the project's issue tracker" in request
    assert f"version {version('multicontact')} and the command: {COMMAND} --out 'a folder'\n" in request


def test_a_later_request_ends_what_went_on_after_the_first(monkeypatch):
    reached = []

    def study(_):
        with suppress(KeyboardInterrupt):
            signal.raise_signal(signal.SIGINT)
        signal.raise_signal(signal.SIGINT)
        reached.append("the second one at once is ignored")
        monkeypatch.setattr(running, "GRACE", 0.0)
        signal.raise_signal(signal.SIGINT)
        reached.append("the third one later is not")

    assert running.run(study, mechanism.parser, []) == 130 and len(reached) == 1


IGNORES = """
import sys, time
import numpy as np
from experiments import mechanism
from experiments.cli import running

A = np.eye(1500) + 1e-3

def study(_):
    print("running", file=sys.stderr, flush=True)
    while True:
        try:
            time.sleep(60)
        except KeyboardInterrupt:
            pass

sys.exit(running.run(study, mechanism.parser, []))
"""
"""A command that swallows the exception of a request to end, as libraries do in callbacks."""


def ended(number, *arguments, **options):
    """Exit code and further errors of a process that is sent a signal once it has written a line."""
    with subprocess.Popen([sys.executable, *arguments], stderr=subprocess.PIPE, text=True, **options) as process:
        assert process.stderr.readline()
        process.send_signal(number)
        return process.wait(timeout=50), process.stderr.read()


COMPUTES = IGNORES.replace("time.sleep(60)", "sum(np.linalg.eigvalsh(A)[0] for _ in range(99))")
"""A command in which Python's own handlers have to wait for a library."""


@posix
@pytest.mark.parametrize("script", [IGNORES, COMPUTES], ids=["swallowed", "computing"])
def test_a_request_to_terminate_is_obeyed_where_it_is_swallowed(script):
    assert ended(signal.SIGTERM, "-c", script) == (130, f"{COMMAND}: interrupted; every file is whole.\n")


@posix
def test_ctrl_c_during_imports_leaves_no_traceback(tmp_path):
    slow = "import sys, time\nprint('importing', file=sys.stderr, flush=True)\ntime.sleep(60)\n"
    (tmp_path / "scenes.py").write_text(slow)
    path = os.pathsep.join([str(tmp_path), str(Path(options.__file__).parents[2])])
    command, here = (
        ["-m", "experiments.mechanism", "--help"],
        {"cwd": tmp_path, "env": os.environ | {"PYTHONPATH": path}},
    )
    assert ended(signal.SIGINT, *command, **here) == (-signal.SIGINT, "")


@pytest.mark.parametrize("command", COMMANDS)
def test_a_number_of_the_command_line_is_one_of_a_size_or_refused_in_words(command):
    for action in (each for each in COMMANDS[command].parser()._actions if each.dest != "estimator"):
        for text in ("abc", "nan", "inf", "1e300", "") if action.type not in (None, Path) else ():
            with pytest.raises(argparse.ArgumentTypeError, match=r"^needs an? .*number.*, got "):
                action.type(text)


@pytest.mark.parametrize("before", [False, True])
def test_a_refusal_leaves_no_log_of_mujoco(tmp_path, monkeypatch, before):
    monkeypatch.chdir(tmp_path)
    log = Path("MUJOCO_LOG.TXT")
    if before:
        log.write_text("mine", encoding="utf-8")

    def study(options):
        log.write_text("WARNING: Nan, Inf or huge value in QACC", encoding="utf-8")
        raise InputError("The servos lost the excitation.")

    assert running.run(study, argparse.ArgumentParser, []) == 2 and log.exists() is before


UNUSED = (
    *("scipy.ndimage", "scipy.sparse.linalg", "sim.markers.trial_fit", "experiments.runs.workers"),
    *("matplotlib.backends.backend_pdf", "matplotlib.backends.backend_svg", "fontTools.subset"),
)
"""Modules that take long to import: for other recordings than short ones of joint angles, and for other formats."""


NEEDED = f"""
import sys
from experiments import identify
assert identify.main([*sys.argv[1:], "--formats", "none", "--estimator", "weighted", "--name", "none"]) == 0
assert "matplotlib" not in sys.modules
assert identify.main([*sys.argv[1:], "--formats", "png"]) == 0
print(*({{*{UNUSED}}} & set(sys.modules)))
"""


def python(*arguments, **environment):
    command = [sys.executable, *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, check=True, env=os.environ | environment).stdout


def test_identify_imports_what_it_needs(tmp_path):
    """Figures that are not asked for cost nothing; the page has its pictures and no section of figures."""
    motion, log = sinusoids(np.random.default_rng(0), 2, 2.5), tmp_path / "log.npz"
    simulate(scenes.load("double_pendulum"), motion, samples=250, seed=0).save(log)
    assert python("-c", NEEDED, PENDULUM, log, "--base", "base", "--out", tmp_path).splitlines()[-1] == ""
    page = (tmp_path / "none" / "report.html").read_text(encoding="utf-8")
    assert not list(tmp_path.glob("none/figure_*")) and 'id="figures"' not in page
    assert page.count('<svg class="picture"') == 3 and "<img" not in page


HELP = """
import sys
from multicontact.__main__ import COMMANDS, parser
parser().format_help()
for command in COMMANDS.values():
    command.parser().format_help()
print(*(sys.modules.keys() & {"mujoco", "numpy", "scipy", "matplotlib", "jinja2", "tqdm"}))
"""


def test_help_imports_nothing_that_computes():
    assert python("-c", HELP) == "\n"


def test_garbage_is_collected_as_before_where_python_calls_a_command(monkeypatch):
    monkeypatch.setattr(gc, "set_threshold", None)
    with pytest.raises(SystemExit):
        main(["no"])


def test_every_file_on_top_is_a_command_that_is_listed_with_a_line(capsys, monkeypatch):
    files = [path for path in Path(experiments.__file__).parent.glob("*.py") if path.name != "__init__.py"]
    assert sorted(files) == sorted(Path(module.__file__) for module in COMMANDS.values())
    monkeypatch.setenv("COLUMNS", "200")
    output = " ".join(help_of([], capsys).split())
    for name, module in COMMANDS.items():
        assert f" {name} {module.__doc__.splitlines()[0]}" in output


def help_of(words, capsys):
    with pytest.raises(SystemExit) as stop:
        main([*words, "--help"])
    assert stop.value.code == 0
    return capsys.readouterr().out


@pytest.mark.parametrize("name", COMMANDS)
def test_options_are_those_of_the_module(name, capsys):
    usage, options = help_of([name], capsys).split("\n\n", 1)
    assert usage.startswith(f"usage: multicontact {name} ")
    assert options == COMMANDS[name].parser().format_help().split("\n\n", 1)[1]
    # Flags have no default that anybody would want to know.
    assert "(default: False)" not in options and "(default: [" not in options


def test_defaults_are_those_that_pages_state():
    study = {"seed": None, "samples": None, "noise_scale": None, "tilt_deg": None, "azimuth_deg": None, "workers": 1}
    trials = {"trials": 0, "trajectory_trials": 100, "redraw": "all", "resume": False}
    own = {"estimator": "trajectory", "holdout": 0.4, "prior": "auto", "drive": ["auto"], "offsets": True, "own": []}
    ours = {"logs": [Path("b")], "held_out": [], "out": Path("results"), "formats": ["svg"], "workers": None}
    for command, expected in {
        "misaligned": study | trials | {"out": Path("results/misaligned"), "formats": ["pdf", "png"]},
        "identify a b": own | ours,
        "stream a b": own | ours | {"estimator": "ordinary", "holdout": 0.0},
        "study a": {"out": None, "contact": None, "file": Path("a")},
        "human": {"seed": 0, "seconds": 4, "rate": 50, "source": "angles", "persons": 1, "rail": True},
        "excite a": {"harmonics": 5, "starts": 24, "iterations": 100, "drive": ["none"], "clearance": 0.005},
    }.items():
        name, *arguments = command.split()
        given = vars(COMMANDS[name].parser().parse_args(arguments))
        assert {key: given[key] for key in expected} == expected, name


@pytest.mark.extras
def test_the_shell_completes_commands_and_options(tmp_path):
    pytest.importorskip("argcomplete")
    for line, expected in (("multicontact ident", ["identify "]), ("multicontact identify --held", ["--held-out "])):
        completions = tmp_path / "completions"
        shell = {"COMP_LINE": line, "COMP_POINT": str(len(line)), "IFS": "\n", "_ARGCOMPLETE_IFS": "\n"}
        shell |= {"_ARGCOMPLETE": "1", "_ARGCOMPLETE_STDOUT_FILENAME": str(completions)}
        python("-c", "from multicontact.__main__ import main; main()", **shell)
        assert completions.read_text().split("\n") == expected


@pytest.mark.usefixtures("here")
def test_threads_share_pieces_of_recordings_for_which_processes_do_not_pay(monkeypatch):
    """Unless linear algebra has threads of its own, or one worker is asked for."""
    monkeypatch.setattr(os, "cpu_count", lambda: 2)
    for work, workers, threads, kind in (
        (identify.PAYS - 1, None, "1", ThreadPoolExecutor),
        (identify.PAYS - 1, 1, "1", type(None)),
        (identify.PAYS - 1, 2, "1", Here),
        (identify.PAYS - 1, None, "4", type(None)),
        (identify.PAYS, None, "1", Here),
    ):
        for name in THREADS:
            monkeypatch.setenv(name, threads)
        log = SimpleNamespace(samples=SimpleNamespace(motion=SimpleNamespace(q=np.zeros((work, 1)))))
        with identify._workers(argparse.Namespace(workers=workers, estimator="trajectory"), [log]) as executor:
            assert type(executor) is kind, (work, workers, threads)


def test_results_of_another_question_are_kept_or_named(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for file in ("arm.xml", "a.csv", "b.csv", "day2/a.csv", "copy/a.csv"):
        Path(file).parent.mkdir(exist_ok=True)
        Path(file).write_text(file.replace("copy/", ""))

    def folder(*arguments):
        args = identify.parser().parse_args(["arm.xml", *arguments])
        out = options.folder(args)
        out.mkdir(parents=True, exist_ok=True)
        return args, out

    names = [folder(*words.split())[1].name for words in ("a.csv", "a.csv b.csv", "a.csv --estimator ordinary")]
    assert names == ["arm-a", "arm-a+b", "arm-a-ordinary"]
    assert folder(*(f"{k}.csv" for k in range(5)))[1].name == "arm-0+4"
    args, out = folder("a.csv")
    files = [options.file_entry(Path(file)) for file in ("arm.xml", "a.csv")]
    (out / "provenance.json").write_text(json.dumps({"options": options.as_text(args), "recording": files}))
    Path("a.csv").write_text("mended")
    assert options.of_replaced(*folder("a.csv", "--formats", "none", "--verbose")) == ""
    replaced = options.of_replaced(*folder("a.csv", "--prior", "on", "--holdout", "0"))
    assert "of other options (--holdout, --prior)" in replaced
    with pytest.raises(InputError, match=r"results of other files than 'day2/a\.csv': --name NAME"):
        folder("day2/a.csv")
    assert folder("day2/a.csv", "--name", "arm-a")[1] == out
    Path("a.csv").write_text("a.csv")
    assert folder("copy/a.csv")[1] == out, "the same log at another place"
    (out / "provenance.json").write_text("[]")
    assert folder("day2/a.csv")[1] == out, "no results of identify"
