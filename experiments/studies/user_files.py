"""Reading and preparation of a user's model and log, and joint angles of a trial from its markers."""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import numpy as np

from ident.errors import InputError, LogError, ModelError, about
from ident.estimate import Estimate
from ident.estimation.preparation import Prepared, prepared
from ident.files.limits import LIMIT
from ident.files.markers import Markers
from ident.files.readers import files_of, read_markers
from ident.mechanism.mechanism import Mechanism
from ident.parameters.person_prior import Person, with_person
from ident.recordings.log import read_log
from ident.recordings.recording import Recording
from ident.recordings.stated import read_segments
from sim.models.couplings import check_torques
from sim.models.model_mechanism import Origin, mechanism
from sim.models.mujoco_model import mechanism_bodies
from sim.models.opensim_model import is_opensim
from sim.simulation.stepped import rolled_out

if TYPE_CHECKING:
    from sim.markers.lengths import Scaling
    from sim.markers.marked_model import MarkedModel, Settings
    from sim.markers.trial_fit import Postures
    from sim.markers.trial_recording import Swap

MARKERS = ".trc"
"""Suffix of files that hold only markers."""


@contextmanager
def with_angles(
    source: Path, log: Path, base: str | None = None, fix: Mapping[str, Sequence[float]] | None = None
) -> Iterator[tuple[Path, list[str]]]:
    """Yields a log in which files of fitted angles replace those of markers, for the duration of a block.

    Args:
        source: MJCF, URDF or OpenSim file, whose sites or markers are named like the labels.
        log: The log, one file or several joined by `+`.
        base: Body whose frame is {0}.
        fix: Joints that do not move.

    Yields:
        The log to read, unchanged if it has no markers, and sentences on the fit.

    Raises:
        ModelError: The model cannot be read.
        InputError: The markers do not belong to the model, or do not determine a joint that is not fixed.
        LogError: A file of markers is missing or damaged, or the block raises one for any file.
    """
    if not any(file.suffix.lower() == MARKERS for file in files_of(log)):
        yield log, []
        return
    with TemporaryDirectory() as folder:
        files, notes = [], list[str]()
        for file in files_of(log):
            if file.suffix.lower() == MARKERS:
                notes += _fitted(source, file, base, fix or {}, angles := Path(folder) / f"{file.stem}.csv")
                file = angles
            files.append(str(file))
        try:
            yield Path("+".join(files)), notes
        except LogError as error:
            raise LogError(str(error).replace("+".join(files), str(log))) from None


def _fitted(source: Path, file: Path, base: str | None, fix: Mapping[str, Sequence[float]], out: Path) -> list[str]:
    """Writes the angles of a trial, and returns sentences on the fit."""
    # Imported here because few logs have markers.
    from sim.markers.marked_model import Settings, base_of
    from sim.markers.trial_fit import check_fit, fit_trial
    from sim.markers.trial_recording import recording

    markers, unmatched, marked, positions = _marked(source, file, Settings(), fix)
    postures = fit_trial(marked, positions)
    with about(file):
        check_fit(postures)
    trial = recording(postures, markers.time, base_of(marked.model, base) if base else None)
    still = postures.undetermined
    if still:
        raise InputError(
            f"{file}: the markers do not determine {', '.join(still)}; leave what they do not tell of out by "
            f"{' '.join(f'--fix {name}' for name in still)}."
        )
    trial.save(out)
    left_out = f" No marker of the model is called {', '.join(unmatched)}." if unmatched else ""
    return [
        f"Angles are fitted to {len(marked.labels)} markers of {file.name}, with noise of {1e3 * postures.sigma:.2g} "
        f"mm in each coordinate; `multicontact angles` says more of that.{left_out}",
        *trial.notes,
    ]


@dataclass(frozen=True, eq=False)
class Following:
    """Errors of simulated coordinates, by joint.

    Attributes:
        joints: Names of the joints.
        units: Their units, `rad` or `m`.
        before: RMS error of the model as it came (n,); NaN if its simulation diverged.
        after: RMS error of the updated model (n,).
        seconds: Simulated time, s.
    """

    joints: tuple[str, ...]
    units: tuple[str, ...]
    before: np.ndarray
    after: np.ndarray
    seconds: float

    @property
    def ratio(self) -> np.ndarray:
        """Error of the updated model over that of the model as it came (n,)."""
        return self.after / np.maximum(self.before, 1e-300)

    @property
    def better(self) -> int:
        """Number of joints that the updated model follows better."""
        return int((self.after < np.where(np.isnan(self.before), np.inf, self.before)).sum())


