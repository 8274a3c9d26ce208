"""Plots of estimates and recordings as matplotlib figures, in the style that matplotlib is set to."""

import sys
from collections import ChainMap
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib import mlab
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ident.estimation.equations import Equations
from ident.estimation.units import channel_unit
from ident.files.table import vector_columns

JOINTS = {"position": "rad or m", "command": "rad or m", "torque": "N m or N"}
"""Quantities of joints that are drawn, and their units where a recording states none."""

LINES = 10
"""Largest number of lines that a panel names."""

MOST = 60
"""Largest number of parameters in a figure: those with the narrowest relative intervals."""


def parameters_plot(names: Sequence[str], values: np.ndarray, intervals: np.ndarray, model: np.ndarray) -> Figure:
    """Base parameters with 95 % intervals that include the set-up, beside the model's."""
    half = np.diff(intervals, axis=1)[:, 0] / 2
    size = np.max([np.abs(values), np.abs(model), half, np.full(len(values), 1e-300)], axis=0)
    shown = np.sort(np.argsort(half / size, kind="stable")[:MOST])
    rows = np.arange(len(shown))
    figure = _figure(6, 1.2 + 0.22 * len(rows))
    ax = figure.subplots()
    ax.axvline(0, color="0.8", lw=0.8)
    ax.errorbar((values / size)[shown], rows, xerr=(half / size)[shown], fmt="o", ms=4, label="Estimate, 95 %")
    ax.plot((model / size)[shown], rows, "k|", ms=10, label="Model")
    ax.set_yticks(rows, np.array(names)[shown])
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.set_xlabel("Value over the largest of estimate, model and half-width")
    figure.legend(loc="outside upper center", ncols=2)
    return figure


def fit_plot(equations: Equations, time: np.ndarray, measured: np.ndarray, predicted: np.ndarray) -> Figure:
    """Measured and predicted channels (N, C)."""
    figure, axes = _panels(equations, "Time (s)", "")
    for k, ax in enumerate(axes):
        ax.plot(time, measured[:, k], "k", lw=1.2, label="Measured")
        ax.plot(time, predicted[:, k], "C1--", lw=1.2, label="Predicted")
        ax.margins(x=0)
    _add_legend(figure, axes)
    return figure


def spectra_plot(equations: Equations, rate: float, measured: np.ndarray, residual: np.ndarray) -> Figure:
    """Amplitude spectra of measured channels and of their residuals (N, C)."""
    figure, axes = _panels(equations, "Frequency (Hz)", "/√Hz")
    for k, ax in enumerate(axes):
        for x, color, label in ((measured, "k", "Measured"), (residual, "C1", "Residual")):
            frequency, amplitude = amplitude_spectrum(x[:, k], rate)
            ax.loglog(frequency[1:], np.maximum(amplitude[1:], 1e-12), color=color, lw=1, label=label)
        ax.margins(x=0)
    _add_legend(figure, axes)
    return figure


def recording_plot(
    time: np.ndarray, channels: Mapping[str, np.ndarray], units: Mapping[str, str], wrenches: Sequence[str]
) -> Figure:
    """Joint positions, commands and torques of a recording over time, and force and moment of each wrench."""
    panels = _panels_of(channels, units, wrenches)
    figure = _figure(8, 1 + 1.5 * max(len(panels), 1))
    axes = figure.subplots(max(len(panels), 1), sharex=True, squeeze=False)[:, 0]
    for (label, lines), ax in zip(panels.items(), axes, strict=False):
        for name, x in lines.items():
            ax.plot(time, x, lw=1, label=name)
        ax.set_ylabel(label)
        ax.margins(x=0)
        if len(lines) <= LINES:
            ax.legend(loc="center left", bbox_to_anchor=(1, 0.5), frameon=False)
    axes[-1].set_xlabel("Time (s)")
    return figure


def _panels_of(
    channels: Mapping[str, np.ndarray], units: Mapping[str, str], wrenches: Sequence[str]
) -> dict[str, dict[str, np.ndarray]]:
    """Lines (N,) of each panel by name, by the panel's label."""
    positions = [name for name in channels if name.endswith("_position")]
    # Positions of three components are those of bodies.
    joints = [name.removesuffix("_position") for name in positions if channels[name].shape[1:] != (3,)]
    groups = [(f"Joint {kind}", unit, {j: f"{j}_{kind}" for j in joints}) for kind, unit in JOINTS.items()]
    for name in wrenches:
        groups += [(f"Force {name}", "N", {"F": f"{name}_force"}), (f"Moment {name}", "N m", {"M": f"{name}_torque"})]
    panels = {}
    for title, usual, names in groups:
        measured = {line: name for line, name in names.items() if name in channels}
        stated = dict.fromkeys(units.get(name, usual) for name in measured.values())
        lines = [vector_columns(line, channels[name]) for line, name in measured.items()]
        if lines:
            panels[f"{title}\n({', '.join(stated)})"] = dict(ChainMap(*reversed(lines)))
    return panels


def amplitude_spectrum(x: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies in Hz and amplitude spectral density of a signal (N,), by Welch's method."""
    # Equal to scipy.signal.welch, which takes half a second to import.
    length = min(len(x), 512)
    window = np.hanning(length + 1)[:-1]
    power, frequency = mlab.psd(x, length, rate, detrend="mean", window=window, noverlap=length // 2)
    return np.asarray(frequency), np.sqrt(power)


class _CellFigure(Figure):
    """A figure that a notebook shows once at the end of its cell, whether or not it is the cell's last value."""

    def _ipython_display_(self) -> None:
        """Counts the figure as shown, and leaves the showing to others."""
        if self in _UNSHOWN:
            _UNSHOWN.remove(self)
        raise NotImplementedError


_UNSHOWN: list[Figure] = []
"""Figures of the notebook's running cell that are not shown yet."""


def _figure(width: float, height: float) -> Figure:
    """A figure of pyplot's, so that notebooks know how to show it, but not among those that they show themselves."""
    # Commands, which use the spectra alone, start without it.
    from matplotlib import pyplot

    figure = pyplot.figure(figsize=(width, height), layout="constrained", FigureClass=_CellFigure)
    pyplot.close(figure)
    shell: Any = sys.modules["IPython"].get_ipython() if "IPython" in sys.modules else None
    if hasattr(shell, "kernel"):
        _UNSHOWN.append(figure)
        shell.events.register("post_execute", _show)
    return figure


def _show() -> None:
    """Shows the figures that the cell has not shown."""
    for figure in list(_UNSHOWN):
        sys.modules["IPython"].display.display(figure)


def _panels(equations: Equations, xlabel: str, per: str) -> tuple[Figure, list[Axes]]:
    """A figure with a panel for each channel in two columns, labelled with its name and unit."""
    channels, tree = equations.channels, equations.mechanism.tree
    rows = -(-len(channels) // 2)
    figure = _figure(8, 1 + 1.5 * rows)
    axes = list(figure.subplots(rows, 2, sharex=True, squeeze=False).T.flat)
    for ax in axes[len(channels) :]:
        ax.set_axis_off()
    for channel, ax in zip(channels, axes, strict=False):
        ax.set_ylabel(f"{channel}\n({channel_unit(channel, tree)}{per})")
    for ax in (axes[rows - 1], axes[len(channels) - 1]):
        ax.set_xlabel(xlabel)
        ax.tick_params(labelbottom=True)
    return figure, axes[: len(channels)]


def _add_legend(figure: Figure, axes: list[Axes]) -> None:
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
