"""Channels that are constant in the fitted samples: their noise is unknown, and they are left out."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from ident.estimation import repairs
from ident.estimation.drive_choice import scale_deviations
from ident.estimation.equations import COMPONENTS, Equations
from ident.estimation.model_channels import predicted_channels
from ident.estimation.part import Part
from ident.estimation.preparation import Prepared
from ident.estimation.separable import separable
from ident.parameters.base_parameters import structural_base_parameters
from ident.parameters.structure import Sensors


def flat_channels(parts: Sequence[Part[slice]]) -> dict[str, float]:
    """Channels that are constant in the parts of recordings to fit, with their values."""
    every = [repairs.constants(part.log.recording, part.log.mechanism.tree, part.samples) for part in parts]
    return {name: x for name, x in every[0].items() if all(each.get(name) == x for each in every)}


def without_channels(log: Prepared, flat: Mapping[str, float]) -> Prepared:
    """Recording without channels that are constant in the fitted samples; a note or a finding reports them.

    Args:
        log: The recording.
        flat: Channels to leave out and their values.
    """
    mechanism, motion, old, notes = log.mechanism, log.samples.motion, log.equations, list(log.notes)
    kept = np.array([name not in flat for name in old.channels])
    wrenches = len(old.channels) - len(old.torques)
    rows = old.wrench[kept[:wrenches]] if old.wrench is not None and kept[:wrenches].any() else None
    torques = tuple(np.array(old.torques)[kept[wrenches:]].tolist())
    sensors = Sensors(rows is not None, bool(torques), motion.base is not None, rows)
    parameters = structural_base_parameters(mechanism, sensors=sensors)
    names = tuple(np.array(old.channels)[kept].tolist())
    servos = None if old.servos is None or not torques else old.servos[:, kept[wrenches:]]
    scales = scale_deviations(log.recording, mechanism.tree, torques)
    drives = log.drives if torques else ()
    equations = Equations(
        *(mechanism, parameters, rows, torques, names, drives),
        servos=servos,
        scales=scales,
        couplings=old.couplings,
    )
    samples = replace(log.samples, measured=log.samples.measured[:, kept])
    predicted = predicted_channels(mechanism, motion, log.frame, torques=bool(old.torques))
    stuck = repairs.stuck(flat, predicted, notes, in_fitted=True)
    return replace(
        log,
        recording=repairs.without_channels(log.recording, mechanism.tree, flat),
        equations=separable(equations, samples) if equations.drives else equations,
        samples=samples,
        sensors=sensors,
        wrench=np.where(np.isin(COMPONENTS, list(flat)), np.nan, log.wrench),
        notes=tuple(notes),
        stuck=(*log.stuck, *stuck),
    )
