"""Identifies base parameters of your own mechanism from your own recording, and says whether to believe them."""

import argparse
import os
from collections.abc import Iterator, Sequence
from concurrent.futures import Executor, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

from experiments.cli import options, running
from experiments.runs import one_thread_each
from ident.errors import InputError
from ident.setup import OWN

if TYPE_CHECKING:
    from experiments.document.writer import Document, Output
    from ident.estimate import Estimate
    from ident.estimation.preparation import Prepared

PRIOR = {"auto": None, "on": True, "off": False, **dict.fromkeys(("winter", "deleva", "dumas"), True)}
"""True if the bodies of the model or of a table of people are a prior; None to decide by the motion."""

PAYS = 30_000
"""Samples times joints above which several processes save more time than they take to start."""


def run(args: argparse.Namespace) -> None:
    """Identifies, and writes and prints the results."""
    from experiments.document.replay import RERUN, check_installed, write_rerun
    from experiments.document.typography import wrapped
    from experiments.document.writer import write
    from experiments.reports import identify_report

    if args.rerun:
        check_installed()
    folder = options.folder(args)
    replaced = options.of_replaced(args, folder)
    result, document, out = identified_from(args, folder)
    unwritten = identify_report.not_held(identify_report.updated_file(result.prepared.mechanism), result)
    if args.rerun and document.replay is not None:
        document = replace(document, files={**document.files, RERUN: partial(write_rerun, document.replay)})
    write(
        document,
        out,
        stale=identify_report.OUTPUTS,
        inputs=options.inputs(args),
        then=wrapped("\n".join(filter(None, [*unwritten, replaced]))),
        verbose=args.verbose,
    )


def identified_from(args: argparse.Namespace, folder: Path) -> tuple["Estimate", "Document", "Output"]:
    """The estimate of the options' logs, its document, and where that belongs.

    Raises:
        InputError: Something is missing or does not fit; the message names it.
    """
    from experiments.reports import identify_report
    from experiments.studies.user_files import following, prepare
    from ident.identification import identified

    read = reading(args)
    logs, judges = ([prepare(args.model, log, **read) for log in several] for several in (args.logs, args.held_out))
    fitting = {"offsets": args.offsets, "holdout": args.holdout, "own": tuple(args.own)}
    fitting |= {"known": PRIOR[args.prior], "physical": args.physical, "report": options.progress}
    with _workers(args, logs) as executor:
        result = identified(logs, estimator=args.estimator, judges=judges, executor=executor, **fitting)
    out, origin = options.output_of(args, folder), options.provenance(args, result.logs)
    document = identify_report.document(
        result, args.model, args.logs, origin, following(result), geometry=args.write_geometry
    )
    return result, document, out


def reading(args: argparse.Namespace) -> dict[str, Any]:
    """Arguments of `prepare`, by which the options' model and logs are read.

    Raises:
        InputError: Options contradict each other.
    """
    from ident.identification import NO_CUTOFF, check_choices

    check_choices(args.estimator, own=args.own, physical=args.physical)
    if args.estimator == "trajectory" and args.cutoff is not None:
        raise InputError(NO_CUTOFF)
    if args.write_geometry and args.estimator != "trajectory":
        raise InputError("--write-geometry needs the trajectory estimate, which locates joints: leave out --estimator.")
    if args.estimator != "trajectory" and args.gaps:
        raise InputError(
            "Samples may be missing (--gaps) for the trajectory estimate only: a filter would invent them."
        )
    read = {**options.of_model(args), "columns": args.columns, "cutoff": args.cutoff}
    read |= {"filters": args.estimator != "trajectory"}
    read |= {"drive": options.drives(args.drive), "leave_out": tuple(args.leave_out)}
    return read | {"limit": options.size_limit(args), "gaps": args.gaps, "person": _person(args)}


