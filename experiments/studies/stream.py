"""Base parameters from recordings of any length, read and processed piece by piece."""

import hashlib
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

from experiments.data.outcomes import Streamed
from experiments.runs.checkpoint import SAVE_EVERY
from experiments.runs.workers import WorkerPool
from experiments.studies.one_pass import Passed, Statistics, evidence_of, separated, with_offsets
from experiments.studies.stream_progress import Progress
from ident.errors import InputError, LogError
from ident.estimation.accumulator import Accumulator, accumulate
from ident.estimation.equations import COMPONENTS, Equations
from ident.estimation.pieces import in_order, pieces
from ident.estimation.samples import Samples
from ident.files import limits
from ident.judgement.judges import findings
from ident.mechanism.motion import Motion
from ident.mechanism.tree import Tree
from ident.recordings.columns.mapping import read_mapping
from ident.recordings.log import read_log_pieces
from ident.recordings.recording import Recording
from ident.recordings.wrench import GROUND, Sensor
from ident.regression.ordinary import PIECE, huber_white, solve
from sim.models.mechanism import mechanism


@dataclass(eq=False)
class Overview:
    """Statistics of the channels of recordings, from one pass over them.

    Attributes:
        statistics: Statistics of the channels.
        notes: Sentences on the files.
        samples: Numbers of samples of the files, in order.
    """

    statistics: Statistics
    notes: list[str] = field(default_factory=list)
    samples: list[int] = field(default_factory=list)

    @classmethod
    def of(cls, tree: Tree) -> "Overview":
        """Overview before the first sample, errors as for `Statistics.of`."""
        return cls(Statistics.of(tree))

    def add(self, recording: Recording, total: np.ndarray) -> None:
        """Adds a piece and its total wrench (N, 6)."""
        self.statistics.add(recording, total, self.statistics.samples - sum(self.samples))
        self.notes.extend(note for note in recording.notes if note not in self.notes)


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
    """

    equations: Equations
    files: Sequence[Path]
    columns: Path | None
    piece: int
    sensors: Mapping[str, Sensor]
    without: Sequence[str]
    limit: int

    def __iter__(self) -> Iterator[Samples]:
        """Yields pieces of all files, checked against the mechanism, errors as for `viewed`."""
        return self._pieces(None)

    def viewed(self, overview: Overview) -> Iterator[Samples]:
        """Yields pieces of all files, checked against the mechanism, and adds each to an overview.

        Raises:
            LogError: A file is not a recording of this mechanism.
        """
        return self._pieces(overview)

    def again(self, overview: Overview) -> Iterator[Samples]:
        """Yields the pieces once more, after an overview of all.

        Raises:
            LogError: A file has another number of samples by now.
        """
        for file, samples in zip(self.files, overview.samples, strict=True):
            read = 0
            for piece in replace(self, files=[file]):
                read += len(piece)
                yield piece
            if read != samples:
                raise LogError(
                    f"{file}: it changed while it was read, from {samples} samples to {read}; run again when nothing "
                    "writes to it any more.",
                    file,
                )

    def _pieces(self, overview: Overview | None) -> Iterator[Samples]:
        samples = partial(self._samples, Statistics.of(self.equations.mechanism.tree), overview)
        for file in self.files:
            read = 0
            try:
                if self.columns is None:
                    recordings = Recording.chunks(file, self.piece, limit=self.limit)
                else:
                    recordings = read_log_pieces(
                        file, self.equations.mechanism, self.columns, self.piece, limit=self.limit
                    )
                for piece in pieces(map(samples, recordings), self.equations):
                    read += len(piece)
                    yield piece
                if overview is not None:
                    overview.samples.append(read)
            except InputError as error:
                if isinstance(error, LogError) and error.file == file:
                    raise
                raise LogError(f"{file}: {error}", file) from None

    def _samples(self, empty: Statistics, overview: Overview | None, recording: Recording) -> Samples:
        """Samples of a piece, checked by statistics and added to an overview."""
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
                placed = [name for name in tree.joints if f"{name}_position" in recording.measured]
                leads = self.equations.mechanism.determined(placed).get(joint)
                rest = f"Where the joint does not move, --fix {joint} [VALUE] leaves it out."
                raise LogError(
                    f"the recording has no channel '{joint}_position'; it has {', '.join(sorted(recording.measured))}. "
                    + (f"`multicontact identify` takes it from {leads}." if leads else rest)
                )
        if recording.base is not None:
            raise LogError(
                "the base moves, and its poses take a filter over all of the log: `multicontact identify` has one"
            )
        empty.check(recording, names)
        wrench = recording.total_wrench(tree, self.without)
        if missing := [name for name, x in zip(COMPONENTS, wrench.values.T, strict=True) if np.isnan(x).any()]:
            raise LogError(
                f"the ground's wrench needs all six components here, but {', '.join(missing)} of it is missing; "
                "`multicontact identify` takes fewer."
            )
        total = wrench.in_base
        if overview is not None:
            overview.add(recording, total)
        return Samples(Motion(*recording.joint_states(tree.joints)), total)


def accumulated(
    progress: Progress,
    reading: Reading,
    overview: Overview,
    *,
    executor: Executor,
    ahead: int | None = None,
) -> Accumulator:
    """Accumulator of all pieces, including those of an earlier run.

    Args:
        progress: The progress so far.
        reading: The recordings.
        overview: Overview, to which every piece is added.
        executor: Executor for the pieces.
        ahead: Number of pieces to submit ahead, as for `in_order`.

    Raises:
        LogError: A piece does not fit; the pieces done before are in the file.
    """
    start = progress.done
    work = partial(accumulate, reading.equations)
    saved = time.monotonic()
    try:
        with closing(in_order(executor, work, islice(reading.viewed(overview), start, None), ahead=ahead)) as parts:
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
    if progress.accumulator is None:
        raise LogError("The recordings hold no samples.")
    progress.save()
    return progress.accumulator


def reading(
    model: Path,
    recordings: Sequence[Path],
    *,
    contact: Sequence[str] = (),
    without: Sequence[str] = (),
    columns: Path | None = None,
    offsets: bool = True,
    piece: int | None = None,
    limit: int = limits.LIMIT,
    **stated: Any,
) -> Reading:
    """Reading of recordings of a model.

    Args:
        model: Model file.
        recordings: Recordings in order.
        contact: Wrenches at the sites of the same names.
        without: Wrenches to leave out.
        columns: As for `Reading`, also `limit`.
        offsets: True to fit constant offsets.
        piece: Samples read at a time.
        stated: Further arguments of `sim.mechanism`.

    Raises:
        InputError: The model cannot be read, or lacks a site.
    """
    if GROUND in contact:
        raise InputError(f"--contact names wrenches besides the one at the base, got '{GROUND}'.")
    arm = mechanism(model, **stated)
    if columns is not None and (rpy := read_mapping(columns, arm.tree).base_rpy_deg) is not None:
        arm = arm.mounted(rpy)
    sensors = {name: Sensor(*arm.site(name), applied_to_link=False) for name in contact}
    Statistics.of(arm.tree)  # Refuses what one pass does not support.
    equations = Equations.of_wrench(arm)
    equations = with_offsets(equations) if offsets else equations
    return Reading(equations, recordings, columns, piece or PIECE, sensors, without, limit)


def identity(
    model: Path, columns: Path | None, recordings: Sequence[Path], settings: Mapping[str, Any]
) -> dict[str, Any]:
    """Settings that determine the accumulated sums: contents of files, and other settings."""
    stats = [(file.resolve(), file.stat()) for file in recordings]
    return {
        "model": hashlib.sha256(model.read_bytes()).hexdigest(),
        "columns": columns and hashlib.sha256(columns.read_bytes()).hexdigest(),
        "recordings": [{"file": str(file), "bytes": x.st_size, "modified_ns": x.st_mtime_ns} for file, x in stats],
        **settings,
    }


def streamed(progress: Progress, reading: Reading, pool: WorkerPool, held_out: Path | None = None) -> Streamed:
    """Estimate of all pieces, including those of an earlier run.

    Args:
        progress: The progress so far.
        reading: The recordings.
        pool: Workers for the pieces.
        held_out: Another recording to judge by.

    Raises:
        LogError: A piece does not fit; the pieces done before are in the file.
    """
    overview = Overview.of(reading.equations.mechanism.tree)
    whole = accumulated(progress, reading, overview, executor=pool.executor, ahead=pool.ahead)
    fitted, equations = separated(whole, reading.equations)
    first = solve(fitted, equations)
    other = None if held_out is None else _held_out(held_out, reading, equations, pool, overview.notes)
    evidence = evidence_of(Passed(overview.statistics, fitted), first, other)
    estimate = huber_white(first, reading.again(overview), steady=True)
    judged = findings(evidence)
    return Streamed(estimate, replace(evidence, fit=estimate, offsets=estimate.offsets), judged, overview.notes)


def _held_out(file: Path, reading: Reading, equations: Equations, pool: WorkerPool, notes: list[str]) -> Passed:
    """One pass over another recording, whose notes join those given."""
    other = replace(reading, files=[file], equations=equations)
    overview = Overview(Statistics.of(equations.mechanism.tree), notes)
    parts = in_order(pool.executor, partial(accumulate, equations), other.viewed(overview), ahead=pool.ahead)
    with closing(parts):
        return Passed(overview.statistics, reduce(add, parts))