def following(result: Estimate) -> Following | None:
    """Errors of simulated coordinates on what was held out of the first recording, else on its end.

    The model as it came takes the commands as they are logged; the updated one with the estimated lag. None unless
    every joint of the model has a command.
    """
    log, mechanism = result.prepared, result.prepared.mechanism
    if set(log.recording.servos) != set(mechanism.tree.joints):
        return None
    # After the fitted samples, else of all.
    samples, rate = len(result.prepared.samples), log.recording.rate
    first = result.part.stop if samples - result.part.stop > 1 else 0
    # Beyond half a minute errors of joints without a restoring force only add up.
    held = slice(first, min(samples, first + round(30 * rate)))
    recording, rates = part_of(log.recording, held), log.samples.motion.dq[held.start]
    lag = next((each.value for each in result.setup if each.name == "lag"), 0.0)
    phi, drives = result.consistent().phi, result.drives_updated
    try:
        before = rolled_out(mechanism, recording, rates=rates)
        after = rolled_out(
            mechanism, replace(recording, servos=result.servos), rates=rates, phi=phi, drives=drives, lag=lag
        )
    except (InputError, ModelError):
        return None
    measured = recording.of_joints(mechanism.tree.joints, "position")
    turns = {body.joint: body.turns for body in mechanism.tree.bodies if body.joint}
    units = tuple("rad" if turns[joint] else "m" for joint in mechanism.tree.joints)
    old, new = (np.sqrt(((q - measured) ** 2).mean(axis=0)) for q in (before, after))
    return Following(mechanism.tree.joints, units, old, new, float(np.ptp(recording.time)))


def part_of(recording: Recording, part: slice) -> Recording:
    """Part of a recording at its common times."""
    measured = {name: x[part] for name, x in recording.measured.items()}
    base = None if recording.base is None else recording.base[part]
    return replace(recording, time=recording.time[part], measured=measured, true={}, streams={}, base=base)


def prepare(
    source: Path,
    log_path: Path,
    *,
    columns: Path | None = None,
    cutoff: str | float | None = None,
    filters: bool = True,
    drive: Sequence[str] | None = None,
    leave_out: Sequence[str] = (),
    limit: int = LIMIT,
    gaps: bool = False,
    person: Person | None = None,
    **model: Any,
) -> Prepared:
    """Reads a model and a log.

    Args:
        source: MJCF, URDF or OpenSim file.
        log_path: A file that `read_log` reads; markers of a .trc file become angles first.
        columns: Mapping of the log's columns.
        cutoff: As for `prepared`, also `filters` and `leave_out`.
        drive: As for `prepared`.
        limit: Bytes that an archive may take in memory.
        gaps: True if samples may be missing.
        person: Person whose bodies these are, from a table instead of the model; `columns` assigns the segments.
        model: Further arguments of `sim.mechanism`; joints that `fix` holds are not in the log.

    Raises:
        InputError: Something is missing or does not fit; the message names it.
    """
    base, fix = model.get("base"), model.get("fix")
    arm = read_mechanism(source, person=person, columns=columns, **model)
    with with_angles(source, log_path, base, fix) as (angles_path, notes):
        log = read_log(angles_path, arm, columns, gaps=gaps, limit=limit)
    log = replace(log, notes=(*notes, *log.notes))
    if person is not None:
        bodies = ", ".join(name for name in arm.bodies if name in arm.prior_known)
        whose = f"a {person.sex} person of {person.mass:g} kg and {person.height:g} m"
        note = f"The model's {bodies} are taken from the table '{person.table}', of {whose}."
        log = replace(log, notes=(*log.notes, note))
    ready = prepared(arm, log, cutoff=cutoff, filters=filters, drive=drive, leave_out=leave_out, name=str(log_path))
    felt = ready.mechanism.tree.owners("freedoms")[list(ready.equations.torques)].tolist()
    if isinstance(arm.source, Origin):
        members = mechanism_bodies(arm.source.model, base)
        check_torques(arm.source.model, members, model.get("ignore", ()), felt)
    return ready


