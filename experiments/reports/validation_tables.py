"""Tables of the validation: recordings, held-out residuals, published parameters, identical parts and trials."""

from typing import Any

import numpy as np

from experiments.data import validation as data
from experiments.data.validation import CANDIDATES, ESTIMATE, OTHERS, WORSE, Study, Validation, Values, inside
from experiments.document.tabular import Cell, Table, of_deviations
from ident.judgement.verdict import Outcome


def table_truth(study: Study) -> Table:
    """A line on each system of which parameters are known: coverage, and errors of each candidate."""
    rows: list[tuple[Cell, ...]] = []
    for each in study.truths.values():
        unknown = np.full(len(each.true), np.nan)
        candidates = (each.values, *(each.rivals.get(name, unknown) for name in OTHERS))
        errors = (_percent(data.typical(each.errors(x)), ".1f") for x in candidates)
        counts = (len(each.true), _percent(inside(each.z), ".3g"), int(each.significant.sum()))
        rows.append((each.title, *counts, *errors, round(each.seconds)))
    heads = {"inside": "in our 95 % intervals", "significant": "not zero in them", "estimate": "median error, estimate"}
    heads |= {name: CANDIDATES[name] for name in OTHERS} | {"seconds": "CPU s"}
    columns = ("system", "known", "inside", "significant", "estimate", *OTHERS, "seconds")
    notes = ("Median errors are relative, of the parameters whose 95 % intervals exclude zero.",)
    return Table("Known parameters and estimates", columns, rows, heads=heads, notes=notes)


def table_peers(study: Study) -> Table:
    """Held-out residuals of the estimate and of other software: median and largest of the channels, and CPU time."""
    rows: list[tuple[Cell, ...]] = []
    for each in study:
        own: dict[str, Any] = {CANDIDATES[ESTIMATE]: {"ratios": each.ratios[ESTIMATE], "seconds": each.seconds}}
        for name, answer in ((own | dict(each.peers)) if each.peers else {}).items():
            if isinstance(answer, str):
                rows.append((each.entry.title, name, None, None, None, None, answer))
                continue
            ratios = np.array(answer["ratios"], float)
            better = int((ratios < each.ratios[ESTIMATE]).sum())
            numbers = (float(np.median(ratios)), float(ratios.max()), better if name in each.peers else None)
            rows.append((each.entry.title, name, *numbers, answer["seconds"], None))
    columns = ("recording", "software", "median", "largest", "better", "seconds", "note")
    heads = {"better": "channels better than the estimate", "seconds": "CPU s"}
    title = "Residual of the held-out part over the signal's standard deviation, beside other software"
    digits = {"seconds": of_deviations(row[5] if isinstance(row[5], float) else None for row in rows)}
    return Table(title, columns, rows, digits=digits, heads=heads)


def table_recordings(study: Study) -> Table:
    """A line on each recording: size, verdict, channels, agreement and time."""
    rows = [_recording(each) for each in study]
    heads = {
        "held_out": "held out",
        "channels": "explained channels",
        "best": "estimate best",
        "worse": f"worse by over {100 * (WORSE - 1):.0f} %",
        "halves": "halves, RMS z",
        "halves_inside": "halves inside 95 %",
        "trials_inside": "trials inside 95 %",
        "identical_inside": "identical parts inside 95 %",
        "seconds": "CPU s",
    }
    columns = (
        *("recording", "fitted", "held_out", "verdict", "channels", "best", "worse"),
        *("halves", "halves_inside", "trials_inside", "identical_inside", "seconds"),
    )
    notes = (
        "RMS z of halves in standard deviations from the noise; beyond 1 these are widened by as much, and halves "
        "inside 95 % are of these, before parameters are widened by their own halves.",
    )
    return Table("Public recordings", columns, rows, decimals=1, heads=heads, notes=notes)


def _recording(validation: Validation) -> tuple[Cell, ...]:
    """A recording's row."""
    ratio, z = validation.against_best, agreement(validation)
    counts = (len(ratio), int((ratio <= 1).sum()), int((ratio > WORSE).sum()))
    shares = (_percent(inside(z[name])) for name in ("halves", "trials", "identical"))
    start = (validation.entry.title, *validation.samples, Outcome(validation.outcome).word)
    return *start, *counts, data.rms(validation.halves), *shares, round(validation.seconds)


def agreement(validation: Validation) -> dict[str, np.ndarray]:
    """Differences in stated standard deviations: of halves, of trials identified alone, and of identical parts.

    Those of halves are not widened by a parameter's own halves, which would always agree.
    """
    return {
        "halves": validation.halves / validation.widening,
        "trials": validation.trial_z,
        "identical": validation.alike_z,
    }


def _percent(share: float, form: str = ".0f") -> str | None:
    return None if np.isnan(share) else f"{100 * share:{form}} %"


def table_held_out(study: Study) -> Table:
    """Held-out residual over signal by channel and candidate."""
    rows: list[tuple[Cell, ...]] = []
    for each in study:
        for k, channel in enumerate(each.channels):
            ratios, resting = (
                [float(of[name][k]) for name in (data.MODEL, data.LEAST_SQUARES, ESTIMATE) if name in of]
                for of in (each.ratios, each.at_rest)
            )
            rows.append((each.entry.title, channel, *ratios, each.entry.held_out.get(channel), _judged(each, k)))
            if np.isfinite(resting).any():
                rows.append((each.entry.title, f"{channel}, at rest", *resting, None, "not judged"))
    columns = ("recording", "channel", "model", "least_squares", "estimate", "published", "note")
    heads = {"model": "model as it came", "least_squares": "least squares", "estimate": "trajectory estimate"}
    return Table("Residual of the held-out part over the signal's standard deviation", columns, rows, heads=heads)


