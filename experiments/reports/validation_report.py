"""Report on the validation: figures, key numbers, and sentences that say where it wins and where it loses."""

from collections.abc import Mapping, Sequence
from dataclasses import is_dataclass
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from experiments.data.validation import (
    CANDIDATES,
    ESTIMATE,
    LEAST_SQUARES,
    MODEL,
    WORSE,
    Study,
    Validation,
    inside,
    typical,
)
from experiments.document import pictures, typography
from experiments.document.figures import empty_figure
from experiments.document.typography import sentences as split
from experiments.document.writer import Document, Headline, Plot, sentences
from experiments.reports import validation_tables as tables
from experiments.reports.validation_tables import agreement
from ident.display.plots import Axes, Figure, add_legend, few_decades
from ident.judgement.wording import number_of
from ident.tolerances import INTERVAL


def numbers(study: Study) -> dict[str, Any]:
    """Key numbers in JSON types."""
    ratio = study.against_best
    return {
        "channels": len(ratio),
        "best": int((ratio <= 1).sum()),
        "worse": int((ratio > WORSE).sum()),
        "trials_inside_95": {kind: rounded(inside(z)) for kind, z in study.trial_z.items()},
        "known": len(study.truth_z),
        "known_inside_95": rounded(inside(study.truth_z)),
        "truths": {name: rounded({**vars(each), "entry": each.entry.name}) for name, each in study.truths.items()},
        "recordings": {name: rounded(_recording(each)) for name, each in study.validations.items()},
        "not_run": dict(study.refused),
    }


def _recording(validation: Validation) -> dict[str, Any]:
    """Numbers of a recording."""
    own = {name: value for name, value in vars(validation).items() if name != "entry"}
    return own | {"published_z": {each.name: validation.published_z(each) for each in validation.entry.published}}


def rounded(value: Any) -> Any:
    """Numbers of any structure in JSON types with six significant digits; infinite ones and NaN are None."""
    if is_dataclass(value):
        return rounded(vars(value))
    if isinstance(value, Mapping):
        return {name: rounded(each) for name, each in value.items()}
    if isinstance(value, np.ndarray | list | tuple):
        return [rounded(each) for each in value]
    if isinstance(value, float):
        return float(f"{value:.6g}") if np.isfinite(value) else None
    return value


ABOUT = (
    "Public recordings of real systems, and of simulated ones whose parameters are known, identified unattended with "
    "the command's defaults. Held-out residuals are compared with those of the model as it came and of least squares "
    "at the best of five cut-offs, which is chosen on the fitted part."
)
"""The page's text on the study."""

STEEL = "double_pendulum"
"""Recording of the paper's mechanism, whose table has the form of the paper's."""


def lines(study: Study) -> list[str]:
    """Sentences with the main numbers, and on what was not run."""
    out = [*truth_lines(study), *(overview_lines(study) if study.validations else []), *worse_lines(study)]
    unchecked = {each.entry.title: ", ".join(each.unchecked) for each in study if each.unchecked}
    out += [f"Without a hash to check: {title}, {names}." for title, names in unchecked.items()]
    out += [f"Not run: {name}: {sentence}" for name, sentence in study.refused.items()]
    if study.untried:
        out.append(f"In the registry, but never tried: {', '.join(entry.title for entry in study.untried)}.")
    return out


def truth_lines(study: Study) -> list[str]:
    """Sentences on known parameters: of all of them, and of each system."""
    return sentences("validation_truth.txt", study=study, inside=inside, typical=typical)


def overview_lines(study: Study) -> list[str]:
    """Sentences on the channels in which the estimate is best, and on the agreement of estimates."""
    own = sentences("validation_overview.txt", study=study, inside=inside, worse=WORSE)
    return own + peer_lines(study) + [_identical(each) for each in study if len(each.alike_z)]


def peer_lines(study: Study) -> list[str]:
    """Sentences on the channels in which other software predicts better, and on what was not run."""
    out = list[str]()
    for name in dict.fromkeys(name for each in study for name in each.peers):
        pairs = [(each.ratios[ESTIMATE], each.peers[name]) for each in study if name in each.peers]
        run = [(own, np.array(x["ratios"])) for own, x in pairs if not isinstance(x, str)]
        if run:
            better = int(np.concatenate([ratios < own for own, ratios in run]).sum())
            out.append(
                f"Beside {name}, the estimate predicts worse in {better} of {sum(len(own) for own, _ in run)} channels "
                f"of {number_of(len(run), 'recording')}."
            )
        out += [f"No comparison with {name}. {x}" for x in dict.fromkeys(x for _, x in pairs if isinstance(x, str))]
    return out


