"""Report on a simulated study: its file's tables and figures, key numbers, and the terminal's text."""

import dataclasses
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import cycle
from typing import Any

import numpy as np

from experiments.data import simulated_study
from experiments.data.fitting import ESTIMATORS, Trial
from experiments.data.simulated_study import CHANNELS, SimulatedStudy
from experiments.data.study_file import ESTIMATED, Display, estimator_of
from experiments.document import figures, tabular
from experiments.document.figures import INKS
from experiments.document.replay import Replay, every_nth
from experiments.document.result_folder import OUTPUTS as RESULTS
from experiments.document.tabular import Decimals, as_stated, number, of_deviations, of_numbers
from experiments.document.writer import Document, Plot, sentences
from ident.display.plots import Figure
from ident.mechanism.motion import Motion

STROKES = ("-", "--", ":", "-.")
"""Line styles of other curves, for print without colours."""


def figure(study: SimulatedStudy, name: str) -> Figure:
    """A figure of the study by file name."""
    entry, x, label = study.file.figures[name], study.recording.time, "Time (s)"
    more: dict[str, Any] = {}
    if entry.kind == "contacts":
        drawn = contact_curves(study)
    elif entry.kind == "wrenches":
        drawn = wrench_curves(study, entry.curves)
    elif entry.kind == "residuals":
        drawn, more = residual_curves(study, entry.curves), {"symbol": r"\Delta {}"}
    else:
        drawn, x, label = error_curves(study, entry.curves), np.arange(1, len(x) + 1), "Sample"
        more = {"symbol": r"|\Delta {}|", "lowest": 0.001}
    return figures.wrench_panels(x, drawn, label, shaded=episodes(study), **more)


Drawn = dict[str, tuple[np.ndarray, figures.Line]]
"""Wrenches (N, 6) with their lines, by legend entry."""


def wrench_curves(study: SimulatedStudy, curves: Mapping[str, str]) -> Drawn:
    """Wrenches over time: the true and the measured total, the ground's, and predictions of models."""
    others = iter(other_lines(curves.values(), without="true"))
    drawn: Drawn = {}
    for label, what in curves.items():
        # The truth lies below the others and shows on both sides.
        widest = figures.Line(INKS[inks(curves.values())[what]], 1.6)
        drawn[label] = wrench(study, what), widest if what == "true" else next(others)
    return drawn


def inks(curves: Iterable[str]) -> dict[str, int]:
    """Indices into `INKS` of the wrenches in a figure, in the paper's colours.

    With the ground's wrench in red, the true total is blue and a recovered one black (Figure 4); without it the true
    one is black, and the models' are red and blue (Figure 2).
    """
    shown = list(dict.fromkeys(curves))
    own = {"ground": 1, "true": 2} if "ground" in shown else {"true": 0}
    free = cycle([k for k in range(len(INKS)) if k not in own.values()])
    return {what: own[what] if what in own else next(free) for what in shown}


def page_inks(study: SimulatedStudy, curves: Iterable[str]) -> list[int]:
    """Colours of wrenches on the study's page: those of its first figure of wrenches, or other free ones."""
    entries = (entry.curves.values() for entry in study.file.figures.values() if entry.kind == "wrenches")
    wanted = list(curves)
    chosen = inks([*next(entries, ()), *wanted])
    return [chosen[what] for what in wanted]


def wrench(study: SimulatedStudy, what: str) -> np.ndarray:
    """A wrench by its name in a study file: one of `study_file.WRENCHES`, or a model's prediction (N, 6)."""
    if what == "ground":
        return study.recording.wrench("ground").values
    totals = {"true": lambda: study.true, "measured": lambda: study.measured}
    return totals[what]().values if what in totals else study.fit(what).predicted


