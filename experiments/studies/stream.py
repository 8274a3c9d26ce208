"""Base parameters from recordings of any length, read and processed piece by piece."""

import argparse
import hashlib
import json
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass, field, replace
from functools import partial, reduce
from itertools import islice
from operator import add
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from experiments.cli import options
from experiments.cli.print_options import author_choices
from experiments.document import report
from experiments.document.layout import offset_unit, unit_of
from experiments.document.page import PAGE, Said, complain, write_results
from experiments.document.results import Results
from experiments.document.terminal import wrapped
from experiments.runs.checkpoint import SAVE_EVERY
from experiments.runs.workers import WorkerPool, worker_pool
from experiments.studies.one_pass import Judged, Passed, Seen, judged, separated, with_offsets
from ident.errors import InputError, LogError
from ident.estimation.accumulator import Accumulator, accumulate
from ident.estimation.equations import COMPONENTS, Equations
from ident.estimation.in_order import in_order
from ident.estimation.pieces import pieces
from ident.estimation.samples import Samples
from ident.files import npz
from ident.files.atomic import save_arrays
from ident.mechanism.motion import Motion
from ident.recordings.log import read_log_pieces
from ident.recordings.recording import Recording
from ident.recordings.wrench import GROUND, Sensor
from ident.regression.ordinary import PIECE, Fit, huber_white, solve
from sim.models.mechanism import mechanism

FILE = "accumulated.npz"
"""File in the output folder with the progress."""

OUTPUTS = (FILE, PAGE, "estimate.json", "provenance.json", *(f"base_parameters.{end}" for end in ("csv", "md", "tex")))
"""All output files."""


@dataclass(frozen=True, eq=False)
class Progress:
    """Progress over the pieces read so far, saved in a file.

    Attributes:
        file: The file.
        identity: Settings that determine the result, in JSON types.
        found: Accumulator of the pieces; None before the first.
        done: Number of pieces.
    """

    file: Path
    identity: Mapping[str, Any]
    found: Accumulator | None = None
    done: int = 0

    def resumed(self, equations: Equations) -> "Progress":
        """The progress of an earlier run on these equations.

        Raises:
            InputError: There is none, or it belongs to another run.
        """
        try:
            fields: dict[str, Any] = npz.arrays(self.file)
            kept, done = json.loads(str(fields.pop("identity"))), int(fields.pop("done"))
            if fields.keys() != Accumulator.__dataclass_fields__.keys():
                raise InputError("another version of this package wrote it")
            found = Accumulator(**fields)
            different = [key for key, value in self.identity.items() if kept.get(key) != value]
            columns = (len(equations.names) + 1,) * 2
            whole = (found.factor.shape, found.grams.shape) == (columns, (6, *columns)) and done > 0
            whole = whole and bool(np.isfinite([*found.factor, *found.gram]).all())
            if not different and not (whole and found.names == equations.names):
                raise InputError("damaged")
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise InputError(f"--resume needs what an earlier run left in {self.file} ({error}).") from None
        if different:
            raise InputError(f"{self.file} is of another run: {', '.join(different)} differ; leave out --resume.")
        return Progress(self.file, self.identity, found, done)

    def and_piece(self, part: Accumulator) -> "Progress":
        """The progress with one more piece."""
        found = part if self.found is None else self.found + part
        return Progress(self.file, self.identity, found, self.done + 1)

    def save(self) -> None:
        """Writes the file."""
        save_arrays(self.file, {"identity": json.dumps(self.identity), "done": self.done, **vars(self.found)})