def worse_lines(study: Study) -> list[str]:
    """Sentences on where the estimate is worse: than other candidates, published parameters and reference results."""
    return sentences("validation_worse.txt", study=study, worse=WORSE)


def _identical(validation: Validation) -> str:
    """Sentence on the parameters that are equal by construction."""
    z, values, alike = validation.alike_z, validation.values, validation.entry.alike
    groups = "; ".join(", ".join("{:.4f} ± {:.4f}".format(*values[name][::2]) for name in group) for group in alike)
    prior = min(float(values.prior[values.names.index(name)]) for group in alike for name in group)
    pulled = f" The model's values, ± {prior:.4f}, pull them together." if np.isfinite(prior) else ""
    return (
        f"{validation.entry.title}: of {len(z)} pairs of parameters that are equal by construction "
        f"{int((abs(z) <= INTERVAL).sum())} differ by at most 1.96 s.d. ({groups}).{pulled}"
    )


def known_picture(study: Study) -> str:
    """Picture of all known parameters' errors beside their 95 % intervals."""
    rows = {each.title: each.z / INTERVAL for each in study.truths.values()}
    return pictures.coverage(rows, "estimate less true value")


def headline(z: np.ndarray, sentence: str) -> Headline:
    """Headline: intervals hold unless fewer contain the truth than 95 % by two standard deviations of the count."""
    holds = inside(z) > 0.95 - 2 * np.sqrt(0.95 * 0.05 / len(z))
    return Headline("Validated", sentence, "usable") if holds else Headline("Overconfident", sentence, "not")


LOOKS = {MODEL: ("0.55", "D"), LEAST_SQUARES: ("C1", "s"), ESTIMATE: ("C0", "o")}
"""Colour and marker of each candidate."""

PUBLISHED = ("black", "|")
"""Colour and marker of published numbers."""

FOOT = 0.75
"""Inches of abscissa and legend."""

TICKS = tuple(first * 10.0**power for power in range(-4, 3) for first in (1, 2, 5))
"""Ticks of ratios, as far as they are on the abscissa."""

GROUPS = {
    "halves": ("C4", -0.22, "halves"),
    "trials": ("C0", 0.0, "trials alone"),
    "identical": ("C2", 0.22, "identical parts"),
}
"""Colour, place in its row, and label of each kind of agreement."""


def row_label(name: str) -> str:
    """Name of a parameter for a row: a symbol with its joint in words, or the name of a body with its quantity."""
    kind, _, joint = name.removesuffix(")").partition("(")
    if joint:
        return f"${kind[0]}_{{{kind[1:]}}}$ of {channel_label(joint)}"
    return name.replace("_", " ") if " " in name else typography.parameter_symbol(name)


def held_out_figure(study: Study) -> Figure:
    """Held-out residuals over signal by candidate, a panel for each recording, in two columns."""
    columns = _columns(list(study))
    heights = [sum(0.13 * len(each.channels) + 0.3 for each in column) for column in columns]
    every = np.concatenate([ratios for each in study for ratios in each.ratios.values()])
    every = every[np.isfinite(every) & (every > 0)]
    lowest, highest = 0.8 * float(every.min()), 1.25 * float(every.max())
    with empty_figure(max(heights) + FOOT, wide=True) as drawing:
        for part, column in zip(drawing.subfigures(1, len(columns), squeeze=False)[0], columns, strict=True):
            rows = [len(each.channels) + 1.0 for each in column]
            axes = part.subplots(len(column), 1, height_ratios=rows, sharex=True, squeeze=False)[:, 0]
            for ax, each in zip(axes, column, strict=True):
                _ratios(ax, each)
                ax.set_xlim(lowest, highest)
                few_decades(ax, TICKS if highest < 100 * lowest else ())
            axes[-1].set_xlabel("Held-out residual over signal", labelpad=2)
        add_legend(drawing, "lower", columns=4)
    return drawing


