"""Plots of an estimate as matplotlib figures, in the style that matplotlib is set to."""

from typing import TYPE_CHECKING

import numpy as np
from matplotlib import mlab
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from ident.estimation.units import channel_unit

if TYPE_CHECKING:
    from ident.estimate import Estimate

MOST = 60
"""Largest number of parameters in a figure: those with the narrowest relative intervals."""


def parameters_plot(estimate: "Estimate") -> Figure:
    """Base parameters with 95 % intervals that include the set-up, beside the model's."""
    names, values = np.array(estimate.names), estimate.psi
    model = estimate.fit.equations.from_model[: len(values)]
    half = np.diff(estimate.interval(), axis=1)[:, 0] / 2
    size = np.max([np.abs(values), np.abs(model), half, np.full(len(values), 1e-300)], axis=0)
    shown = np.sort(np.argsort(half / size, kind="stable")[:MOST])
    rows = np.arange(len(shown))
    figure = _figure(6, 1.2 + 0.22 * len(rows))
    ax = figure.subplots()
    ax.axvline(0, color="0.8", lw=0.8)
    ax.errorbar((values / size)[shown], rows, xerr=(half / size)[shown], fmt="o", ms=4, label="Estimate, 95 %")
    ax.plot((model / size)[shown], rows, "k|", ms=10, label="Model")
    ax.set_yticks(rows, names[shown])
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.set_xlabel("Value over the largest of estimate, model and half-width")
    figure.legend(loc="outside upper center", ncols=2)
    return figure


def fit_plot(estimate: "Estimate") -> Figure:
    """Measured and predicted channels on the held-out part."""
    held = estimate.held_out
    measured = held.samples.measured
    time, measured, predicted = map(held.interrupted, (held.time, measured, measured - held.residual))
    figure, axes = _panels(estimate, "Time (s)", "")
    for k, ax in enumerate(axes):
        ax.plot(time, measured[:, k], "k", lw=1.2, label="Measured")
        ax.plot(time, predicted[:, k], "C1--", lw=1.2, label="Predicted")
        ax.margins(x=0)
    _add_legend(figure, axes)
    return figure


def spectra_plot(estimate: "Estimate") -> Figure:
    """Amplitude spectra of the measured channels and of their residuals on the held-out part."""
    held, rate = estimate.held_out, estimate.prepared.recording.rate
    figure, axes = _panels(estimate, "Frequency (Hz)", "/√Hz")
    for k, ax in enumerate(axes):
        for x, color, label in ((held.samples.measured, "k", "Measured"), (held.residual, "C1", "Residual")):
            frequency, amplitude = amplitude_spectrum(x[:, k], rate)
            ax.loglog(frequency[1:], np.maximum(amplitude[1:], 1e-12), color=color, lw=1, label=label)
        ax.margins(x=0)
    _add_legend(figure, axes)
    return figure


def amplitude_spectrum(x: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Frequencies in Hz and amplitude spectral density of a signal (N,), by Welch's method."""
    # Equal to scipy.signal.welch, which takes half a second to import.
    length = min(len(x), 512)
    window = np.hanning(length + 1)[:-1]
    power, frequency = mlab.psd(x, length, rate, detrend="mean", window=window, noverlap=length // 2)
    return np.asarray(frequency), np.sqrt(power)


def _figure(width: float, height: float) -> Figure:
    """A figure of pyplot's, so that notebooks know how to show it, but not among those that they show themselves."""
    # Commands, which use the spectra alone, start without it.
    from matplotlib import pyplot

    figure = pyplot.figure(figsize=(width, height), layout="constrained")
    pyplot.close(figure)
    return figure


def _panels(estimate: "Estimate", xlabel: str, per: str) -> tuple[Figure, list[Axes]]:
    """A figure with a panel for each channel in two columns, labelled with its name and unit."""
    channels, tree = estimate.channels, estimate.prepared.mechanism.tree
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
