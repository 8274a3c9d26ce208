"""Report on a comparison of results: differences with their intervals, prediction, set-up and settings."""

from collections.abc import Sequence
from functools import partial
from itertools import chain, compress, product
from pathlib import Path
from typing import Any

import numpy as np

from experiments.data.comparison import Difference, Result
from experiments.document import pictures, tabular, typography
from experiments.document.figures import SHEET, paper_style
from experiments.document.result_folder import OUTPUTS as RESULTS
from experiments.document.tabular import of_deviations, of_numbers
from experiments.document.typography import wrapped
from experiments.document.writer import Card, Document, Headline, Plot, sentences
from ident.display.brief import listed
from ident.display.plots import Figure, add_legend, row_panels
from ident.tolerances import INTERVAL

OUTPUTS = (*RESULTS, "comparison.json")
"""Patterns of the files that it writes."""

RELATIONS = {
    "Differ": (" by more than noise", "not"),
    "Share logs": (": their difference has no interval", "partly"),
    "Agree": (" within noise", "usable"),
}
"""Ends of sentences and outcomes by the words for two results, the worst first."""


def differences_table(difference: Difference) -> tabular.Table:
    """Parameters of both, and their difference, with its interval if the logs are independent."""
    first, second, comparison = difference.first, difference.second, difference.comparison
    names, wide = difference.names, difference.std_setup
    std = np.sqrt(np.diag(comparison.covariance))
    sums = [first.made_of[name] for name in names]
    (of_first, _, std_first), (of_second, _, std_second) = first.at(names), second.at(names)
    # Logs that are not independent leave the difference without intervals.
    known = np.nan if difference.shared else 1.0
    return tabular.Table(
        f"Parameters of {first.name} less those of {second.name}, SI units"
        + "; ± 95 % intervals of the difference" * (not difference.shared),
        *tabular.columns(
            parameter=names,
            first=of_first,
            second=of_second,
            difference=comparison.difference,
            interval_95=known * INTERVAL * std,
            interval_setup_95=known * INTERVAL * wide,
            z=known * comparison.z,
            regrouping=sums,
        ),
        digits={
            "first": of_numbers(std_first),
            "second": of_numbers(std_second),
            "difference": of_numbers(wide),
            "z": [1] * len(names),
            "interval_95": of_deviations(INTERVAL * std),
            "interval_setup_95": of_deviations(INTERVAL * wide),
        },
        regrouped={"": sums},
        caption="Base parameters and drives of two identifications and their difference",
        notes=(
            f"First: {first.name}. Second: {second.name}. Interval: half of the difference's 95 % interval from noise, "
            "setup: with the uncertainty of each set-up. Logs have to be independent.",
        ),
        bodies=first.bodies,
    )


def prediction_table(results: Sequence[Result]) -> tabular.Table:
    """Residual over signal of each result on its own held-out part, by channel."""
    every = [result.estimate["held_out"] for result in results]
    columns = {"channel": list(dict.fromkeys(channel for held in every for channel in held))}
    for result, held in zip(results, every, strict=True):
        columns[result.name] = [held.get(channel, {}).get("ratio", np.nan) for channel in columns["channel"]]
    part = "held-out" if all(result.estimate.get("part", "held-out") == "held-out" for result in results) else "judged"
    note = "Signals are as measured or filtered, as the estimator uses them: compare results of one estimator."
    title = f"Residual over signal of each result's {part} part"
    return tabular.Table(title, *tabular.columns(**columns), notes=(note,))


def setup_table(results: Sequence[Result]) -> tabular.Table:
    """Set-up errors that each result reports."""
    setups = [{each["name"]: each["text"] for each in result.estimate["setup"]} for result in results]
    rows = [(name, *(each.get(name, "as stated") for each in setups)) for name in dict.fromkeys(chain(*setups))]
    return tabular.Table("Set-up", ("what", *(result.name for result in results)), rows)


def settings_table(results: Sequence[Result]) -> tabular.Table:
    """Settings that differ between the results."""
    settings = [result.settings for result in results]
    keys = dict.fromkeys(chain(*settings))
    rows = [(tabular.heading(key), *(each.get(key, "none") for each in settings)) for key in keys]
    kept = [row for row in rows if len({*row[1:]}) > 1]
    return tabular.Table("Settings that differ", ("setting", *(result.name for result in results)), kept)


def relation(difference: Difference) -> str:
    """The key of `RELATIONS` for two results."""
    return "Share logs" if difference.shared else "Differ" if difference.comparison.differs else "Agree"


def title(difference: Difference) -> str:
    """Two results and whether they agree, in a few words."""
    return f"'{difference.first.name}' and '{difference.second.name}' {relation(difference).lower()}"


def headline(pairs: Sequence[Difference]) -> Headline:
    """Headline of the results that differ most."""
    each = [relation(pair) for pair in pairs]
    word = next(word for word in RELATIONS if word in each)
    count = f"{each.count(word)} of {len(pairs)} results beside '{pairs[0].first.name}' {word.lower()}"
    of = title(pairs[0]) if len(pairs) == 1 else count
    return Headline(word, f"{of}{RELATIONS[word][0]}.", RELATIONS[word][1])