def error_curves(study: SimulatedStudy, curves: Mapping[str, str]) -> Drawn:
    """Absolute errors of the recovered wrenches over samples, as dots, and their running RMS.

    Models with equal errors, due to joint noise, have alternating dots, and means that show between each other's
    dashes.
    """
    samples, means = Drawn(), Drawn()
    # The first is drawn lowest and has to be the widest.
    widths = np.linspace(1.6, 0.8, len(curves)).tolist()
    each = zip(curves.items(), other_lines(curves.values()), widths, strict=True)
    for k, ((label, model), line, width) in enumerate(each):
        error = simulated_study.wrench_error(study, model)
        samples[label] = np.abs(error), replace(line, style="", width=0.7, first=k)
        means[f"{label}, running RMS"] = running_rms(error), replace(line, width=width)
    return samples | means


def other_lines(curves: Iterable[str], without: str = "") -> list[figures.Line]:
    """Lines of curves, but for the one `without`, each with its own colour and style."""
    drawn, strokes = list(curves), cycle(STROKES)
    colors = inks(drawn)
    return [figures.Line(INKS[colors[what]], style=next(strokes)) for what in drawn if what != without]


def running_rms(x: np.ndarray) -> np.ndarray:
    """RMS of up to 25 samples around each, a quarter of a second (N, 6)."""
    half = 25 // 2
    sums = np.concatenate([np.zeros((1, 6)), np.cumsum(x**2, axis=0)])
    middle = np.arange(len(x))
    first, last = np.maximum(middle - half, 0), np.minimum(middle + half + 1, len(x))
    return np.sqrt(np.maximum(sums[last] - sums[first], 0) / (last - first)[:, None])


def residual_curves(study: SimulatedStudy, curves: Mapping[str, str]) -> Drawn:
    """Measured total wrench less the models' predictions, over time."""
    lines = other_lines(curves.values()) if len(curves) > 1 else [figures.Line("black")]
    return {
        label: (study.total(model).values - study.fit(model).predicted, replace(line, width=0.4))
        for (label, model), line in zip(curves.items(), lines, strict=True)
    }


def contact_curves(study: SimulatedStudy) -> Drawn:
    """Contribution of each contact to the ground wrench, measured and moved to the base frame, over time."""
    measured, sites = study.measured.values, study.known.sites
    return {
        name.capitalize(): (study.problem.total(study.recording, {name}).values - measured, line)
        for name, line in zip(sites, other_lines(sites), strict=True)
    }


def episodes(study: SimulatedStudy) -> dict[str, np.ndarray]:
    """Samples in which all contacts touch (N,), by legend entry; empty if they never separate."""
    if not study.touching:
        return {}
    touching = np.all(list(study.touching.values()), axis=0)
    return {} if touching.all() else {"All touch" if study.several else "In contact": touching}


UNITS = ("N", "N", "N", "N m", "N m", "N m")

PAPERS = ("paper_error", "true_paper")
"""Columns of published numbers."""

STD = {"": "std_wrench_noise", "weighted": "std_weighted", "trajectory": "trajectory_std"}
"""Columns of standard deviations by estimator."""

RECORDING = "recording.npz"
"""File of the simulated recording."""


def table(study: SimulatedStudy, name: str) -> tabular.Table:
    """A table of the study by file name."""
    entry = study.file.tables[name]
    kinds = {"parameters": parameters, "contacts": contacts}
    return kinds.get(entry.kind, by_row)(study, entry)


def parameters(study: SimulatedStudy, entry: Display) -> tabular.Table:
    """The models' base parameters, a group of columns for each model."""
    groups = entry.groups
    names = study.fit(groups[0]["model"]).base.names
    shown = dict[str, tuple[str, str, str]]()
    for group in groups:
        model = group["model"]
        suffix = group.get("as", "" if model == study.file.main else model)
        shown |= {f"{name}_{suffix}" if suffix else name: (model, name, suffix) for name in group["show"]}
    columns = {column: quantity(study, model, name, names) for column, (model, name, _) in shown.items()}
    notes, beside_paper = _notes(study, groups), _beside_paper(study, groups)
    return tabular.Table(
        "; ".join([f"{entry.caption}, kg, kg m and kg m²", *notes]),
        *tabular.columns(parameter=names, **columns),
        decimals=entry.fixed_decimals,
        digits={column: _decimals(study, *each[:2], names, entry.decimals) for column, each in shown.items()},
        deviations=_deviations(shown),
        marked=frozenset(entry.marked if beside_paper else ()),
        footnote=entry.footnote if beside_paper else "",
        regrouped={
            tabular.heading(suffix).removeprefix(", "): sums(study, model) for model, _, suffix in shown.values()
        },
        caption=entry.caption,
        notes=tuple(f"{note[0].upper()}{note[1:]}." for note in notes),
        bodies=study.known.bodies,
        heads={column: _head(name, suffix) for column, (_, name, suffix) in shown.items()},
    )


