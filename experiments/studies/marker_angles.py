"""Joint angles of a trial from the files of its markers and of a model."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path

import numpy as np

from ident.errors import InputError
from ident.files.markers import Markers
from ident.files.readers import read_markers
from ident.recordings.recording import Recording
from sim.markers.lengths import Scaling, grouped, scaling
from sim.markers.marked_model import MarkedModel, Settings, base_of, marked_model, marked_positions, read_settings
from sim.markers.trial_fit import Postures, check_fit, fit_trial
from sim.markers.trial_recording import Swap, recording, swaps
from sim.models.opensim_model import is_opensim


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
    postures: Postures
    swaps: tuple[Swap, ...]
    base: str | None
    recording: Recording
    scaling: Scaling | None


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
    model: Path, trial: Path, settings: Settings, fix: Mapping[str, Sequence[float]] | None
) -> tuple[Markers, Sequence[str], MarkedModel, np.ndarray]:
    """Markers of a trial, labels without a place, the model with the others' places, and the markers' positions."""
    markers = read_markers(trial, settings.unit)
    marked, unmatched = marked_model(model, markers.labels, settings.markers, fix)
    return markers, unmatched, marked, marked_positions(markers, unmatched, marked, settings.up)


def _scaling(marked: MarkedModel, positions: np.ndarray, settings: Settings, scale: Scale) -> Scaling:
    groups = grouped(marked.model, settings.scale.groups, alike=scale.symmetric)
    total = float(marked.model.body_mass.sum())
    if scale.mass is not None and total == 0:
        raise InputError("--mass needs bodies that have masses; those of this model have none.")
    return scaling(marked, positions, groups, 1.0 if scale.mass is None else scale.mass / total)
