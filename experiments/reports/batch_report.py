"""Report on identifications of many logs: one table of all, failures by name, and the logs that differ."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.data.comparison import LogAgreement, LogOutcome, spreads
from experiments.document import pictures, tabular, typography
from experiments.document.figures import empty_figure
from experiments.document.result_folder import OUTPUTS as RESULTS
from experiments.document.tabular import of_deviations
from experiments.document.writer import Card, Document, Headline, Plot, sentences
from ident.display.brief import listed
from ident.display.plots import Figure, add_legend, label_above
from ident.geometry.inertia import with_bodies
from ident.judgement.finding import title_of
from ident.judgement.residuals import DISAGREE
from ident.judgement.verdict import Outcome as Verdict
from ident.judgement.wording import number_of
from ident.mechanism.mechanism import Mechanism
from ident.tolerances import INTERVAL

OUTPUTS = (*RESULTS, "batch.json")
"""Patterns of the files that it writes."""

ROUNDING = 1e-6
"""Difference of two logs' parameters over their standard deviations, up to which one log is a copy of the other."""


def logs_table(outcomes: Sequence[LogOutcome], differs: Sequence[str]) -> tabular.Table:
    """Verdict, doubts and residuals of every log, what it differs in, or the sentence with which it failed."""
    counted = [len(each.predicted) + len(each.missed) for each in outcomes]
    nan = float("nan")
    return tabular.Table(
        "Logs, each identified by itself",
        *tabular.columns(
            log=[each.log for each in outcomes],
            verdict=[Verdict(each.verdict).word if each.verdict else "failed" for each in outcomes],
            predicted=["" if x.error else f"{len(x.predicted)} of {k}" for x, k in zip(outcomes, counted, strict=True)],
            doubts=["; ".join(map(title_of, each.doubts)) for each in outcomes],
            least_ratio=[min(each.ratios.values(), default=nan) for each in outcomes],
            largest_ratio=[max(each.ratios.values(), default=nan) for each in outcomes],
            differs_most_in=differs,
            cpu_s=[each.seconds for each in outcomes],
            results=[each.folder and f"{each.folder}/" for each in outcomes],
            error=[each.error for each in outcomes],
        ),
        heads={
            "predicted": "channels predicted",
            "least_ratio": "residual over signal, least",
            "largest_ratio": "largest",
            "cpu_s": "CPU time (s)",
        },
        decimals=2,
    )


def parameters_table(outcomes: Sequence[LogOutcome], arm: Mechanism) -> tabular.Table:
    """Parameters over the logs that did not fail: mean, spread, and agreement with the logs' own deviations."""
    rows = spreads(outcomes)
    return tabular.Table(
        "Parameters over the logs, SI units",
        ("parameter", "logs", "mean", "std_of_mean", "between_logs", "rms_z"),
        [(each.name, each.logs, each.mean, each.std, each.between, each.rms_z) for each in rows],
        decimals=2,
        deviations={"mean": "std_of_mean"},
        digits={"between_logs": of_deviations(each.between for each in rows)},
        bodies=arm.bodies,
        carriers=arm.tree.carriers,
        units=tuple(each.unit for each in rows),
        heads={"std_of_mean": "s.d. of the mean", "between_logs": "s.d. between logs", "rms_z": "RMS z"},
        notes=(
            "The mean is weighted by the inverse variances of the logs, which include the set-up's uncertainty and "
            "count as independent. RMS z is about one where the logs' own deviations are right, and less where the "
            "logs share an error of the set-up.",
        ),
    )


def chart(outcomes: Sequence[LogOutcome], agreed: LogAgreement, bodies: tuple[str, ...]) -> Figure:
    """The four parameters that logs differ in most, over the rows of the logs, with intervals from the logs' noise."""
    names, apart = [agreed.names[k] for k in agreed.most[:4]], agreed.differ
    numbers = np.array([k for k, each in enumerate(outcomes, start=1) if not each.error])
    outcomes = [each for each in outcomes if not each.error]
    with empty_figure(0.6 + 0.95 * len(names), wide=True) as figure:
        panels = figure.subplots(len(names), sharex=True, squeeze=False)[:, 0]
        for name, ax in zip(names, panels, strict=True):
            values = np.array([each.values[name] for each in outcomes])
            half = INTERVAL * agreed.std[:, agreed.names.index(name)]
            for which, color, label in ((~apart, "C0", "Agrees, 95 %"), (apart, "C1", "Differs, 95 %")):
                if which.any():
                    dots = numbers[which], values[which], half[which]
                    ax.errorbar(*dots, fmt="o", ms=2.5, lw=0.8, color=color, label=label)
            label_above(ax, f"{typography.named_symbol(name, bodies)} ({outcomes[0].units[name]})")
        panels[-1].set_xlabel("Log")
        panels[-1].locator_params(axis="x", integer=True)
        add_legend(figure)
    return figure


def picture(outcomes: Sequence[LogOutcome], agreed: LogAgreement) -> str:
    """Picture of the parameters of each log less those of the others, of the 12 that differ most, by their rows."""
    fitted = [(number, Path(each.log).name) for number, each in enumerate(outcomes, start=1) if not each.error]
    shown = np.sort(np.argsort(-agreed.chi2, kind="stable")[:12]).tolist()
    names = pictures.labels_of([fitted[k][1] for k in shown])
    rows = {f"{fitted[k][0]}: {name}": agreed.z[k] / INTERVAL for k, name in zip(shown, names, strict=True)}
    return pictures.coverage(rows, "parameters less those of other logs")


