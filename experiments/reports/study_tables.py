"""Tables of a simulated study, as described in its file."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from experiments.data.fitting import ESTIMATORS, TrajectoryTrial, Trial
from experiments.data.simulated import Study
from experiments.document import report

CHANNELS = ("Fx", "Fy", "Fz", "τx", "τy", "τz")
"""The wrench's components in the paper's names."""

UNITS = ("N", "N", "N", "N m", "N m", "N m")

STILL = 1e-9
"""Standard deviation, N or N m, below which a channel has only rounding errors."""


def table(study: Study, name: str) -> report.Table:
    """A table of the study by file name."""
    entry = study.file.tables[name]
    kinds = {"parameters": parameters, "wrench errors": wrench_errors, "contacts": contacts}
    return kinds[entry["kind"]](study, entry)


def parameters(study: Study, entry: Mapping[str, Any]) -> report.Table:
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
    return report.Table(
        "; ".join([f"{entry['caption']}, {units}", *notes]),
        *report.columns(**columns),
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
    words = report.heading(quantity)
    return f"{' '.join(reversed(words.split(', ')))}, {report.heading(model)}" if model else words


def quantity(study: Study, model: str, name: str, parameters: Iterable[str]) -> Iterable[report.Cell]:
    """A column of a table: one of `study_entries.QUANTITIES` of a model, NaN where nothing was published."""
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


def wrench_errors(study: Study, entry: Mapping[str, Any]) -> report.Table:
    """RMS errors of the recovered wrenches by channel, and their ratio to the channel's standard deviation."""
    std, models = study.true.values.std(axis=0), entry["models"]
    rms = [np.sqrt((wrench_error(study, model) ** 2).mean(axis=0)) for model in models]
    rows = tuple(
        (name, float(s), *map(float, x), *(float(r / s) if s > STILL else None for r in x))
        for name, s, *x in zip(CHANNELS, std, *rms, strict=True)
    )
    columns = ("channel", "true_std", *(f"{what}_{model}" for what in ("rms", "ratio") for model in models))
    title = f"{entry['caption']}, N and N m"
    return report.Table(title, columns, rows, entry.get("decimals", 3), caption=entry["caption"], units=UNITS)


def wrench_error(study: Study, model: str) -> np.ndarray:
    """Recovered less true, noise-free total wrench (N, 6)."""
    return study.fit(model).predicted - study.true.values


def touches(study: Study) -> dict[str, float]:
    """Fraction and episodes of each contact and its peak force; fractions in which all and none touch."""
    number = np.sum(list(study.touching.values()), axis=0)
    found: dict[str, float] = {}
    for name, touching in study.touching.items():
        site = study.file.scene.contacts[name]
        found |= {
            f"{site}_fraction": float(touching.mean()),
            f"{site}_fraction_alone": float(np.mean(touching & (number == 1))),
            f"{site}_episodes": int(touching[0] + np.sum(~touching[:-1] & touching[1:])),
            f"{site}_peak_force_N": float(np.linalg.norm(study.recording.true[f"{site}_force"], axis=1).max()),
        }
    return found | {
        "contact_peak_force_N": max(x for key, x in found.items() if key.endswith("_peak_force_N")),
        "fraction_all_touch": float(np.mean(number == len(study.touching))),
        "fraction_none_touches": float(np.mean(number == 0)),
    }


def contacts(study: Study, entry: Mapping[str, Any]) -> report.Table:
    """Fraction and episodes of each contact, and its peak force."""
    found, known = touches(study), study.known

    def each(number: str) -> list[float]:
        return [found[f"{site}_{number}"] for site in study.file.scene.contacts.values()]

    return report.Table(
        entry["caption"],
        *report.columns(
            contact=known.sites,
            link=[body for body, _ in known.sites.values()],
            touches=each("fraction"),
            touches_alone=each("fraction_alone"),
            episodes=each("episodes"),
            peak_force_N=each("peak_force_N"),
        ),
        decimals=entry.get("decimals", 3),
    )