@dataclass(frozen=True, eq=False)
class Reading:
    """Recordings to read, and settings for making samples of them.

    Attributes:
        equations: The equations to fit.
        files: Recordings in order.
        columns: Mapping of their columns; by default they are named like channels.
        piece: Samples read at a time.
        sensors: Sensors of the wrenches besides the ground's, by name.
        without: Names of wrenches to leave out.
        limit: Bytes that a piece of an npz file may take in memory.
        seen: Statistics of the channels.
        notes: Sentences on the files; more are appended.
    """

    equations: Equations
    files: Sequence[Path]
    columns: Path | None
    piece: int
    sensors: Mapping[str, Sensor]
    without: Sequence[str]
    limit: int
    seen: Seen
    notes: list[str] = field(default_factory=list)

    def __iter__(self) -> Iterator[Samples]:
        """Yields pieces of all files, checked against the mechanism.

        Raises:
            LogError: A file is not a recording of this mechanism.
        """
        for file in self.files:
            try:
                if self.columns is None:
                    recordings = Recording.chunks(file, self.piece, limit=self.limit)
                else:
                    recordings = read_log_pieces(
                        file, self.equations.mechanism, self.columns, self.piece, limit=self.limit
                    )
                yield from pieces(map(self._samples, recordings), self.equations)
            except InputError as error:
                raise LogError(str(error) if str(file) in str(error) else f"{file}: {error}") from None

    def _samples(self, recording: Recording) -> Samples:
        tree, recording = self.equations.mechanism.tree, recording.with_sensors(self.sensors)
        ground = {GROUND} if recording.is_held(tree) else set[str]()
        names = sorted({*ground, *self.sensors, *recording.wrenches}.difference(self.without))
        unknown = [name for name in names if name not in (GROUND, *recording.sensors)]
        if unknown:
            raise LogError(
                f"the recording holds the wrench '{unknown[0]}' besides the ground's: say --contact {unknown[0]} if a "
                f"site of that name holds its sensor, or --without {unknown[0]} to leave it out."
            )
        for joint in tree.joints:
            if f"{joint}_position" not in recording.measured:
                raise LogError(
                    f"the recording has no channel '{joint}_position'; it has {', '.join(sorted(recording.measured))}. "
                    f"Where the joint does not move, --fix {joint} [VALUE] leaves it out."
                )
        if recording.base is not None:
            raise LogError("the base moves, and its poses take a filter over all of the log: see experiments.identify")
        self.seen.check(recording, names)
        total = recording.total_wrench(tree, self.without).in_base
        if np.isnan(total).any():
            raise LogError("the ground's wrench needs all six components here; experiments.identify takes fewer.")
        self.seen.add(recording, total)
        self.notes.extend(note for note in recording.notes if note not in self.notes)
        return Samples(Motion(*recording.joint_states(tree.joints)), total)


def accumulated(
    progress: Progress,
    reading: Reading,
    *,
    executor: Executor,
    ahead: int | None = None,
) -> Accumulator:
    """Accumulator of all pieces, including those of an earlier run.

    Args:
        progress: The progress so far.
        reading: The recordings.
        executor: Executor for the pieces.
        ahead: Number of pieces to submit ahead, as for `in_order`.

    Raises:
        LogError: A piece does not fit; the pieces done before are in the file.
    """
    start = progress.done
    work = partial(accumulate, reading.equations)
    saved = time.monotonic()
    try:
        with closing(in_order(executor, work, islice(reading, start, None), ahead=ahead)) as parts:
            for part in tqdm(parts, desc="Pieces", initial=start, file=sys.stderr):
                progress = progress.and_piece(part)
                if time.monotonic() - saved > SAVE_EVERY:
                    progress.save()
                    saved = time.monotonic()
    except BaseException:
        if progress.done > start:
            progress.save()
        if progress.done:
            print(f"\nThe {progress.done} pieces done are in {progress.file}; go on with --resume.", file=sys.stderr)
        raise
    if progress.found is None:
        raise LogError("The recordings hold no samples.")
    progress.save()
    return progress.found


def table(estimate: Fit) -> report.Table:
    """Base parameters, and offsets in N and N m, with their standard deviations."""
    return report.Table(
        f"Base parameters from {estimate.samples} samples, SI units; s.d. of wrench noise, {estimate.noise}",
        *report.columns(
            parameter=estimate.names,
            estimated=estimate.values,
            std=estimate.std,
            regrouping=[*estimate.parameters.expressions(digits=4), *[""] * len(estimate.equations.offsets)],
        ),
        decimals=4,
        bodies=estimate.equations.mechanism.bodies,
        units=tuple(unit_of(name) or offset_unit(name) for name in estimate.names),
    )


def summary(estimate: Fit, judged: Judged) -> dict[str, Any]:
    """All numbers of the estimate for scripts."""
    rank = estimate.parameters.rank
    return {
        "verdict": judged.verdict,
        "findings": [finding.to_dict() for finding in judged.findings],
        "residual_ratio": dict(judged.ratio),
        "names": list(estimate.parameters.names),
        "psi": estimate.psi.tolist(),
        "std": estimate.std[:rank].tolist(),
        "covariance": estimate.covariance[:rank, :rank].tolist(),
        "offsets": {channel: {"value": v, "std": s} for channel, (v, s) in estimate.offsets.items()},
        "singular_values": estimate.singular_values.tolist(),
        "residual_norms": estimate.residual_norms.tolist(),
        "condition_number": estimate.condition_number,
        "samples": estimate.samples,
        "rows": estimate.rows,
        "method": estimate.method,
        "noise": estimate.noise,
    }