def _beside_paper(study: SimulatedStudy, groups: Iterable[Mapping[str, Any]]) -> bool:
    """False if columns of published numbers are empty because other options than the published ones are chosen."""
    return bool(study.file.published) or not any(name in PAPERS for group in groups for name in group["show"])


def sums(study: SimulatedStudy, model: str) -> tuple[str, ...]:
    """Base parameters of a model as sums; estimated axes have no more than four digits."""
    digits = {"digits": 4} if study.file.models[model].axes in ESTIMATED else {}
    return study.fit(model).base.expressions(**digits)


def _decimals(study: SimulatedStudy, model: str, name: str, parameters: Sequence[str], stated: int | None) -> Decimals:
    """Decimals of a column: as published, as the file states, or two digits of the standard deviations."""
    if name in PAPERS:
        return (as_stated(_published_of(study, model, name).values()),) * len(parameters)
    if stated is not None:
        return (stated,) * len(parameters)
    std = np.array(quantity(study, model, STD[estimator_of(name)], parameters), float)
    return of_deviations(std) if name in STD.values() else of_numbers(std)


def _deviations(shown: Mapping[str, tuple[str, str, str]]) -> dict[str, str]:
    """Columns of standard deviations by those of the estimates, or of the errors if there are no estimates."""
    columns, pairs = {each: column for column, each in shown.items()}, {}
    for std, (model, name, suffix) in shown.items():
        if name in STD.values():
            form = {"trajectory": "trajectory_{}", "weighted": "{}_weighted", "": "{}"}[estimator_of(name)]
            either = (columns.get((model, form.format(kind), suffix)) for kind in ("estimated", "error"))
            if (estimate := next(filter(None, either), None)) is not None:
                pairs[estimate] = std
    return pairs


def _head(quantity: str, model: str) -> str:
    """Head of a column in words; the part after the comma is shared with neighbours."""
    words = tabular.heading(quantity)
    return f"{' '.join(reversed(words.split(', ')))}, {tabular.heading(model)}" if model else words


def quantity(study: SimulatedStudy, model: str, name: str, parameters: Iterable[str]) -> Iterable[tabular.Cell]:
    """A column of a table: one of `study_file.QUANTITIES` of a model, NaN where nothing was published."""
    if name in PAPERS:
        return [float(_published_of(study, model, name).get(each, np.nan)) for each in parameters]
    if name == "regrouping":
        return sums(study, model)
    fit: Trial = study.fit(model)
    if name.startswith("trajectory_"):
        fit, name = study.trajectory(model), name.removeprefix("trajectory_")
    elif name.endswith("_weighted"):
        fit, name = study.fit(model, "weighted"), name.removesuffix("_weighted")
    values = {"true": fit.psi_true, "error": fit.error, "std": fit.std, "estimated": fit.psi}
    return values[name.removesuffix("_wrench_noise").removesuffix("_scene")]


def _published_of(study: SimulatedStudy, model: str, name: str) -> Mapping[str, float]:
    """Published numbers of a column, by parameter."""
    published = study.file.published
    numbers: Mapping[str, float] = published.get("true", {})
    return numbers if name == "true_paper" else published.get("error", {}).get(model, {})


def _notes(study: SimulatedStudy, groups: Iterable[Mapping[str, Any]]) -> list[str]:
    """Notes that explain the heads of columns."""
    shown = {name: group["model"] for group in groups for name in group["show"]}
    notes = []
    if "std_wrench_noise" in shown:
        notes.append("s.d. of wrench noise, correlated over time or not")
    if any(name.startswith("trajectory_") for name in shown):
        notes.append(f"trajectory: {ESTIMATORS['trajectory']}")
    return notes


