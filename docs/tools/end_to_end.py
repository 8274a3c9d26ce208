"""Ways from a log and a model on disk to parameters on disk beside each other, each a process of its own.

The log is that of an arm of four joints that rub, of the study of noise; bodies of the model are a fifth off.
"""

import json
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from tqdm import tqdm

from docs.tools.noise import Case
from docs.tools.noise_conditions import CONDITIONS, truth
from docs.tools.noise_recordings import sinusoids
from docs.tools.pipelines import WRITTEN
from experiments.document.result_folder import version
from experiments.studies.validation.peers import UNLIMITED, Given, TorqueLog
from ident.estimation.samples import Samples
from ident.geometry.inertia import com_from_parameters
from ident.identification import identify
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.recordings.log import read_log
from sim.models.model_mechanism import mechanism

RATE, SAMPLES, TURNS = 100, 2000, 3
"""Samples per second and their number, and turns that are measured."""

LOG, MODEL = "log.csv", "model.urdf"
"""Names of files."""

LONG = 60.0
"""CPU time from which on one turn is enough, s."""

MISSTATED = np.array([[1.2], [0.8], [1.2], [0.8], [1.2]])
"""Bodies of the model over the true ones: a fifth is usual where motors and cables are guessed."""

LAUNCHER = """
import resource, subprocess, sys
code = subprocess.run(sys.argv[1:], stdout=subprocess.DEVNULL).returncode
used = resource.getrusage(resource.RUSAGE_CHILDREN)
print(used.ru_utime + used.ru_stime, used.ru_maxrss / 1024)
sys.exit(code)
"""
"""Measures a command, s and MB, from a small process: Linux counts the memory of the one that starts it as well."""

MEASURED = sys.executable, "-ISc", LAUNCHER, sys.executable, "-m"
"""Runs and measures a module."""

Row = dict[str, Any]


@dataclass(frozen=True)
class Way:
    """A way from a log to parameters.

    Attributes:
        name: Name in the table.
        arguments: Module and arguments, before those that name files.
        packages: Distributions that it needs, whose versions are stated.
        writes: Words for its answer.
    """

    name: str
    arguments: tuple[str, ...]
    packages: tuple[str, ...] = ("multicontact",)
    writes: str = "ψ and drives ±, URDF, page"

    def run(self, folder: Path) -> Row:
        """Its written answer with CPU time, s, and peak memory, MB; or the last line of its failure."""
        files = [str(folder / name) for name in (MODEL, LOG)]
        command = [*MEASURED, *self.arguments, *files, "--out", str(folder)]
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            return {"failure": done.stderr.strip().rpartition("\n")[2]}
        seconds, megabytes = map(float, done.stdout.split())
        answer = dict(json.loads((folder / WRITTEN).read_text(encoding="utf-8")))
        return answer | {"seconds": seconds - answer.get("around", 0.0), "megabytes": megabytes}


OURS = "multicontact", "identify", "--formats", "none", "--name", "made", "--estimator"
PEERS = "docs.tools.pipelines"
WAYS = (
    Way("trajectory estimate", (*OURS, "trajectory")),
    Way("weighted least squares", (*OURS, "weighted")),
    Way("ordinary least squares", (*OURS, "ordinary")),
    Way("Pinocchio's loop and lstsq", (PEERS, "pinocchio"), ("pin",), "φ and drives ±"),
    Way("CasADi's Gauss-Newton", (PEERS, "casadi"), ("casadi", "pin"), "φ and drives ±"),
    Way("FIGAROH", (PEERS, "FIGAROH"), ("figaroh", "pin"), "ψ and drives"),
    Way("mujoco.sysid", (PEERS, "mujoco.sysid"), ("mujoco", "absl-py"), "bodies and drives, MJCF"),
)
"""All of them; times are compared with those of the first one."""


@dataclass(frozen=True, eq=False)
class Judge:
    """Input of all ways, and the truth by which their answers are judged.

    Attributes:
        given: Model and equations of the torques.
        true: Their true coefficients (m,).
        motion: A motion that is in no log.
    """

    given: Given
    true: np.ndarray
    motion: Motion

    @classmethod
    def of(cls, folder: Path, samples: int) -> "Judge":
        """Judge of a log and a model, which are written into a folder."""
        case = Case.drawn(replace(CONDITIONS["rubs_sinusoids_200"], rate=RATE, samples=samples), 0, 0)
        arm, log = case.subject.mechanism, case.recording
        table = np.column_stack([log.time, *log.measured.values()])
        np.savetxt(folder / LOG, table, "%.9g", ",", header=",".join(["time", *log.measured]), comments="")
        (folder / MODEL).write_text(urdf(arm, MISSTATED * arm.known.reshape(-1, 10)), encoding="utf-8")
        model = mechanism(folder / MODEL)
        equations = identify(model, read_log(folder / LOG, model), estimator="ordinary").fit.equations
        true = truth(equations.with_offsets(()), case.phi, case.drives)
        equations = equations.with_offsets(equations.sensed)
        true = np.pad(true, (0, len(equations.offsets)))
        drawn = sinusoids(np.random.default_rng(1), len(arm.tree.joints), 10).trajectory(np.arange(0, 10, 1 / RATE))
        judged = TorqueLog(RATE, drawn[0], np.zeros_like(drawn[0]))
        return cls(Given(folder / MODEL, equations, (), judged), true, Motion(*drawn))

    def errors(self, answer: Row) -> dict[str, float]:
        """Torques' error over their deviation, RMS of the joints, and the parameters' median relative error."""
        if "phi" in answer:
            still = np.zeros((len(self.given.arm.bodies) - len(answer["phi"]), 10))
            values = self.given.values(np.concatenate([still, answer["phi"]]), answer["drives"])
        else:
            values = dict(zip(answer["columns"], answer["values"], strict=True))
        equations, sizes = self.given.equations, abs(self.true)
        wrong = np.array([values.get(name, 0.0) for name in equations.names]) - self.true
        nothing = Samples(self.motion, np.zeros((len(self.motion), len(equations.channels))))
        error, signal = equations.residual(nothing, np.stack([wrong, self.true]))
        torques = np.sqrt(np.mean(np.mean(error**2, axis=0) / np.var(signal, axis=0)))
        return {"torques": float(torques), "parameters": float(np.median(abs(wrong[sizes > 0]) / sizes[sizes > 0]))}