def run(args: argparse.Namespace) -> None:
    """Identifies, and writes and prints the results."""
    inputs = _inputs(args)
    identity = _identity(args)
    reading = _reading(args)
    report.check_inputs((args.out / name for name in OUTPUTS), inputs)
    with report.writable(args.out):
        progress = Progress(args.out / FILE, identity)
        if args.resume:
            progress = progress.resumed(reading.equations)
        with worker_pool(args.workers, args.scheduler, args.tls) as pool:
            whole = accumulated(progress, reading, executor=pool.executor, ahead=pool.ahead)
            fitted, equations = separated(whole, reading.equations)
            first = solve(fitted, equations)
            held_out = None if args.held_out is None else _held_out(args.held_out, reading, equations, pool)
        judgement = judged(Passed(reading.seen, fitted), first, held_out)
        estimate = huber_white(first, reading, steady=True)
        with report.results_folder(args.out, inputs=inputs) as folder:
            held = args.held_out and str(args.held_out)
            origin = report.provenance({**identity, "ignore": args.ignore, "held_out": held, **author_choices(args)})
            estimated = summary(estimate, judgement) | {"provenance": origin}
            numbers = {"estimate": estimated, "provenance": origin}
            written = Results({"base_parameters": table(estimate)}, numbers=numbers)
            refused = write_results(args, folder, written, (), _said(args, estimate, judgement, reading.notes))
    print(wrapped("\n".join([text(estimate, judgement), *reading.notes])))
    print(f"Everything is in {args.out}; open {PAGE}.")
    complain(refused)


def _said(args: argparse.Namespace, estimate: Fit, judged: Judged, notes: Sequence[str]) -> Said:
    """The page's text besides the table."""
    files = ", ".join(file.name for file in args.recordings)
    return Said(
        f"{args.model.name}, identified from {files} in pieces",
        verdict=judged.verdict,
        findings=[(finding.text, finding.doubt) for finding in judged.findings],
        lines=[*_lines(estimate, judged), *notes],
    )


def _reading(args: argparse.Namespace) -> Reading:
    """Reading of the mechanism and recordings that the options describe."""
    if GROUND in args.contact:
        raise InputError(f"--contact names wrenches besides the one at the base, got '{GROUND}'.")
    arm = mechanism(args.model, args.base, ignore=args.ignore, fix=options.fixed(args.fix), packages=args.packages)
    sensors = {name: Sensor(*arm.site(name), applied_to_link=False) for name in args.contact}
    seen, equations = Seen.of(arm.tree), Equations.of_wrench(arm)
    equations = with_offsets(equations) if args.offsets else equations
    limit, piece = options.size_limit(args), args.piece or PIECE
    return Reading(equations, args.recordings, args.columns, piece, sensors, args.without, limit, seen)


def _held_out(file: Path, reading: Reading, equations: Equations, pool: WorkerPool) -> Passed:
    """One pass over another recording."""
    other = replace(reading, files=[file], equations=equations, seen=Seen.of(equations.mechanism.tree))
    parts = in_order(pool.executor, partial(accumulate, equations), other, ahead=pool.ahead)
    with closing(parts):
        return Passed(other.seen, reduce(add, parts))


def _inputs(args: argparse.Namespace) -> list[Path]:
    """All input files."""
    inputs = [args.model, *args.recordings, *filter(None, [args.columns, args.held_out])]
    for file in inputs:
        if not file.is_file():
            raise InputError(f"There is no file '{file}'.")
    if args.held_out is not None and args.held_out.resolve() in [file.resolve() for file in args.recordings]:
        raise InputError("The log to judge by (--held-out) has to be another one than those that are fitted.")
    return inputs


def _lines(estimate: Fit, judged: Judged) -> list[str]:
    """Sentences with the main numbers."""
    rms = estimate.residual_norms / np.sqrt(estimate.samples)
    residuals = ", ".join(f"{name} {x:.3g}" for name, x in zip(COMPONENTS, rms, strict=True))
    ratios = ", ".join(f"{name} {x:.2g}" for name, x in judged.ratio.items())
    return [
        f"RMS residuals in N and N m: {residuals}",
        f"RMS residuals of {judged.part} samples over the channels' standard deviations: {ratios}",
        f"Condition number {estimate.condition_number:.1f}; {estimate.method}",
        *filter(None, [estimate.parameters.remark]),
    ]


def text(estimate: Fit, judged: Judged) -> str:
    """Text for the terminal."""
    return "\n".join(
        [
            table(estimate).text(),
            *_lines(estimate, judged),
            f"Verdict: {judged.verdict}",
            *(finding.line for finding in judged.findings),
        ]
    )


def _identity(args: argparse.Namespace) -> dict[str, Any]:
    """Settings that determine the accumulated sums."""
    stats = [(file.resolve(), file.stat()) for file in args.recordings]
    return {
        "model": hashlib.sha256(args.model.read_bytes()).hexdigest(),
        "columns": args.columns and hashlib.sha256(args.columns.read_bytes()).hexdigest(),
        "recordings": [f"{file}, {stat.st_size} bytes, {stat.st_mtime_ns}" for file, stat in stats],
        **{key: getattr(args, key) for key in ("base", "fix", "piece", "contact", "without", "offsets")},
    }
