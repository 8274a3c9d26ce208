"""Trials of a short recording, for the tests of running them."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pytest
from stand_ins import Here

from experiments import multicontact
from experiments.data.simulated_study import StudyProblem
from experiments.runs import workers
from experiments.runs.workers import Checkpoint
from experiments.studies import simulation
from experiments.studies.simulation import study, trial
from experiments.studies.study_entries import packaged

ANALYSE = partial(trial, StudyProblem.of(packaged("multicontact")), ("contact",))


def draw(tmp_path, *more, samples="200", contact="pad"):
    args = multicontact.parser().parse_args(["--out", str(tmp_path), "--samples", samples, *more])
    made = study("multicontact", samples=args.samples, seed=args.seed or 0, contact=contact)
    return simulation.Draw.of(made.file, args.redraw, made.recording)


def run(source, number, tmp_path, file=simulation.FILE, analyse=ANALYSE, given=None):
    """Outcomes of trials, in this process if no workers are given."""
    checkpoint = Checkpoint("trials", tmp_path / file, source.identity)
    with pytest.MonkeyPatch.context() as patched:
        if given is None or given.number == 1:
            patched.setattr(workers, "Processes", Here)
        return simulation.run_trials(source, analyse, number, checkpoint, given or workers.Workers())


def kept(tmp_path, file=simulation.FILE):
    with np.load(tmp_path / file) as data:
        return [json.loads(text or "[]") for text in bytes(data["outcomes"]).splitlines()]


@dataclass(frozen=True)
class Mortal:
    """An analysis whose worker is killed once, in the trial that draws a certain force."""

    force: float
    died: Path

    def __call__(self, recording):
        if recording["ground_force"][0, 0] == self.force and not self.died.exists():
            self.died.touch()
            os.kill(os.getpid(), signal.SIGKILL)
        return ANALYSE(recording)


WITHOUT_FIGURES = """
from types import SimpleNamespace
from experiments import multicontact
from experiments.cli import running
from experiments.document import figures
from experiments.runs import end_silently
from stand_ins import use_truth
end_silently()
running.GRACE = 60.0
figures.drawn = lambda figure, extension: b""
use_truth(SimpleNamespace(setattr=setattr))
raise SystemExit(multicontact.main())
"""
"""The study as `python -m` runs it, without its slow parts before the trials, and with more time to clean up."""


def interrupted(command, pattern, number):
    """Exit code and standard error of a multicontact study that is asked twice to end after a pattern in its output."""
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.PIPE, "start_new_session": True}
    # Otherwise MuJoCo starts a process for glfw, whose traceback would appear if it is ended meanwhile.
    quiet["env"] = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path), "MUJOCO_GL": "disable"}
    with subprocess.Popen([sys.executable, "-c", WITHOUT_FIGURES, *command], **quiet) as process:
        output = b""
        while not re.search(pattern, output):
            part = process.stderr.read1()
            assert part, output
            output += part
        for _ in range(2):
            os.killpg(process.pid, number)
        output += process.stderr.read()
        code = process.wait(timeout=60)
    with pytest.raises(ProcessLookupError):
        for _ in range(100):
            os.killpg(process.pid, 0)
            time.sleep(0.1)
    return code, output
