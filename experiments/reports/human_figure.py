"""Figure of the study of a person: errors of segments, and precision over contacts, motions and seconds."""

import numpy as np

from experiments.data.simulated_person import PersonStudy
from experiments.document.styles import empty_figure
from ident.display.plots import Axes, Figure, few_decades
from ident.tolerances import INTERVAL

COLORS = {"prior": "0.55", "estimate": "C0"}

KINDS = {"masses": slice(0, 1), "first moments": slice(1, 4), "inertias": slice(4, 10)}
KIND_COLORS = ("C0", "C1", "C2")
"""Parameters of a segment by kind, and their colours."""

TICKS = (0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50)
"""Ticks of logarithmic axes, as far as they are in sight."""

SHARES = (0.15, 0.3, 0.6, 1.0)
"""Fractions of each recording's length at which the precision is evaluated."""


def figure(study: PersonStudy, feet_alone: PersonStudy) -> Figure:
    """Errors of first moments, and the precision gained by more recordings and seconds, with and without the rail."""
    with empty_figure(3.1, wide=True) as drawing:
        above, middle, below = drawing.subplots(1, 3)
        _segments(above, study)
        _growth(middle, study, feet_alone)
        _predictions(below, study, feet_alone)
    return drawing


def _segments(ax: Axes, study: PersonStudy) -> None:
    """Draws the error of each first moment's vector relative to its size, of prior and estimate."""
    phi, std = study.segments
    true, prior = (arm.known.reshape(-1, 10) for arm in (study.true, study.mechanism))
    size = np.linalg.norm(true[:, 1:4], axis=1)
    rows = np.arange(len(size))
    for name, x, offset in (("prior", prior, -0.15), ("estimate", phi, 0.15)):
        error = 100 * np.linalg.norm((x - true)[:, 1:4], axis=1) / size
        ax.plot(error, rows + offset, "o", ms=3, color=COLORS[name], label=name)
    half = 100 * INTERVAL * np.linalg.norm(std[:, 1:4], axis=1) / size
    ax.hlines(rows + 0.15, 0, half, color=COLORS["estimate"], lw=0.9, alpha=0.5, label="95 % interval")
    ax.set_yticks(rows, [name.replace("_", " ") for name in study.true.bodies])
    ax.invert_yaxis()
    ax.set_xscale("symlog", linthresh=10, linscale=1)
    ax.xaxis.set_major_formatter("{x:g}")
    ax.set_xlim(left=0)
    ax.set_xlabel("Error of the first moment (%)", labelpad=2)
    ax.set_title("(a) First moments of segments")
    _legend(ax)


def growth(study: PersonStudy) -> np.ndarray:
    """Standard deviations over the prior's by kind, geometric means, for each number of recordings (k + 1, 3)."""
    number = len(study.activities)
    deviations = np.array([study.information([study.seconds] * n + [0.0] * (number - n)) for n in range(number + 1)])
    logs = np.log(deviations / deviations[0])
    return np.exp(np.stack([logs[..., which].mean(axis=(1, 2)) for which in KINDS.values()], axis=1))


def _growth(ax: Axes, study: PersonStudy, feet_alone: PersonStudy) -> None:
    """Draws the standard deviations of segments over the number of recordings."""
    numbers = np.arange(len(study.activities) + 1)
    for each, style, contacts in ((study, "-", "plates and rail"), (feet_alone, "--", "plates")):
        for name, marker, color, ratio in zip(KINDS, "osD", KIND_COLORS, growth(each).T, strict=True):
            label = name if each is study else f"_{name}, {contacts}"
            ax.plot(numbers, ratio, marker + style, ms=3, lw=0.9, color=color, label=label)
        ax.plot([], [], style, color="0.3", lw=0.9, label=contacts)
    ax.set_xticks(numbers, ["none", *(f"+ {activity}" for activity in study.activities)], rotation=30, ha="right")
    ax.set_ylabel("S.d. over the prior's", labelpad=2)
    ax.set_title(f"(b) Recordings of {study.seconds:g} s each")
    _legend(ax)


def predicted_deviations(study: PersonStudy) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Total seconds, and s.d. of the wrench of motions not recorded over the prior's, for each motion and all."""
    lengths = np.array(SHARES) * study.seconds
    kinds = {name: np.eye(len(study.activities))[k] for k, name in enumerate(study.activities)}
    kinds["all"] = np.ones(len(study.activities))
    return {
        name: (lengths * taken.sum(), np.array([study.predicted_deviation(list(length * taken)) for length in lengths]))
        for name, taken in kinds.items()
    }


def _predictions(ax: Axes, study: PersonStudy, feet_alone: PersonStudy) -> None:
    """Draws the standard deviation of the wrench of motions not recorded over the seconds recorded."""
    every = predicted_deviations(study)
    for name in study.activities:
        ax.loglog(*every[name], ".-", ms=3, lw=0.7, label=name)
    ax.loglog(*every["all"], "o-", ms=3, lw=1.2, color="black", label="all, plates and rail")
    ax.loglog(*predicted_deviations(feet_alone)["all"], "o--", ms=3, lw=1, color="0.5", label="all, plates")
    few_decades(ax, TICKS)
    ax.set_xlabel("Seconds recorded", labelpad=2)
    ax.set_ylabel("S.d. over the prior's", labelpad=2)
    ax.set_title("(c) Wrench of motions not recorded")
    _legend(ax)


def _legend(ax: Axes) -> None:
    """Adds a panel's legend below it."""
    ax.legend(loc="upper center", bbox_to_anchor=(0.45, -0.2), ncols=2, fontsize=7, columnspacing=1)