@contextmanager
def _workers(args: argparse.Namespace, logs: Sequence["Prepared"]) -> Iterator[Executor | None]:
    """Processes or threads for the pieces of the trajectory estimate; None if one is enough."""
    work, number = sum(log.samples.motion.q.size for log in logs), args.workers or os.cpu_count() or 1
    if args.estimator != "trajectory" or number == 1:
        yield None
    elif args.workers or work >= PAYS:
        from experiments.runs.workers import worker_pool

        with worker_pool(number) as executor:
            yield executor
    elif one_thread_each():
        with ThreadPoolExecutor(number) as threads:
            yield threads
    else:
        yield None


def _person(args: argparse.Namespace) -> Any:
    """The person whose segments the bodies are; None if the prior is the model's."""
    from ident.parameters.person_prior import TABLES, Person

    given = {"--mass": args.mass, "--height": args.height, "--sex": args.sex}
    if args.prior not in TABLES:
        if stated := [option for option, value in given.items() if value is not None]:
            raise InputError(f"{stated[0]} belongs to a table of people, --prior {', '.join(TABLES)}.")
        return None
    if missing := [option for option, value in given.items() if value is None]:
        raise InputError(f"--prior {args.prior} needs {', '.join(given)}; {', '.join(missing)} is missing.")
    return Person(args.prior, args.mass, args.height, args.sex)


def _estimator(name: str) -> str:
    """Name of an estimator, of which `joint` is a former one."""
    return "trajectory" if name == "joint" else name


IDENTIFICATION: options.Options = {
    **options.MECHANISM,
    "--held-out": ("other logs to judge by, which are not fitted", options.FILES),
    **options.READING,
    "--cutoff": (
        "of least squares: cut-off of the low-pass in Hz, or 'auto'; by default the log's own derivatives if any",
        {},
    ),
    "--holdout": ("fraction of the recording kept to judge by; 0 judges by all", options.HELD_BACK),
    "--estimator": (
        "trajectory: motion, parameters, set-up and noise at once, from joint angles; weighted: least squares, "
        "channels weighted by their residuals and outliers down; ordinary: the paper's least squares",
        {"type": _estimator, "choices": ("trajectory", "weighted", "ordinary"), "default": "trajectory"},
    ),
    "--gaps": ("samples may be missing, as empty cells or rows: for the trajectory estimate", options.FLAG),
    "--own": ("what each of several logs has for itself", {**options.NAMES, "choices": OWN}),
    "--prior": (
        "whether the model's bodies are a prior, with standard deviations; auto: where the motion does not separate "
        "all parameters, or left-out pieces are predicted better; winter, deleva, dumas: bodies by these tables of "
        "people",
        {"choices": PRIOR, "default": "auto"},
    ),
    "--physical": ("fit physical bodies, as close to the model's as the logs allow", options.FLAG),
    "--write-geometry": ("write where joints were found to lie into the updated model, too", options.FLAG),
    "--mass": ("mass of the person, kg, for a table of people", {"type": options.POSITIVE}),
    "--height": ("height of the person, m, for a table of people", {"type": options.POSITIVE}),
    "--sex": ("sex of the person, for a table of people", {"choices": ("female", "male")}),
    **options.drive("auto"),
    "--leave-out": (
        "channels that are neither fitted nor judged: Fx to Mz of the total wrench, joints for their torques; as "
        "Fz Mx My, which a model that moves in a plane across z cannot explain",
        {**options.NAMES, "metavar": "CHANNEL"},
    ),
}
"""Options of an identification."""

OPTIONS: options.Options = {
    **options.output("results", "svg"),
    **options.MODEL,
    **options.logs("several share their parameters"),
    "--name": ("name of the folder under --out, by default made of the files' names", {}),
    "--verbose": ("print more than a screen: remarks, notes and bodies", options.FLAG),
    **IDENTIFICATION,
    "--rerun": ("write the replay for Rerun's viewer too, replay.rrd (extra 'rerun')", options.FLAG),
    **options.workers(
        None, " of the trajectory estimate; by default one for each processor if recordings are long, else threads"
    ),
}
"""Options of the command."""

parser, main = running.command(__name__, "experiments.identify", __doc__, run, OPTIONS)