def differences(outcomes: Sequence[LogOutcome], agreed: LogAgreement, bodies: tuple[str, ...]) -> list[str]:
    """For each log, what it differs from the others in most, with z; empty for one that agrees."""
    most = np.abs(agreed.z).argmax(axis=1)
    each = enumerate(zip(most, agreed.differ, strict=True))
    return [_most(outcomes, agreed, k, [row], bodies) if differs else "" for row, (k, differs) in each]


def _most(
    outcomes: Sequence[LogOutcome], agreed: LogAgreement, k: int, logs: Sequence[int], bodies: tuple[str, ...]
) -> str:
    """A parameter with the least and largest difference of some logs, and their z."""
    by, z = _span(agreed.difference[logs, k], "+.3g"), _span(agreed.z[logs, k], "+.1f")
    return f"{with_bodies([agreed.names[k]], bodies)} by {by} {outcomes[0].units[agreed.names[k]]} (z {z})"


def _span(values: np.ndarray, form: str) -> str:
    """Least and largest of some numbers, or the one that both are."""
    return " to ".join(dict.fromkeys(f"{each:{form}}" for each in (values.min(), values.max())))


def _copied(one: LogOutcome, other: LogOutcome) -> bool:
    """True if two estimates differ by rounding alone, as where a copy counts its times from elsewhere."""
    if not one.values or one.values.keys() != other.values.keys():
        return False
    return all(abs(x - other.values[name]) <= ROUNDING * one.std.get(name, 0.0) for name, x in one.values.items())


def verdict(outcomes: Sequence[LogOutcome], agreed: LogAgreement, bodies: tuple[str, ...]) -> tuple[str, str]:
    """Sentences on the agreement of the logs, and the doubt that they are; "" if they are none."""
    firsts = [next((y.log for y in outcomes[:k] if _copied(x, y)), "") for k, x in enumerate(outcomes)]
    copies = [f"{x.log} (as {first})" for x, first in zip(outcomes, firsts, strict=True) if first]
    k, differ, wide = agreed.most[0], agreed.differ, agreed.spread > DISAGREE
    names = [each.log for each, differs in zip(outcomes, differ, strict=True) if differs]
    most = with_bodies([agreed.names[k]], bodies)
    chi2 = ""
    if names:
        most = _most(outcomes, agreed, int(k), np.flatnonzero(differ).tolist(), bodies)
        chi2 = _span(agreed.chi2[differ], ".0f")
    more = {"wide": wide, "names": names, "most": most, "chi2": chi2, "listed": listed, "copies": copies}
    text = sentences("batch.txt", agreed=agreed, number=len(outcomes), **more)
    return " ".join(text), "Copies" if copies else "Differ" if names or wide else ""


def document(
    model: Path, outcomes: Sequence[LogOutcome], agreed: LogAgreement | None, arm: Mechanism, provenance: dict[str, Any]
) -> Document:
    """Tables of all logs and of the parameters over them.

    Args:
        model: The model's file.
        outcomes: What became of each log.
        agreed: Agreement of the logs that did not fail, if it can be judged.
        arm: The model's mechanism.
        provenance: Provenance of the results.
    """
    bodies = arm.bodies
    failed, fitted = ([each for each in outcomes if bool(each.error) is error] for error in (True, False))
    counts = [f"{sum(each.verdict == word.value for each in outcomes)} {word.word}" for word in Verdict]
    sentence, doubt = ("", "") if agreed is None else verdict(fitted, agreed, bodies)
    logs = number_of(len(outcomes), "log")
    count = f"{logs}: {', '.join(counts)}, {len(failed)} failed."
    title = "Copies of a log" if doubt == "Copies" else "Logs differ"
    doubts = [(title, sentence)] if doubt else []
    doubts += [(f"{x.log} failed", f"{x.log} failed: {x.error.removeprefix(f'{x.log}: ')}") for x in failed]
    outcome = "not" if doubt else "usable" if all(each.verdict == "usable" for each in outcomes) else "partly"
    headline = None if agreed is None else Headline(doubt or "Agree", count, outcome)
    each_differs = iter([] if agreed is None else differences(fitted, agreed, bodies))
    differs = ["" if each.error else next(each_differs, "") for each in outcomes]
    tables = {"table_logs": logs_table(outcomes, differs)}
    if fitted:
        tables["table_parameters"] = parameters_table(outcomes, arm)
    caption = "The parameters that logs differ in most, with 95 % intervals of the logs' noise; logs by their row."
    return Document(
        f"{model.name}, identified from {'each of ' * (len(outcomes) > 1)}{logs}",
        headline=headline,
        pictures=[] if agreed is None else [picture(outcomes, agreed)],
        findings=[Card(*each, True) for each in doubts],
        lines=[*([sentence] if sentence and not doubt else []), count],
        heading="The logs",
        tables=tables,
        figures={} if agreed is None else {"figure_logs": Plot(partial(chart, outcomes, agreed, bodies), caption)},
        numbers={
            "batch": {"logs": [each.to_dict() for each in outcomes], "agreement": _numbers(fitted, agreed)},
            "provenance": provenance,
        },
    )


def _numbers(outcomes: Sequence[LogOutcome], agreed: LogAgreement | None) -> dict[str, Any] | None:
    """Agreement of the logs for scripts."""
    if agreed is None:
        return None
    numbers = {"differs": agreed.differ, "chi2": agreed.chi2, "difference": agreed.difference, "std": agreed.std}
    logs = {each.log: {key: x[k].tolist() for key, x in numbers.items()} for k, each in enumerate(outcomes)}
    return {"parameters": agreed.names, "spread": agreed.spread, "logs": logs}
