"""Report on the validation: tables, figures, key numbers, and sentences that say where it wins and where it loses."""

from typing import Any

import numpy as np

from experiments.data.errors import HALF_WIDTH
from experiments.data.validation import ESTIMATE, LEAST_SQUARES, MODEL, WORSE, Study, Validation, inside
from experiments.document.document import Document
from experiments.reports import validation_tables as tables
from experiments.reports.validation_figures import held_out_figure, published_figure, summary_figure
from experiments.reports.validation_numbers import numbers

ABOUT = (
    "Public recordings of real systems, identified unattended with the command's defaults. Held-out residuals are "
    "compared with those of the model as it came and of least squares at the best of five cut-offs, which is chosen "
    "on the fitted part."
)
"""The page's text on the study."""

STEEL = "double_pendulum"
"""Recording of the paper's mechanism, whose table has the form of the paper's."""


def lines(study: Study) -> list[str]:
    """Sentences with the main numbers, the verdicts, and on what was not run."""
    out = [*main_lines(study), *(f"{each.entry.title}: {each.verdict}" for each in study)]
    unchecked = {each.entry.title: ", ".join(each.unchecked) for each in study if each.unchecked}
    out += [f"Without a hash to check: {title}, {names}." for title, names in unchecked.items()]
    out += [f"Not run: {name}: {sentence}" for name, sentence in study.refused.items()]
    if study.untried:
        out.append(f"In the registry, but never tried: {', '.join(entry.title for entry in study.untried)}.")
    return out


def main_lines(study: Study) -> list[str]:
    """Sentences with the main numbers: where the estimate is best, where it loses, and how estimates agree."""
    ratio, z = study.against_best, study.trial_z
    best, alike = int((ratio <= 1).sum()), int(((ratio > 1) & (ratio <= WORSE)).sum())
    out = [
        f"In {best} of {len(ratio)} channels that some candidate explains, the trajectory estimate predicts best; in "
        f"{alike} it is worse by at most {WORSE - 1:.0%} than the best other candidate, and in "
        f"{int((ratio > WORSE).sum())} by more.",
        *filter(None, map(_losses, study)),
    ]
    if len(z):
        out.append(
            f"Of {len(z)} differences between parameters of two recordings of one system, each identified alone, "
            f"{100 * inside(z):.0f} % are inside their 95 % intervals."
        )
    out += [_published(each) for each in study if each.entry.published]
    return out + [_identical(each) for each in study if len(each.alike_z)]


def _losses(validation: Validation) -> str:
    """Sentence on the channels in which a recording's estimate is worse than another candidate; empty without any."""
    worse = []
    for k, channel in enumerate(validation.channels):
        ratios = {name: float(validation.ratios[name][k]) for name in (MODEL, LEAST_SQUARES)}
        other, own = min(ratios, key=lambda name: ratios[name]), float(validation.ratios[ESTIMATE][k])
        if validation.explained[k] and own > WORSE * ratios[other]:
            worse.append(f"{channel} ({own:.3f}; {'the model' if other == MODEL else other} {ratios[other]:.3f})")
    return f"{validation.entry.title}: it loses in {', '.join(worse)}." if worse else ""


def _published(validation: Validation) -> str:
    """Sentence on the published values inside and outside the intervals of a recording."""
    z = {each.name: validation.published_z(each) for each in validation.entry.published}
    outside = [f"{name} ({x:+.1f} s.d.)" for name, x in z.items() if inside(np.array([x])) == 0]
    count = len(z) - len(outside)
    but = f"; outside: {', '.join(outside)}" if outside else ""
    return f"{validation.entry.title}: {count} of {len(z)} published values are inside our 95 % intervals{but}."


def _identical(validation: Validation) -> str:
    """Sentence on the parameters that are equal by construction."""
    z = validation.alike_z
    groups = "; ".join(
        ", ".join("{:.4f} ± {:.4f}".format(*validation.values[name][::2]) for name in group)
        for group in validation.entry.alike
    )
    values = validation.values
    priors = [float(values.prior[values.names.index(name)]) for group in validation.entry.alike for name in group]
    pulled = f" The model's values, ± {min(priors):.4f}, pull them together." if np.isfinite(min(priors)) else ""
    return (
        f"{validation.entry.title}: of {len(z)} pairs of parameters that are equal by construction "
        f"{int((abs(z) <= HALF_WIDTH).sum())} differ by at most 1.96 s.d. ({groups}).{pulled}"
    )


CAPTIONS = {
    "figure_validation": "Held-out residuals of the trajectory estimate over those of the best other candidate, up to "
    "5 % worse in grey (a); differences of halves, of trials identified alone, and of identical parts, in their stated "
    "standard deviations, 95 % in grey (b).",
    "figure_held_out": "Residual of the held-out part over the signal's standard deviation, by channel and candidate.",
    "figure_published": "Estimates over published parameters, 95 % intervals of both where they are published.",
}
"""Captions of the figures."""


def document(study: Study, provenance: dict[str, Any]) -> Document:
    """Tables, figures and numbers of the validation."""
    made = {
        "table_recordings": tables.table_recordings(study),
        "table_held_out": tables.table_held_out(study),
        "table_published": tables.table_published(study),
        "table_agreement": tables.table_agreement(study),
    }
    if STEEL in study.validations:
        made["table_steel"] = tables.table_steel(study.validations[STEEL])
    figures = {"figure_validation": summary_figure(study), "figure_held_out": held_out_figure(study)}
    if any(each.entry.published for each in study):
        figures["figure_published"] = published_figure(study)
    return Document(
        "Validation on real systems",
        ABOUT,
        lines=lines(study),
        tables={name: table for name, table in made.items() if table.rows},
        figures={name: (figure, CAPTIONS[name]) for name, figure in figures.items()},
        numbers={"summary": numbers(study), "provenance": provenance},
    )