def _judged(validation: Validation, k: int) -> str:
    """Decision on a channel in a word or two."""
    if not validation.explained[k]:
        return "not explained by this motion"
    ratio = validation.ratios[ESTIMATE][k] / validation.best_other[k]
    return "best" if ratio <= 1 else "as good" if ratio <= WORSE else f"worse by {100 * (ratio - 1):.0f} %"


def table_published(study: Study) -> Table:
    """Published parameters beside the estimates, with both standard deviations and z."""
    rows: list[tuple[Cell, ...]] = []
    for each in study:
        for published in each.entry.published:
            value, std, std_setup = each.values[published.name]
            unit = each.values.units[each.values.names.index(published.name)]
            z = each.published_z(published)
            numbers = (published.value, published.std, value, std, std_setup, z)
            rows.append((each.entry.title, published.name, unit, *numbers, published.source))
    columns = ("recording", "parameter", "unit", "published", "published_std", "estimate", "std", "std_setup", "z")
    heads = {"published_std": "published s.d."}
    return Table("Published parameters and estimates", (*columns, "source"), rows, decimals=4, heads=heads)


def table_worse(study: Study) -> Table:
    """Channels in which another candidate predicts better by more than 5 %."""
    rows = [
        (each.entry.title, channel, own, CANDIDATES[other], best, f"{100 * (own / best - 1):.0f} %")
        for each in study
        for channel, own, other, best in each.losses
    ]
    heads = {"other": "best other candidate", "best": "its residual", "excess": "worse by"}
    title = f"Channels in which another candidate predicts better by more than {100 * (WORSE - 1):.0f} %"
    return Table(title, ("recording", "channel", "estimate", "other", "best", "excess"), rows, heads=heads)


def table_outside(study: Study) -> Table:
    """Published parameters outside the 95 % intervals."""
    published, outside = table_published(study), {(each.entry.title, name) for each in study for name in each.outside}
    kept = [published.columns.index(x) for x in ("recording", "parameter", "published", "estimate", "std_setup", "z")]
    rows = [[row[k] for k in kept] for row in published.rows if row[:2] in outside]
    columns = tuple(published.columns[k] for k in kept)
    return Table("Published parameters outside the 95 % intervals", columns, rows, decimals=4)


def table_missed(study: Study) -> Table:
    """Reference results that the estimate does not reach."""
    rows: list[tuple[Cell, ...]] = []
    for each in study:
        source = each.entry.reference.source if each.entry.reference else ""
        for goal in (goal for goal in each.goals if not goal.met):
            limit = f"at {'least' if goal.least else 'most'} {goal.wanted:g}"
            rows.append((each.entry.title, goal.what, limit, f"{goal.reached:.3g}", source))
    columns = ("recording", "of", "reference", "reached", "source")
    return Table("Reference results that are not reached", columns, rows, heads={"source": "origin of the reference"})


NONE = "—"
"""Cell of what was not published."""


def table_was_published(study: Study) -> Table:
    """Numbers of parameters, accuracies and held-out residuals that were published with each recording."""
    rows: list[tuple[Cell, ...]] = []
    for each in study:
        published = each.entry.published
        numbers = (len(published), sum(np.isfinite(x.std) for x in published), len(each.entry.held_out))
        shown = [str(number) if number else NONE for number in numbers]
        rows.append((each.entry.title, *shown, f"{each.entry.source.repository}; {each.entry.source.reference}"))
    heads = {"accuracies": "their accuracies", "residuals": "held-out residuals"}
    columns = ("recording", "parameters", "accuracies", "residuals", "source")
    return Table("What was published with the recordings", columns, rows, heads=heads)


def table_steel(validation: Validation) -> Table:
    """Parameters of the double pendulum in the form of the paper's Tables III and IV: published values and errors."""
    rows: list[tuple[Cell, ...]] = []
    for published in validation.entry.published:
        value, _, std = validation.values[published.name]
        k = validation.values.names.index(published.name)
        errors = [float(validation.rivals[name][k]) - published.value for name in (data.MODEL, data.LEAST_SQUARES)]
        rows.append((published.name, published.value, *errors, value - published.value, std))
    columns = ("parameter", "published", "error_model", "error_least_squares", "error", "std")
    heads = {
        "error_model": "error, model as it came",
        "error_least_squares": "error, least squares",
        "error": "error, trajectory estimate",
        "std": "its s.d.",
    }
    title = "Double pendulum in steel: published parameters, and estimates less these, SI units"
    units = tuple(validation.values.units[validation.values.names.index(row[0])] for row in rows)
    return Table(title, columns, rows, decimals=4, heads=heads, units=units)


def table_agreement(study: Study) -> Table:
    """Values of parameters that are equal by construction, and of trials identified alone, with the prior's s.d."""
    rows: list[tuple[Cell, ...]] = []
    for each in study:
        rows += [_estimate(each, name, each.values) for group in each.entry.alike for name in group]
        for trial, values in each.trials.items():
            names = (published.name for published in each.entry.published)
            rows += [_estimate(each, name, values, f", {trial}") for name in names if name in values.names]
    columns = ("recording", "parameter", "estimate", "std", "std_setup", "prior_std")
    title, heads = "Parameters of identical parts and of trials", {"prior_std": "s.d. of the prior"}
    return Table(title, columns, rows, decimals=4, heads=heads)


def _estimate(validation: Validation, name: str, values: Values, of: str = "") -> tuple[Cell, ...]:
    """Row of an estimated parameter; the prior is empty where there is none."""
    prior = float(values.prior[values.names.index(name)])
    return validation.entry.title, f"{name}{of}", *values[name], prior if np.isfinite(prior) else None
