"""Report on the validation: tables, figures, key numbers, and sentences that say where it wins and where it loses."""

from collections.abc import Mapping
from dataclasses import is_dataclass
from functools import partial
from typing import Any

import numpy as np

from experiments.data.validation import ESTIMATE, WORSE, Study, Validation, inside, typical
from experiments.document import pictures
from experiments.document.typography import sentences as split
from experiments.document.writer import Document, Headline, Plot, sentences
from experiments.reports import validation_tables as tables
from experiments.reports.validation_figures import held_out_figure, published_figure, summary_figure
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
