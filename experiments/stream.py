"""Base parameters from recordings of any length, read and worked on piece by piece."""

import argparse
import hashlib
import json
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import closing
from dataclasses import dataclass
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

from experiments.cli import options
from experiments.output import report
from experiments.runs.checkpoint import SAVE_EVERY
from experiments.runs.workers import worker_pool
from experiments.studies.one_pass import Judged, Seen, judged
from experiments.studies.preparation import COMPONENTS
from ident.errors import InputError
from ident.estimation.accumulator import Accumulator, accumulate
from ident.estimation.estimate import PIECE, Estimate, solve
from ident.estimation.in_order import in_order
from ident.estimation.samples import Samples, pieces
from ident.mechanism.tree import Tree
from ident.parameters.base_parameters import BaseParameters, find_base_parameters
from ident.recordings import npz
from ident.recordings.atomic import save_arrays
from ident.recordings.recording import Recording
from ident.recordings.wrench import Contact, total_wrench
from sim.models.mujoco_model import compiled, gravity_in_base, parameters_from_model, site_on_tree, tree_from_model

FILE = "accumulated.npz"
"""File in the output folder that keeps what has been read."""

OUTPUTS = (FILE, "estimate.json", *(f"base_parameters.{suffix}" for suffix in ("csv", "md", "tex")))
"""All files that are written."""