def read_mechanism(
    source: Path, *, person: Person | None = None, columns: Path | None = None, **model: Any
) -> Mechanism:
    """Reads a model, arguments as for `prepare`."""
    arm = mechanism(source, **model)
    return arm if person is None else with_person(arm, person, read_segments(columns) if columns else None)


@dataclass(frozen=True)
class Scale:
    """Scaling of a model's segments.

    Attributes:
        trial: File of the trial to estimate lengths from, by default the fitted one.
        symmetric: True if the left side is as long as the right one.
        mass: Mass of the whole scaled model, kg, by default as it is.
    """

    trial: Path | None = None
    symmetric: bool = False
    mass: float | None = None


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
    postures: "Postures"
    swaps: "tuple[Swap, ...]"
    base: str | None
    recording: Recording
    scaling: "Scaling | None"


def angles(
    model: Path,
    trial: Path,
    *,
    places: Path | None = None,
    base: str | None = None,
    fix: Mapping[str, Sequence[float]] | None = None,
    wrenches: Path | None = None,
    scale: Scale | None = None,
) -> Angles:
    """Fit of a trial.

    Args:
        model: Model file.
        trial: File of the markers.
        places: File with the places of markers.
        base: Body whose frame is {0}, by default as for `base_of`.
        fix: Joints that do not move.
        wrenches: File with wrenches on the same clock.
        scale: How to scale the model's segments; None to leave them.

    Raises:
        InputError: Something is missing or does not fit; the message names it.
    """
    from sim.markers.marked_model import Settings, base_of, read_settings
    from sim.markers.trial_fit import check_fit, fit_trial
    from sim.markers.trial_recording import recording, swaps

    if scale is not None and is_opensim(model):
        raise InputError("--scale needs an MJCF or URDF model; let OpenSim's Scale Tool scale an OpenSim model.")
    settings = read_settings(places) if places is not None else Settings()
    markers, unmatched, marked, positions = _marked(model, trial, settings, fix)
    base = base_of(marked.model, base)
    lengths = None
    if scale is not None:
        own = (marked, positions) if scale.trial is None else _marked(model, scale.trial, settings, fix)[2:]
        lengths = _scaling(*own, settings, scale)
        marked = marked.with_lengths(lengths.model)
    postures = fit_trial(marked, positions)
    check_fit(postures)
    sigma = postures.sigma if isfinite(postures.sigma) else None
    source = {"markers": str(trial), "model": str(model), "base": base, "sigma_m": sigma}
    felt = None if wrenches is None else Recording.load(wrenches)
    if felt is not None and not felt.wrenches:
        raise InputError(f"{wrenches}: no wrench is in this file; it needs columns NAME_force.x to NAME_torque.z.")
    log = recording(postures, markers.time, base, source, felt)
    if count := marked.model.neq:
        more = f"The model's equality constraints ({count}) are not kept: joints follow the markers alone."
        log = replace(log, notes=(*log.notes, more))
    return Angles(markers, tuple(unmatched), postures, tuple(swaps(postures, positions)), base, log, lengths)


def _marked(
    model: Path, trial: Path, settings: "Settings", fix: Mapping[str, Sequence[float]] | None
) -> tuple[Markers, Sequence[str], "MarkedModel", np.ndarray]:
    """Markers of a trial, labels without a place, the model with the others' places, and the markers' positions."""
    from sim.markers.marked_model import marked_model, marked_positions

    markers = read_markers(trial, settings.unit)
    marked, unmatched = marked_model(model, markers.labels, settings.markers, fix)
    return markers, unmatched, marked, marked_positions(markers, unmatched, marked, settings.up)


def _scaling(marked: "MarkedModel", positions: np.ndarray, settings: "Settings", scale: Scale) -> "Scaling":
    from sim.markers.lengths import grouped, scaling

    groups = grouped(marked.model, settings.scale.groups, alike=scale.symmetric)
    total = float(marked.model.body_mass.sum())
    if scale.mass is not None and total == 0:
        raise InputError("--mass needs bodies that have masses; those of this model have none.")
    return scaling(marked, positions, groups, 1.0 if scale.mass is None else scale.mass / total)