def _columns(validations: Sequence[Validation]) -> list[list[Validation]]:
    """Recordings in two columns of about the same height."""
    columns: list[list[Validation]] = [[] for _ in validations[:2]]
    for each in sorted(validations, key=lambda each: -len(each.channels)):
        min(columns, key=lambda column: sum(len(x.channels) + 2 for x in column)).append(each)
    return columns


def _ratios(ax: Axes, validation: Validation) -> None:
    """Draws the ratios of a recording's channels."""
    rows = np.arange(len(validation.channels))
    ax.axvline(1, color="0.6", lw=0.6, zorder=0)
    for name, (color, marker) in LOOKS.items():
        if name in validation.ratios:
            ax.plot(validation.ratios[name], rows, marker, color=color, ms=3, mew=0, label=CANDIDATES[name])
    for channel, ratio in validation.entry.held_out.items():
        if channel in validation.channels:
            color, marker = PUBLISHED
            ax.plot(ratio, validation.channels.index(channel), marker, color=color, ms=6, label="published")
    ax.set_xscale("log")
    ax.set_yticks(rows, [channel_label(channel) for channel in validation.channels])
    ax.set_ylim(len(rows) - 0.4, -0.6)
    ax.set_title(validation.entry.title, fontsize=8, pad=2)
    ax.tick_params(axis="y", labelsize=6)


def channel_label(channel: str) -> str:
    """Name of a channel for a figure: a symbol for components of the wrench, words for joints."""
    if len(channel) == 2 and channel[0] in "FM":
        return rf"${channel[0]}_{channel[1]}$"
    return channel.removesuffix("_joint").replace("_", " ")


def published_figure(study: Study) -> Figure:
    """Estimates over published parameters with 95 % intervals of both, and z of each difference.

    What is beyond the abscissa is marked by arrows.
    """
    near, far = -1.0, 3.0
    pairs = [(each, published) for each in study for published in each.entry.published]
    published = np.array([[each.value, abs(each.std)] for _, each in pairs])
    values = np.array([each.values[one.name] for each, one in pairs]) / published[:, :1]
    rows, half = np.arange(len(pairs)), INTERVAL * np.abs(values[:, 1:])
    with empty_figure(FOOT + 0.17 * len(rows)) as drawing:
        ax = drawing.subplots()
        ax.axvline(1, color="0.5", lw=0.6, zorder=0)
        bars: dict[str, Any] = {"color": "black", "fmt": "|", "ms": 6, "lw": 0.7, "label": "published"}
        ax.errorbar(np.ones(len(rows)), rows + 0.2, xerr=INTERVAL * published[:, 1] / abs(published[:, 0]), **bars)
        style: dict[str, Any] = {"ms": 3, "color": "C0"}
        ax.errorbar(values[:, 0], rows, xerr=half[:, 1], fmt="none", lw=0.7, label="with the set-up", **style)
        ax.errorbar(values[:, 0], rows, xerr=half[:, 0], fmt="o", lw=1.6, label="estimate, 95 % of the noise", **style)
        for ends, limit, marker in ((values[:, 0] - half.T, near, "<"), (values[:, 0] + half.T, far, ">")):
            beyond = rows[((ends < near) | (ends > far)).any(axis=0)]
            ax.plot(np.full(len(beyond), limit), beyond, marker, color="C0", ms=3, clip_on=False, label="_beyond")
        ax.set_yticks(rows, [f"{each.entry.title}, {row_label(one.name)}" for each, one in pairs])
        ax.set_ylim(len(rows) - 0.4, -0.6)
        ax.set_xlim(near, far)
        ax.set_xlabel("Estimate over published value", labelpad=2)
        for row, (each, one) in enumerate(pairs):
            z = f"{round(each.published_z(one), 1) + 0.0:+.1f}".replace("-", "\N{MINUS SIGN}")
            ax.text(1.04, row, f"$z$ = {z}", transform=ax.get_yaxis_transform(), va="center", fontsize=6)
        for row, (above, below) in enumerate(pairwise(pairs)):
            if above[0] is not below[0]:
                ax.axhline(row + 0.5, color="0.8", lw=0.5)
        add_legend(drawing, "lower", columns=2)
    return drawing