@dataclass(frozen=True, eq=False)
class Progress:
    """What is known of the pieces read so far, kept in a file.

    Attributes:
        file: Where it is kept.
        identity: What decides the result, as JSON has it.
        found: Accumulator of the pieces, None before the first.
        done: Number of pieces.
    """

    file: Path
    identity: Mapping[str, Any]
    found: Accumulator | None = None
    done: int = 0

    def resumed(self, parameters: BaseParameters) -> "Progress":
        """The progress of an earlier run on these parameters.

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
            columns = (parameters.rank + 1,) * 2
            whole = (found.factor.shape, found.grams.shape) == (columns, (6, *columns)) and done > 0
            whole = whole and bool(np.isfinite([*found.factor, *found.gram]).all())
            if not different and not (whole and found.names == parameters.names):
                raise InputError("damaged")
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError) as error:
            raise InputError(f"--resume needs what an earlier run left in {self.file} ({error}).") from None
        if different:
            raise InputError(f"{self.file} is of another run: {', '.join(different)} differ; leave out --resume.")
        return Progress(self.file, self.identity, found, done)

    def and_piece(self, part: Accumulator) -> "Progress":
        """With one piece more."""
        found = part if self.found is None else self.found + part
        return Progress(self.file, self.identity, found, self.done + 1)

    def save(self) -> None:
        """Writes the file anew."""
        save_arrays(self.file, {"identity": json.dumps(self.identity), "done": self.done, **vars(self.found)})


@dataclass(frozen=True, eq=False)
class Reading:
    """What is read, and how it becomes samples.

    Attributes:
        tree: The mechanism.
        files: Recordings, one after the other.
        piece: Samples read at a time.
        contacts: Body and pose of the sensor of each wrench besides the ground's, by its name.
        without: Names of wrenches to leave out.
        limit: Bytes that a piece of a npz file may take in memory.
        seen: What has been seen of the channels.
    """

    tree: Tree
    files: Sequence[Path]
    piece: int
    contacts: Mapping[str, tuple[str, np.ndarray]]
    without: Sequence[str]
    limit: int
    seen: Seen

    def __iter__(self) -> Iterator[Samples]:
        """Pieces of all files, checked against the mechanism.

        Raises:
            InputError: A file is no recording of this mechanism.
        """
        for file in self.files:
            try:
                recordings = Recording.chunks(file, samples=self.piece, limit=self.limit)
                yield from pieces(map(self._samples, recordings), self.tree)
            except ValueError as error:
                raise InputError(str(error) if str(file) in str(error) else f"{file}: {error}") from None

    def _samples(self, recording: Recording) -> Samples:
        unknown = [name for name in recording.wrenches if name not in ("ground", *self.contacts, *self.without)]
        if unknown:
            raise InputError(
                f"the recording holds the wrench '{unknown[0]}' besides the ground's: say --contact {unknown[0]} if a "
                f"site of that name holds its sensor, or --without {unknown[0]} to leave it out."
            )
        for joint in self.tree.joints:
            if f"{joint}_position" not in recording.measured:
                raise InputError(
                    f"the recording has no channel '{joint}_position'; it has {', '.join(sorted(recording.measured))}. "
                    f"Where the joint does not move, --fix {joint} [VALUE] leaves it out."
                )
        self.seen.check(recording)
        states = recording.joint_states(self.tree.joints)
        held = [Contact(body, recording.wrench(name), pose) for name, (body, pose) in self.contacts.items()]
        total = total_wrench(self.tree, states[0], recording.wrench("ground"), held).wrench
        self.seen.add(recording, total)
        return Samples(*states, total)


def accumulated(
    progress: Progress,
    reading: Reading,
    gravity: np.ndarray,
    parameters: BaseParameters,
    *,
    executor: Executor,
    ahead: int | None = None,
) -> Accumulator:
    """What all pieces give, those included that an earlier run has done.

    Args:
        progress: What is done, and where it is kept.
        reading: What is read.
        gravity: Acceleration of gravity in the base frame, m/s² (3,).
        parameters: Regrouping of the mechanism's parameters.
        executor: Who works on the pieces.
        ahead: Number of pieces to submit ahead, as for `in_order`.

    Raises:
        InputError: A piece does not fit; the pieces done before are in the file.
    """
    start = progress.done
    work = partial(accumulate, reading.tree, gravity=gravity, parameters=parameters)
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
        raise InputError("The recordings hold no samples.")
    progress.save()
    return progress.found


def table(estimate: Estimate) -> report.Table:
    """Base parameters with their standard deviations, one pass knowing those of white noise only."""
    return report.Table(
        f"Base parameters from {estimate.samples} samples, kg, kg m and kg m²; std of wrench noise, {estimate.noise}",
        *report.columns(
            parameter=estimate.names,
            estimated=estimate.psi,
            std_white_noise=estimate.std,
            regrouping=estimate.parameters.expressions(digits=4),
        ),
        decimals=4,
    )


def summary(estimate: Estimate, judged: Judged) -> dict[str, Any]:
    """Everything about the estimate for scripts."""
    arrays = ("psi", "std", "covariance", "singular_values", "residual_norms")
    return {
        "verdict": judged.verdict,
        "findings": [vars(finding) for finding in judged.findings],
        "residual_ratio": dict(judged.ratio),
        "names": list(estimate.names),
        **{key: getattr(estimate, key).tolist() for key in arrays},
        "condition_number": estimate.condition_number,
        "samples": estimate.samples,
        "rows": estimate.rows,
        "method": estimate.method,
        "noise": estimate.noise,
    }


def run(args: argparse.Namespace) -> None:
    """Identifies, and writes and prints what was found."""
    identity = _identity(args)
    model = compiled(args.model)
    tree = tree_from_model(model, args.base, ignore=args.ignore, fix=options.fixed(args.fix))
    gravity = gravity_in_base(model, args.base)
    contacts = {name: site_on_tree(model, name, args.base) for name in args.contact}
    seen = Seen.of(tree, ["ground", *contacts])
    prior, parameters = parameters_from_model(model, args.base), find_base_parameters(tree, gravity=gravity)
    limit = 1_000_000 * args.max_size
    reading = Reading(tree, args.recordings, args.piece, contacts, args.without, limit, seen)
    inputs = (args.model, *args.recordings)
    report.check_inputs((args.out / name for name in OUTPUTS), inputs)
    with report.unused_vanish(args.out):
        with report.results_folder(args.out):
            pass  # Refused before the work if it cannot be written.
        progress = Progress(args.out / FILE, identity)
        if args.resume:
            progress = progress.resumed(parameters)
        with worker_pool(args.workers, args.scheduler, args.tls) as pool:
            found = accumulated(progress, reading, gravity, parameters, executor=pool.executor, ahead=pool.ahead)
        estimate = solve(found, parameters)
        judgement = judged(seen, found, estimate, prior, gravity)
        with report.results_folder(args.out, inputs=inputs) as folder:
            table(estimate).write(folder, "base_parameters")
            origin = report.provenance({**identity, "ignore": args.ignore}, {})
            report.write_json(folder / "estimate.json", summary(estimate, judgement) | {"provenance": origin})
    print(text(estimate, judgement))
    print(f"Tables and estimate.json are in {args.out}.")


def text(estimate: Estimate, judged: Judged) -> str:
    """What the terminal shows."""
    rms = estimate.residual_norms / np.sqrt(estimate.samples)
    residuals = ", ".join(f"{name} {x:.3g}" for name, x in zip(COMPONENTS, rms, strict=True))
    ratios = ", ".join(f"{name} {x:.2g}" for name, x in judged.ratio.items())
    return "\n".join(
        [
            table(estimate).text(),
            f"RMS residuals in N and N m: {residuals}",
            f"RMS residuals over the channels' standard deviations: {ratios}",
            f"Condition number {estimate.condition_number:.1f}; {estimate.method}",
            *filter(None, [estimate.parameters.remark]),
            f"Verdict: {judged.verdict}",
            *(finding.line for finding in judged.findings),
        ]
    )


def _identity(args: argparse.Namespace) -> dict[str, Any]:
    """What decides the result."""
    for file in (args.model, *args.recordings):
        if not file.is_file():
            raise InputError(f"There is no file '{file}'.")
    stats = [(file.resolve(), file.stat()) for file in args.recordings]
    return {
        "model": hashlib.sha256(args.model.read_bytes()).hexdigest(),
        "recordings": [f"{file}, {stat.st_size} bytes, {stat.st_mtime_ns}" for file, stat in stats],
        **{key: getattr(args, key) for key in ("base", "fix", "piece", "contact", "without")},
    }


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.command_parser("stream", __doc__)
    out.add_argument("model", type=Path, help="MJCF or URDF file")
    out.add_argument(
        "recordings",
        type=Path,
        nargs="+",
        help="CSV or npz files with the channels JOINT_position, JOINT_velocity, JOINT_acceleration of every joint, "
        "ground_force and ground_torque",
    )
    options.add_mechanism(out)
    out.add_argument("--contact", nargs="*", default=[], help="wrenches at the sites of the same names")
    out.add_argument("--without", nargs="*", default=[], help="wrenches to leave out")
    out.add_argument("--piece", type=options.whole_number(1, 10_000_000), default=PIECE, help="samples read at a time")
    options.add_max_size(out)
    options.add_workers(out.add_argument_group("workers"))
    return out


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return options.run(run, parser(), argv)


if __name__ == "__main__":
    sys.exit(main())
