"""Figures of an identification for print."""

import numpy as np

from experiments.document import symbols
from experiments.document.figures import SHEET, paper_style
from ident.display import plots
from ident.display.plots import Figure
from ident.estimate import Estimate
from ident.estimation.equations import COMPONENTS
from ident.estimation.noise import channel_unit
from ident.tolerances import INTERVAL


def held_out_figure(result: Estimate) -> Figure:
    """Measured and predicted channels on the held-out part."""
    held = result.held_out
    with paper_style():
        slow = held.interrupted(~held.moving, by=False)
        return plots.fit_figure(SHEET, _labels(result), held.curves, slow)


def parameters_figure(result: Estimate) -> Figure:
    """Base parameters with 95 % intervals including the set-up, beside the model's, each over the largest of these."""
    bodies, model = result.prepared.mechanism.bodies, result.fit.equations.from_model[: result.base.rank]
    names = [symbols.named_symbol(name, bodies) for name in result.base.names]
    with paper_style():
        return plots.parameters_figure(SHEET, names, result.psi, INTERVAL * result.std_setup, model)


def spectra_figure(result: Estimate) -> Figure:
    """Spectra of the measured channels and of their residuals on the held-out part, up to three times the cut-off."""
    held, cutoff, rate = result.held_out, result.prepared.cutoff, result.prepared.recording.rate
    highest = np.inf if cutoff is None else 3 * cutoff
    with paper_style():
        pair = (held.samples.measured, held.residual)
        return plots.spectra_figure(SHEET, _labels(result, "/√Hz"), rate, pair, highest)


def _labels(result: Estimate, per: str = "") -> list[str]:
    """Symbols or joints of the channels, and their units, divided by `per`."""
    units = {name: channel_unit(name, result.prepared.mechanism.tree) for name in result.channels}
    shown = {name: f"${name[0]}_{name[1]}$" if name in COMPONENTS else symbols.label(name) for name in units}
    return [f"{shown[name]} ({unit}{per})" for name, unit in units.items()]
