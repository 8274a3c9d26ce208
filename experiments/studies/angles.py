"""Joint angles of a trial from its markers, from the files to the results."""

import argparse
import shlex
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path

import numpy as np

from experiments.cli import options
from experiments.cli.print_options import layout_of
from experiments.document import report
from experiments.document.page import PAGE, complain
from experiments.reports import angles_report
from ident.errors import InputError
from ident.estimation.equations import channels_out_of_plane
from ident.files.marker_files import read_markers
from ident.files.markers import Markers
from ident.recordings.recording import Recording
from sim.markers.lengths import Scaling, grouped, scaling
from sim.markers.marked_model import MarkedModel, base_of, marked_model, marked_positions
from sim.markers.recording import recording
from sim.markers.settings import Settings, read_settings
from sim.markers.swaps import Swap, swaps
from sim.markers.trial_fit import Postures, check_fit, fit_trial
from sim.models.mechanism import mechanism
from sim.models.opensim.mechanism import is_opensim


@dataclass(frozen=True, eq=False)
class Angles:
    """Fitted angles of a trial.

    Attributes:
        markers: The markers of the file.
        unmatched: Labels without a site.
        postures: Fitted postures.
        swaps: Markers whose labels seem exchanged.
        base: Body whose frame is {0}; None for the world.
        recording: Joint positions, their noise and the base's poses.
        scaling: Lengths of segments; None for the model's.
    """

    markers: Markers
    unmatched: tuple[str, ...]
    postures: Postures
    swaps: tuple[Swap, ...]
    base: str | None
    recording: Recording
    scaling: Scaling | None


def run(args: argparse.Namespace) -> None:
    """Fits a trial, and writes and prints the results."""
    _check(args)
    found = study(args)
    inputs = [
        path for path in (args.model, args.markers, args.places, args.scale_from, args.wrenches) if path is not None
    ]
    given = {key: str(value) if isinstance(value, Path) else value for key, value in vars(args).items()}
    with report.results_folder(args.out, stale=angles_report.OUTPUTS, inputs=inputs) as folder:
        origin, layout = report.provenance(given), layout_of(args)
        refused = angles_report.write(found, folder, args.model, args.markers, origin, args.formats, layout)
    print(angles_report.text(found))
    print(f"Everything is in {args.out}; open {PAGE}.")
    print(f"With forces of plates on the same clock, then:\n{_identify(args, found)}")
    complain(refused)


def _identify(args: argparse.Namespace, found: Angles) -> str:
    """The command to run next."""
    log = f"{args.out / 'angles.csv'}" + ("" if args.wrenches else "+PLATES.mot")
    words = [
        "python",
        "-m",
        "experiments.identify",
        str(args.model),
        log,
        *(["--base", found.base] if found.base else []),
    ]
    words += [word for fixed in args.fix for word in ("--fix", *fixed)]
    words += [word for name in found.postures.undetermined for word in ("--fix", name)]
    sideways = () if found.base else channels_out_of_plane(mechanism(args.model, fix=options.fixed(args.fix)))
    return shlex.join([*words, *(["--leave-out", *sideways] if sideways else [])])


def study(args: argparse.Namespace) -> Angles:
    """Fit of the trial that the options describe."""
    settings = read_settings(args.places) if args.places is not None else Settings()
    fix = options.fixed(args.fix)
    markers = read_markers(args.markers, settings.unit)
    marked, unmatched = marked_model(args.model, markers.labels, settings.places, fix)
    base = base_of(marked.model, args.base)
    positions = marked_positions(markers, unmatched, marked, settings.up)
    lengths = None
    if args.scale:
        own = (marked, positions) if args.scale_from is None else _other_trial(args, settings)
        lengths = _scaling(*own, settings, args)
        marked = marked.with_lengths(lengths.model)
    postures = fit_trial(marked, positions)
    check_fit(postures)
    source = {"markers": str(args.markers), "model": str(args.model), "base": base, "sigma_m": _number(postures.sigma)}
    felt = None if args.wrenches is None else _wrenches(args.wrenches)
    trial = recording(postures, markers.time, base, source, felt)
    trial = replace(trial, notes=(*trial.notes, *_constraint_note(marked)))
    found = tuple(swaps(postures, positions))
    return Angles(markers, tuple(unmatched), postures, found, base, trial, lengths)


def _check(args: argparse.Namespace) -> None:
    """Checks that options do not contradict each other."""
    if args.scale and is_opensim(args.model):
        raise InputError("--scale needs an MJCF or URDF model; let OpenSim's Scale Tool scale an OpenSim model.")
    for option in ("symmetric", "scale_from", "mass"):
        if getattr(args, option) and not args.scale:
            raise InputError(f"--{option.replace('_', '-')} is about lengths that --scale finds; give --scale as well.")
    if args.mass is not None and not (isfinite(args.mass) and args.mass > 0):
        raise InputError(f"--mass needs a positive number of kg, got {args.mass}.")


def _wrenches(path: Path) -> Recording:
    """A recording with wrenches."""
    felt = Recording.load(path)
    if not felt.wrenches:
        raise InputError(f"{path}: no wrench is in this file; it needs columns NAME_force.x to NAME_torque.z.")
    return felt


def _other_trial(args: argparse.Namespace, settings: Settings) -> tuple[MarkedModel, np.ndarray]:
    """Model and marker positions of the trial that lengths are estimated from."""
    markers = read_markers(args.scale_from, settings.unit)
    marked, unmatched = marked_model(args.model, markers.labels, settings.places, options.fixed(args.fix))
    return marked, marked_positions(markers, unmatched, marked, settings.up)


def _scaling(marked: MarkedModel, positions: np.ndarray, settings: Settings, args: argparse.Namespace) -> Scaling:
    groups = grouped(marked.model, settings.groups, alike=args.symmetric)
    total = float(marked.model.body_mass.sum())
    if args.mass is not None and total == 0:
        raise InputError("--mass needs bodies that have masses; those of this model have none.")
    return scaling(marked, positions, groups, 1.0 if args.mass is None else args.mass / total)


def _constraint_note(marked: MarkedModel) -> list[str]:
    """A note on equality constraints, if the model has some."""
    if not marked.model.neq:
        return []
    return [f"The model's equality constraints ({marked.model.neq}) are not kept: joints follow the markers alone."]


def _number(value: float) -> float | None:
    """A number for JSON, None if not finite."""
    return value if isfinite(value) else None