def by_row(study: SimulatedStudy, entry: Display) -> tabular.Table:
    """RMS errors of the recovered wrenches by channel, and their ratios to its s.d.; or tilts of axes by joint."""
    head, unit, units = ("channel", ", N and N m", UNITS) if entry.kind == "wrench errors" else ("tilt", "", ())
    numbers = simulated_study.BY_ROW[entry.kind](study, entry.models)
    columns = (head, *next(iter(numbers.values())))
    rows = [(name, *own.values()) for name, own in numbers.items()]
    return tabular.Table(entry.caption + unit, columns, rows, entry.fixed_decimals, caption=entry.caption, units=units)


def contacts(study: SimulatedStudy, entry: Display) -> tabular.Table:
    """Fraction and episodes of each contact, and its peak force."""
    touching, sites = simulated_study.touches(study), study.file.scene.contacts.values()
    numbers = ("fraction", "fraction_alone", "episodes", "peak_force_N")
    heads = ("touches", "touches_alone", "episodes", "peak_force_N")
    columns = {
        head: [touching[f"{site}_{number}"] for site in sites] for head, number in zip(heads, numbers, strict=True)
    }
    links = [body for body, _ in study.known.sites.values()]
    own = tabular.columns(contact=study.known.sites, link=links, **columns)
    return tabular.Table(entry.caption, *own, decimals=entry.fixed_decimals)


OUTPUTS = (*RESULTS, RECORDING)
"""Patterns of the files that it writes."""


def lines(study: SimulatedStudy) -> list[str]:
    """Sentences with the main numbers."""
    errors = {model.title: [*_errors(study, name)] for name, model in study.file.models.items()}
    return sentences(
        "study.txt",
        study=study,
        errors=errors,
        axes=simulated_study.axes,
        axis_errors=simulated_study.axis_errors,
        touches=simulated_study.touches,
    )


def _errors(study: SimulatedStudy, name: str) -> Iterator[str]:
    """Yields the largest error of each estimator of a model."""
    for each in study.file.models[name].estimators:
        if each != "trajectory":
            yield f"{np.abs(study.fit(name, each).error).max():.3f} {each}"
    if "trajectory" in study.file.models[name].estimators:
        largest = study.trajectory(name).largest_error
        yield "trajectory not determined" if largest is None else f"{number(largest)} trajectory"


def replay(study: SimulatedStudy) -> Replay:
    """Replay of the simulated motion, with the total wrench: true, measured, and predicted by the models."""
    recording = study.problem.with_cells(study.recording)
    arm = dataclasses.replace(study.known, tree=study.problem.true)
    # Models that share others' parameters predict nearly the same as with their own.
    predicted = {model.title: name for name, model in study.file.models.items() if model.parameters is None}
    curves = {what: what for what in ("true", "measured")} | predicted
    drawn = every_nth(len(recording.time), len(curves) * len(CHANNELS))
    return Replay(
        mechanism=arm,
        recording=recording,
        motion=Motion(*recording.joint_states(arm.tree.joints)),
        channels=list(zip(CHANNELS, UNITS, strict=True)),
        drawn=drawn,
        curves={label: wrench(study, what)[drawn] for label, what in curves.items()},
        inks=page_inks(study, curves.values()),
        remark="Torques are about the origin of the base frame; models are fitted to the wrenches that they know.",
    )


def document(study: SimulatedStudy, provenance: dict[str, Any]) -> Document:
    """All tables and figures that the file describes, the summary, a replay, and the recording with its load cells."""
    file = study.file
    models = [model.title for model in file.models.values()]
    about = (
        f"Simulated from the scene '{file.scene.identity['name']}' and identified anew, a model at a time: "
        f"{'; '.join(models)}."
    )
    return Document(
        file.title,
        about,
        lines=lines(study),
        tables={name: table(study, name) for name in file.tables},
        figures={name: Plot(partial(figure, study, name), e.caption) for name, e in file.figures.items()},
        numbers={
            "summary": simulated_study.summary(study) | {"trajectory": simulated_study.trajectory_summary(study)},
            "provenance": provenance,
        },
        replay=replay(study),
        recordings={RECORDING: study.problem.with_cells(study.recording)},
    )