def agreement(difference: Difference, *, first: bool = True) -> str:
    """Sentences on the agreement of two results, without those that the first pair has for all."""
    either = dict.fromkeys((*difference.first.made_of, *difference.second.made_of))
    others = [name for name in either if name not in difference.names]
    within = np.abs(difference.comparison.difference) <= INTERVAL * difference.std_setup
    return " ".join(sentences("compare.txt", pair=difference, within=within, others=others, first=first))


def figure(difference: Difference) -> Figure:
    """Differences in units of their standard deviation from noise, with intervals from noise and from the set-up."""
    std = np.sqrt(np.diag(difference.comparison.covariance))
    z, wider = difference.comparison.z, INTERVAL * difference.std_setup / std
    with paper_style():
        labels = [typography.named_symbol(name, difference.first.bodies) for name in difference.names]
        drawn, panels = row_panels(SHEET, labels, "Difference in its standard deviations from noise")
        # The abscissa is linear up to this difference, and logarithmic beyond.
        linear = 10.0
        widest = max(np.abs(z).max(initial=0) + wider.max(initial=0), linear)
        powers = linear ** np.arange(1, 1 + int(np.log10(widest)))
        for ax, rows in panels:
            ax.axvline(0, color="0.6", lw=0.6)
            grey: dict[str, Any] = {"fmt": "none", "lw": 0.6, "color": "0.6"}
            ax.errorbar(z[rows], rows, xerr=wider[rows], label="Noise and set-up, 95 %", **grey)
            ax.errorbar(z[rows], rows, xerr=INTERVAL, fmt="o", ms=2.5, lw=1.2, color="C0", label="Noise, 95 %")
            ax.set_xscale("symlog", linthresh=linear)
            ax.set_xticks([*-powers[::-1], 0, *powers])
            ax.minorticks_off()
        add_legend(drawn)
    return drawn


def document(compared: Sequence[Result], provenance: dict[str, Any]) -> Document:
    """Each result compared with the first."""
    pairs = [Difference(compared[0], other) for other in compared[1:]]
    tables, drawn = dict[str, tabular.Table](), dict[str, Plot]()
    rows, texts = dict[str, np.ndarray](), dict[str, str]()
    labels = pictures.labels_of([pair.second.name for pair in pairs])
    for number, (label, pair) in enumerate(zip(labels, pairs, strict=True), start=2):
        end = f"_{number}" if len(pairs) > 1 else ""
        tables[f"table_differences{end}"] = differences_table(pair)
        first = all(bool(each.shared) != bool(pair.shared) for each in pairs[: number - 2])
        texts[title(pair)] = f"{headline([pair]).sentence} " * (len(pairs) > 1) + agreement(pair, first=first)
        if not pair.shared:
            caption = f"Base parameters and drives of {pair.first.name} less those of {pair.second.name}."
            drawn[f"figure_differences{end}"] = Plot(partial(figure, pair), caption)
            rows[f"{number}: {label}"] = pair.comparison.z / INTERVAL
    tables["table_prediction"] = prediction_table(compared)
    others = {"table_setup": setup_table(compared), "table_settings": settings_table(compared)}
    tables |= {name: table for name, table in others.items() if table.rows}
    agree = [relation(pair) == "Agree" for pair in pairs]
    return Document(
        f"{' and '.join(result.name for result in compared)}, compared",
        headline=headline(pairs),
        pictures=[pictures.coverage(rows, f"parameters less those of {compared[0].name}")] if rows else [],
        findings=[Card(*each, True) for each, same in zip(texts.items(), agree, strict=True) if not same],
        lines=[
            *compress(texts.values(), agree),
            *(f"{each.name}: fitted to {listed(each.logs.values())}. {each.estimate['verdict']}" for each in compared),
        ],
        heading="What is compared",
        tables=tables,
        figures=drawn,
        numbers={"comparison": {"pairs": [*map(_numbers, pairs)]}, "provenance": provenance},
        screen="\n".join(
            [*(table.text() for table in tables.values()), headline(pairs).line, *map(wrapped, texts.values())]
        ),
    )


def _numbers(pair: Difference) -> dict[str, Any]:
    """All numbers of two results for scripts."""
    comparison, shared = pair.comparison, pair.shared
    return {
        "first": pair.first.name,
        "second": pair.second.name,
        "parameters": list(pair.names),
        "difference": comparison.difference.tolist(),
        "shared_logs": shared,
        "std": None if shared else np.sqrt(np.diag(comparison.covariance)).tolist(),
        "std_setup": None if shared else pair.std_setup.tolist(),
        "chi2": None if shared else comparison.chi2,
        "p_value": None if shared else comparison.p_value,
        "settings": {key: list(values) for key, values in pair.settings.items()},
    }


def inputs(folders: Sequence[Path]) -> list[Path]:
    """All input files."""
    return [folder / name for folder, name in product(folders, ("estimate.json", "provenance.json"))]