def urdf(arm: Mechanism, phi: np.ndarray) -> str:
    """URDF file of an arm whose hinges are at the origins of its links, with other φ (b, 10)."""
    lines = []
    for body, own in zip(arm.tree.bodies, phi, strict=True):
        mass, center, inertia = com_from_parameters(own)
        entries = " ".join(f'i{"xyz"[i]}{"xyz"[j]}="{inertia[i, j]:.9g}"' for i in range(3) for j in range(i, 3))
        inertial = f'<origin xyz="{_row(center)}"/><mass value="{mass:.9g}"/><inertia {entries}/>'
        lines.append(f'<link name="{body.name}"><inertial>{inertial}</inertial></link>')
    for body in (body for body in arm.tree.bodies if body.joint):
        ends = f'<parent link="{arm.tree.bodies[body.parent].name}"/><child link="{body.name}"/>'
        place = f'<origin xyz="{_row(body.home[:3, 3])}"/><axis xyz="{_row(body.twist[3:])}"/>{UNLIMITED}'
        lines.append(f'<joint name="{body.joint}" type="revolute">{ends}{place}</joint>')
    return "\n".join(['<robot name="arm">', *lines, "</robot>", ""])


def _row(values: np.ndarray) -> str:
    return " ".join(f"{x:.9g}" for x in values)


def measured(samples: int = SAMPLES, turns: int = TURNS) -> dict[str, Any]:
    """Samples, and a row for each way that is installed, of medians in turns and of errors."""
    there = [way for way in WAYS if all(map(version, way.packages))]
    for way in (way for way in WAYS if way not in there):
        print(f"{way.name} is not compared with; install the extra 'peers'.")
    runs: dict[str, list[Row]] = {way.name: [] for way in there}
    with TemporaryDirectory() as scratch:
        judge, written = Judge.of(Path(scratch), samples), Path(scratch) / WRITTEN
        written.parent.mkdir()
        for way in tqdm(there * turns, "end to end"):
            done = runs[way.name]
            if not done or done[0].get("seconds", LONG) < LONG:
                done.append(way.run(Path(scratch)))
    return {"samples": samples, "rows": [_row_of(way, runs[way.name], runs[there[0].name], judge) for way in there]}


def _row_of(way: Way, runs: Sequence[Row], first: Sequence[Row], judge: Judge) -> Row:
    """Row of a way's runs, or why there are none."""
    versions = ", ".join(f"{package} {version(package)}" for package in way.packages)
    row = {"way": way.name, "version": versions, "writes": way.writes, "turns": len(runs)}
    if failures := [run["failure"] for run in runs if "failure" in run]:
        return row | {"failure": failures[0]}
    seconds = np.array([run["seconds"] for run in runs])
    spent = {"seconds": seconds, "ratio": seconds / [run.get("seconds", np.nan) for run in first[: len(runs)]]}
    spent["megabytes"] = np.array([run["megabytes"] for run in runs])
    return row | {key: float(np.median(each)) for key, each in spent.items()} | judge.errors(runs[0])


def _digits(value: float) -> str:
    """Two digits, also of large numbers."""
    return f"{float(f'{value:.2g}'):g}"


def markdown(results: dict[str, Any]) -> str:
    """Generated part of docs/speed.md: the machine and a table."""
    lines = [f"Measured on {results['machine']}.", ""]
    lines += ["| way | version | CPU s | of ours | MB | error of torques | of parameters | writes |"]
    lines += ["| --- | --- | ---: | ---: | ---: | ---: | ---: | --- |"]
    for row in results["rows"]:
        numbers = ["", "", "", "", row.get("failure", "")]
        if "failure" not in row:
            numbers = [_digits(row[key]) for key in ("seconds", "ratio", "megabytes")]
            numbers += [f"{_digits(100 * row[key])} %" for key in ("torques", "parameters")]
        lines.append("| " + " | ".join((row["way"], row["version"], *numbers, row["writes"])) + " |")
    return "\n".join([*lines, ""])