def summary_figure(study: Study) -> Figure:
    """Estimate's residuals over those of the best other candidate, and differences of trials, by recording."""
    shown = list(study)
    with empty_figure(FOOT + 0.25 + 0.2 * len(shown), wide=True) as drawing:
        left, right = drawing.subplots(1, 2, sharey=True)
        rng = np.random.default_rng(0)
        names = [each.entry.title for each in shown]
        _strip(left, dict(zip(names, (each.against_best for each in shown), strict=True)), rng, color="black")
        left.axvspan(1, WORSE, color="0.88", lw=0)
        left.axvline(1, color="0.4", lw=0.6, label="equal")
        left.set_xscale("log")
        few_decades(left, TICKS)
        left.set_xlabel("Residual over the best other candidate's", labelpad=2)
        left.set_title("(a) Held-out channels")
        for name, (color, shift, label) in GROUPS.items():
            rows = {f"{label}, {own}": agreement(each)[name] for own, each in zip(names, shown, strict=True)}
            _strip(right, rows, rng, color=color, shift=shift)
        right.axvspan(-INTERVAL, INTERVAL, color="0.88", lw=0)
        # Linear up to this difference, in standard deviations, and logarithmic beyond.
        linear = 4.0
        right.set_xscale("symlog", linthresh=linear)
        largest = max(abs(z).max(initial=linear) for each in shown for z in agreement(each).values())
        ticks = [x for x in (-30, -10, -4, -2, 0, 2, 4, 10, 30) if abs(x) <= largest]
        right.set_xticks(ticks, [str(x).replace("-", "\N{MINUS SIGN}") for x in ticks])
        right.minorticks_off()
        right.set_xlim(-1.05 * largest, 1.05 * largest)
        right.set_xlabel("Difference in standard deviations", labelpad=2)
        right.set_title("(b) Agreement")
        left.set_yticks(range(len(shown)), names)
        left.set_ylim(len(shown) - 0.5, -0.5)
        marks = [right.plot([], [], "o", color=c, ms=3, label=label)[0] for c, _, label in GROUPS.values()]
        drawing.legend(handles=marks, loc="outside lower center", ncols=3)
    return drawing


def _strip(
    ax: Axes, rows: Mapping[str, np.ndarray], rng: np.random.Generator, *, shift: float = 0.0, color: str = "C0"
) -> None:
    """Draws the numbers of each row, by its name, as dots that are spread a little."""
    for row, (name, numbers) in enumerate(rows.items()):
        at = row + shift + rng.uniform(-0.07, 0.07, len(numbers))
        ax.plot(numbers, at, "o", color=color, ms=2.2, alpha=0.6, mew=0, label=name)


CAPTIONS = {
    summary_figure: "Held-out residuals of the trajectory estimate over those of the best other candidate, up to 5 % "
    "worse in grey (a); differences of halves, of trials identified alone, and of identical parts, in their stated "
    "standard deviations, 95 % in grey (b).",
    held_out_figure: "Residual of the held-out part over the signal's standard deviation, by channel and candidate.",
    published_figure: "Estimates over published parameters, 95 % intervals of both where they are published.",
}
"""Captions of the figures."""


def document(study: Study, provenance: dict[str, Any]) -> Document:
    """Tables, figures and numbers of the validation."""
    shown = [tables.table_truth, tables.table_peers, tables.table_recordings, tables.table_worse]
    shown += [tables.table_outside, tables.table_missed, tables.table_held_out]
    shown += [tables.table_published, tables.table_agreement, tables.table_was_published]
    made = {each.__name__: each(study) for each in shown}
    if STEEL in study.validations:
        made["table_steel"] = tables.table_steel(study.validations[STEEL])
    drawn = {"figure_validation": summary_figure, "figure_held_out": held_out_figure} if study.validations else {}
    if any(each.entry.published for each in study):
        drawn["figure_published"] = published_figure
    said = lines(study)
    return Document(
        "Validation against known parameters and real systems",
        ABOUT,
        headline=headline(study.truth_z, split(said[0])[0]) if study.truths else None,
        pictures=[known_picture(study)] if study.truths else [],
        lines=said,
        folded={"Verdicts in words": [f"{each.entry.title}: {each.verdict}" for each in study]},
        tables={name: table for name, table in made.items() if table.rows},
        figures={name: Plot(partial(draw, study), CAPTIONS[draw]) for name, draw in drawn.items()},
        numbers={"summary": numbers(study), "provenance": provenance},
    )
