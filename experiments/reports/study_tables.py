"""Tables of a simulated study, as described in its file."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from experiments.data import key_numbers
from experiments.data.fitting import ESTIMATORS, TrajectoryTrial, Trial
from experiments.data.simulated import Study
from experiments.document import tabular

UNITS = ("N", "N", "N", "N m", "N m", "N m")


def table(study: Study, name: str) -> tabular.Table:
    """A table of the study by file name."""
    entry = study.file.tables[name]
    kinds = {"parameters": parameters, "wrench errors": wrench_errors, "contacts": contacts}
    return kinds[entry["kind"]](study, entry)


def parameters(study: Study, entry: Mapping[str, Any]) -> tabular.Table:
    """The models' base parameters, a group of columns for each model."""
    groups = entry["groups"]
    names = study.fit(groups[0]["model"]).base.names
    columns: dict[str, Any] = {"parameter": names}
    heads: dict[str, str] = {}
    for group in groups:
        suffix = group.get("as", "" if group["model"] == study.file.main else group["model"])
        for name in group["show"]:
            column = f"{name}_{suffix}" if suffix else name
            columns[column] = quantity(study, group["model"], name, names)
            heads[column] = _head(name, suffix)
    notes = _notes(study, groups)
    units = "kg, kg m and kg m²"
    return tabular.Table(
        "; ".join([f"{entry['caption']}, {units}", *notes]),
        *tabular.columns(**columns),
        decimals=entry.get("decimals", 3),
        marked=frozenset(entry.get("marked", ())),
        footnote=entry.get("footnote", ""),
        caption=entry["caption"],
        notes=tuple(f"{note[0].upper()}{note[1:]}." for note in notes),
        bodies=study.known.bodies,
        heads=heads,
    )


def _head(quantity: str, model: str) -> str:
    """Head of a column in words; the part after the comma is shared with neighbours."""
    words = tabular.heading(quantity)
    return f"{' '.join(reversed(words.split(', ')))}, {tabular.heading(model)}" if model else words


def quantity(study: Study, model: str, name: str, parameters: Iterable[str]) -> Iterable[tabular.Cell]:
    """A column of a table: one of `study_displays.QUANTITIES` of a model, NaN where nothing was published."""
    published = study.file.published
    if name == "paper_error":
        return _published(published.get("error", {}).get(model, {}), parameters)
    if name == "true_paper":
        return _published(published.get("true", {}), parameters)
    if name == "regrouping":
        # Recovered axes have no more digits.
        digits = {"digits": 4} if study.file.models[model].axes == "recovered" else {}
        return study.fit(model).base.expressions(**digits)
    fit: Trial | TrajectoryTrial = study.fit(model)
    if name.startswith("trajectory_"):
        fit, name = study.trajectory(model), name.removeprefix("trajectory_")
    elif name.endswith("_weighted"):
        fit, name = study.fit(model, "weighted"), name.removesuffix("_weighted")
    values = {"true": fit.psi_true, "error": fit.error, "std": fit.std, "estimated": fit.error + fit.psi_true}
    if isinstance(fit, Trial):
        values["estimated"] = fit.estimate.psi
    return values[name.removesuffix("_wrench_noise").removesuffix("_scene")]


def _published(numbers: Mapping[str, float], parameters: Iterable[str]) -> list[float]:
    return [float(numbers.get(name, np.nan)) for name in parameters]


def _notes(study: Study, groups: Iterable[Mapping[str, Any]]) -> list[str]:
    """Notes that explain the heads of columns."""
    shown = {name: group["model"] for group in groups for name in group["show"]}
    notes = []
    if "std_wrench_noise" in shown:
        notes.append(f"s.d. of wrench noise, {study.fit(shown['std_wrench_noise']).estimate.noise}")
    if any(name.startswith("trajectory_") for name in shown):
        notes.append(f"trajectory: {ESTIMATORS['trajectory']}")
    return notes


def wrench_errors(study: Study, entry: Mapping[str, Any]) -> tabular.Table:
    """RMS errors of the recovered wrenches by channel, and their ratio to the channel's standard deviation."""
    errors = key_numbers.wrench_errors(study, entry["models"])
    columns = ("channel", *next(iter(errors.values())))
    rows = tuple((channel, *numbers.values()) for channel, numbers in errors.items())
    title = f"{entry['caption']}, N and N m"
    return tabular.Table(title, columns, rows, entry.get("decimals", 3), caption=entry["caption"], units=UNITS)


def contacts(study: Study, entry: Mapping[str, Any]) -> tabular.Table:
    """Fraction and episodes of each contact, and its peak force."""
    touching, known = key_numbers.touches(study), study.known

    def each(number: str) -> list[float]:
        return [touching[f"{site}_{number}"] for site in study.file.scene.contacts.values()]

    return tabular.Table(
        entry["caption"],
        *tabular.columns(
            contact=known.sites,
            link=[body for body, _ in known.sites.values()],
            touches=each("fraction"),
            touches_alone=each("fraction_alone"),
            episodes=each("episodes"),
            peak_force_N=each("peak_force_N"),
        ),
        decimals=entry.get("decimals", 3),
    )
