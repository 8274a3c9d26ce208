"""What an identification leaves behind: tables, figures, a page, numbers for scripts, and the updated model."""

import html
import json
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import NullFormatter

from experiments.output import escape, figures, page, report
from experiments.studies.identification import Identification
from experiments.studies.preparation import COMPONENTS
from experiments.studies.verdict import SIGNIFICANT, Finding, findings, verdict
from ident.geometry.inertia import PARAMETERS
from ident.judgement.diagnosis import amplitude_spectrum
from ident.parameters.base_parameters import separating_sensors
from ident.parameters.consistency import ConsistentParameters, consistent_parameters
from sim.models.model_update import write_model
from sim.models.urdf import parsed

OUTPUTS = (*report.OUTPUTS, "report.html", "estimate.json", "model.xml", "model.urdf")
FAR = 2.0
"""Distance of the physical bodies from the estimate, over √r as noise would make it, from which it is doubted."""

FACTOR = 2.0
"""By how much a body's mass may differ from the model's without a remark."""

SLIGHT = 1e-3
"""Bodies below this fraction of the whole mass are not worth a remark."""

GAINS = {
    "base wrench": "with the base wrench",
    "joint torques": "with joint torques",
    "moving base": "on a moving base",
    "not parallel": "if the joint axes were not parallel",
}

INTERVAL = 1.96
"""Standard deviations of a 95 % interval."""


def parameters_table(result: Identification) -> report.Table:
    """Base parameters with their uncertainty beside the model's own."""
    base, fit = result.prepared.base, result.fit
    prior = base.regroup(result.prepared.prior)
    priors = [*prior, *[None] * (len(result.names) - base.rank)]
    regroupings = [*base.expressions(digits=4), *[""] * (len(result.names) - base.rank)]
    rows = tuple(
        (name, float(value), float(std), _relative(value, std), None if p is None else float(p), expression)
        for name, value, std, p, expression in zip(result.names, fit.values, fit.std, priors, regroupings, strict=True)
    )
    columns = ("parameter", "estimate", "std", "std_relative", "model", "regrouping")
    return report.Table("Base parameters, SI units", columns, rows)


def _relative(value: float, std: float) -> str:
    """Relative standard deviation, or its absolute value where the estimate is not far from zero."""
    return f"{100 * std / abs(value):.1f} %" if abs(value) > 3 * std else f"{std:.2g} abs."


def quality_table(result: Identification, full: ConsistentParameters) -> report.Table:
    """How well each channel is predicted on the part that was held out."""
    held = result.held_out
    rows = tuple(
        (channel, float(signal), float(residual), float(ratio), float(updated), float(time), note)
        for channel, signal, residual, ratio, updated, time, note in zip(
            result.prepared.channels,
            held.measured.std(axis=0),
            np.sqrt((held.residual**2).mean(axis=0)),
            held.ratio,
            held.ratio_with(full.psi - result.psi),
            result.correlation,
            ["not explained by this motion" if c in result.unexplained else "" for c in result.prepared.channels],
            strict=True,
        )
    )
    columns = ("channel", "signal_std", "residual_rms", "ratio", "ratio_updated_model", "correlation_s", "note")
    return report.Table("Prediction of the held-out part", columns, rows)


def full_table(result: Identification, full: ConsistentParameters) -> report.Table:
    """A physically consistent φ of every body beside the model's."""
    bodies = [name for name in _bodies(result) for _ in PARAMETERS]
    return report.Table(
        "Full, physically consistent parameters, SI units",
        *report.columns(
            body=bodies, parameter=result.prepared.base.parameters, estimate=full.phi, model=result.prepared.prior
        ),
    )


def _bodies(result: Identification) -> list[str]:
    """Names of the bodies with a φ, in the order in which the parameters' names number them from 1."""
    return [result.prepared.tree.bodies[i].name for i in result.prepared.tree.inertial]


def data_lines(result: Identification) -> list[str]:
    """What the data alone say."""
    prepared, base = result.prepared, result.prepared.base
    samples, singular = len(prepared.time), result.singular_values
    filtered = "the log's own derivatives" if prepared.cutoff is None else f"low-passed at {prepared.cutoff:.2g} Hz"
    lines = [
        f"{samples} samples at {prepared.rate:.4g} Hz, {filtered}; "
        f"{result.part.stop - result.part.start} fitted, {len(result.held_out.time)} held out.",
        f"Bodies: {', '.join(f'{k} is {name}' for k, name in enumerate(_bodies(result), start=1))}.",
        f"Structure: {base.rank} base parameters of {len(base.parameters)}; channels {', '.join(prepared.channels)}.",
        f"Excitation: condition number {result.condition_number:.1f} of the unit-norm columns, singular values "
        f"{singular[0]:.2g} to {singular[-1]:.2g}.",
    ]
    if result.weight is not None:
        weight = result.weight
        lines.append(
            f"Weight: {weight.measured:.2f} kg measured, {weight.model:.2f} kg in the model, "
            f"drift {weight.drift:+.2f} kg."
        )
    for name, check in result.frames.items():
        lines.append(f"Wrench '{name}' against the model's prediction: relative error {check.error:.2f}.")
    lines.append(f"Residuals: alike over {result.correlation.min():.2g} to {result.correlation.max():.2g} s.")
    if (axes := result.misalignment) is not None:
        chance = ", no more than by chance" if axes.chance > SIGNIFICANT else ""
        lines.append(f"Axes: tilted ones would explain {axes.explained:.0%} of the residuals{chance}.")
    more = separating_sensors(prepared.mechanism, prepared.sensors)
    for what, gained in more.items():
        if gained:
            lines.append(f"More would be seen {GAINS[what]}: {', '.join(gained)}.")
    return [*lines, *prepared.notes]


def full_parameters(result: Identification) -> ConsistentParameters:
    """The physical bodies that are as close to the model's as the estimate lets them be."""
    prepared = result.prepared
    return consistent_parameters(result.psi, result.covariance, prepared.base, prepared.prior)


def all_findings(result: Identification, full: ConsistentParameters) -> list[Finding]:
    """Findings on the fit and on the updated model."""
    return [*findings(result), *_masses(result, full), _consistency(full)]


def _consistency(full: ConsistentParameters) -> Finding:
    """What physical consistency has cost."""
    if not full.divergence.any():
        return Finding("The estimate does not contradict the model, whose bodies stay as they are.", False)
    listed = ", ".join(f"{name} by {shift:+.1f}" for name, shift in full.moved(0.1)[:5])
    moves = f"it moves {listed} standard deviations" if listed else "it moves none of them"
    if full.attainable:
        return Finding(f"The updated model has the base parameters within their joint 95 % region: {moves}.", False)
    return Finding(
        f"No physical bodies near the model's have these base parameters; of the updated model's, {moves}.",
        full.distance > FAR * float(np.sqrt(len(full.psi))),
    )


def _masses(result: Identification, full: ConsistentParameters) -> list[Finding]:
    """Bodies that end far from the model's mass, a doubt where the data cannot tell a mass from one so different."""
    told: dict[bool, list[str]] = {True: [], False: []}
    masses = zip(_bodies(result), full.phi[::10], full.mass_std, result.prepared.prior[::10], strict=True)
    for name, mass, std, before in masses:
        if max(mass, before) > SLIGHT * full.phi[::10].sum() and not before / FACTOR <= mass <= before * FACTOR:
            was = f"{before:.3g} kg" if before else "none"
            told[bool(2 * std < np.log(FACTOR) * mass)].append(f"{name} {mass:.3g} ± {std:.2g} kg (model: {was})")
    return [
        Finding(f"Masses beyond a factor of {FACTOR:g} of the model's, {how}: {', '.join(told[known])}.", not known)
        for known, how in ((True, "which the data show"), (False, "though the data hardly see them"))
        if told[known]
    ]


def text(result: Identification, full: ConsistentParameters) -> str:
    """What the terminal shows."""
    found = all_findings(result, full)
    return "\n".join(
        [
            "The recording",
            *(f"  {line}" for line in data_lines(result)),
            "",
            parameters_table(result).text(),
            quality_table(result, full).text(),
            f"Verdict: {verdict(result, found)}",
            *(finding.line for finding in found),
        ]
    )


def held_out_figure(result: Identification) -> Figure:
    """Measured and predicted channels on the held-out part."""
    held = result.held_out
    with figures.paper_style():
        figure, axes = _panels(result)
        for k, ax in enumerate(axes):
            ax.plot(held.time, held.measured[:, k], color="black", lw=1.2, label="Measured")
            ax.plot(held.time, held.measured[:, k] - held.residual[:, k], color="tab:blue", lw=0.8, label="Predicted")
            ax.set_ylabel(_label(result, k), labelpad=2)
            ax.margins(x=0)
        _finish(figure, axes, "Time (s)")
    return figure


def spectra_figure(result: Identification) -> Figure:
    """Spectra of the measured channels and of their residuals on the held-out part, as far as the filter lets."""
    held, prepared = result.held_out, result.prepared
    highest = prepared.rate / 2 if prepared.cutoff is None else min(3 * prepared.cutoff, prepared.rate / 2)
    with figures.paper_style():
        figure, axes = _panels(result)
        for k, ax in enumerate(axes):
            for x, color, label in ((held.measured, "black", "Measured"), (held.residual, "tab:red", "Residual")):
                frequency, power = amplitude_spectrum(x[:, k], prepared.rate)
                shown = (frequency > 0) & (frequency <= highest)
                ax.loglog(frequency[shown], np.maximum(power[shown], 1e-12), color=color, lw=0.8, label=label)
            ax.set_ylabel(_label(result, k, "/√Hz"), labelpad=2)
            ax.xaxis.set_minor_formatter(NullFormatter())
            ax.margins(x=0)
        _finish(figure, axes, "Frequency (Hz)")
    return figure


def _panels(result: Identification) -> tuple[Figure, list[Axes]]:
    """A figure with a panel for each channel, from top to bottom and then from left to right."""
    count = len(result.prepared.channels)
    rows = -(-count // 2)
    figure = Figure(figsize=(3.5, 0.7 + 0.9 * rows))
    grid = figure.subplots(rows, 2, sharex=True, squeeze=False)
    axes = list(grid.T.flat)
    for ax in axes[count:]:
        ax.set_axis_off()
    return figure, axes[:count]


def _finish(figure: Figure, axes: list[Axes], xlabel: str) -> None:
    rows = -(-len(axes) // 2)
    for ax in {axes[min(rows, len(axes)) - 1], axes[-1]}:
        ax.set_xlabel(xlabel, labelpad=2)
        ax.tick_params(labelbottom=True)
    figure.align_ylabels(axes)
    figure.legend(*axes[0].get_legend_handles_labels(), loc="outside upper center", ncols=2)


def parameters_figure(result: Identification) -> Figure:
    """Base parameters with 95 % intervals beside the model's own, each in units of its own size."""
    rank = result.prepared.base.rank
    value, std = result.psi, result.fit.std[:rank]
    prior = result.prepared.base.regroup(result.prepared.prior)
    size = np.maximum(np.maximum(np.abs(value), np.abs(prior)), INTERVAL * std)
    size = np.where(size > 0, size, 1)
    with figures.paper_style():
        figure = Figure(figsize=(3.5, 0.8 + 0.16 * rank))
        ax = figure.subplots()
        place = np.arange(rank)
        ax.axvline(0, color="0.8", lw=0.6)
        ax.errorbar(
            value / size,
            place,
            xerr=INTERVAL * std / size,
            fmt="o",
            ms=2.5,
            lw=0.8,
            color="tab:blue",
            label="Estimate, 95 %",
        )
        ax.plot(prior / size, place, "|", color="black", ms=7, label="Model")
        ax.set_yticks(place, [figures.parameter_symbol(name) for name in result.prepared.base.names])
        ax.invert_yaxis()
        ax.set_xlabel("Value, relative to the larger of estimate and model")
        figure.legend(*ax.get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure


def _label(result: Identification, k: int, per: str = "") -> str:
    """Symbol or joint of a channel, and its unit; `per` what the unit is divided by."""
    channel, tree = result.prepared.channels[k], result.prepared.tree
    if channel in COMPONENTS:
        return f"${channel[0]}_{channel[1]}$ ({'N' if channel[0] == 'F' else 'N m'}{per})"
    motion = np.hstack([body.motions for body in tree.bodies])[:, tree.freedoms.index(channel)]
    return f"{escape.label(channel)}\n({'N m' if motion[3:].any() else 'N'}{per})"


def estimate(result: Identification, full: ConsistentParameters, found: list[Finding]) -> dict[str, Any]:
    """Everything for scripts."""
    held, base = result.held_out, result.prepared.base
    return {
        "verdict": verdict(result, found),
        "findings": [{"text": finding.text, "doubt": finding.doubt} for finding in found],
        "columns": list(result.names),
        "values": result.fit.values.tolist(),
        "std": result.fit.std.tolist(),
        "covariance": result.fit.covariance.tolist(),
        "regrouping": dict(zip(base.names, base.expressions(12), strict=True)),
        "condition_number": result.condition_number,
        "cutoff_hz": result.prepared.cutoff,
        "held_out": {
            channel: {"residual_rms": float(r), "signal_std": float(s), "ratio": float(q)}
            for channel, r, s, q in zip(
                result.prepared.channels,
                np.sqrt((held.residual**2).mean(axis=0)),
                held.measured.std(axis=0),
                held.ratio,
                strict=True,
            )
        },
        "offsets": {channel: {"value": v, "std": s} for channel, (v, s) in result.offsets.items()},
        "bodies": {
            body: dict(zip(PARAMETERS, map(float, phi), strict=True))
            for body, phi in zip(_bodies(result), full.phi.reshape(-1, 10), strict=True)
        },
    }


def write(
    result: Identification,
    full: ConsistentParameters,
    folder: Path,
    model: Path,
    log: Path,
    provenance: dict[str, Any],
    formats: Iterable[str] = ("pdf", "png"),
) -> None:
    """Writes everything into a folder.

    Args:
        result: The identification.
        full: Its full parameters.
        folder: Where to.
        model: The model file that is updated.
        log: The log it was identified from.
        provenance: Where the results come from.
        formats: Formats of the figures; the page needs PNG.
    """
    found = all_findings(result, full)
    title = f"{model.name}, identified from {log.name}"
    tables = {
        "table_base_parameters": parameters_table(result),
        "table_held_out": quality_table(result, full),
        "table_full_parameters": full_table(result, full),
    }
    for name, table in tables.items():
        table.write(folder, name)
    drawn = {
        "figure_held_out": (held_out_figure(result), "Measured and predicted channels on the held-out part."),
        "figure_parameters": (parameters_figure(result), "Base parameters with 95 % intervals, and the model's own."),
        "figure_spectra": (spectra_figure(result), "Amplitude spectra of the channels and of their residuals."),
    }
    for name, (figure, _) in drawn.items():
        figures.save(figure, folder, name, formats)
    report.write_json(folder / "estimate.json", estimate(result, full, found))
    report.write_json(folder / "provenance.json", provenance)
    write_model(folder / f"model.{'urdf' if parsed(model).tag == 'robot' else 'xml'}", result.prepared.mechanism, full)
    parts = [
        f"<h1>{html.escape(title)}</h1>",
        f"<p><strong>{page.prose(verdict(result, found))}</strong></p>",
        "<ul>" + "".join(f"<li>{page.prose(finding.text)}</li>" for finding in found) + "</ul>",
        "<h2>The recording</h2>",
        "<ul>" + "".join(f"<li>{page.prose(line)}</li>" for line in data_lines(result)) + "</ul>",
        "<h2>The estimate</h2>",
        *(page.table(folder / f"{name}.csv", table.title, root=folder) for name, table in tables.items()),
        *(page.figure(folder / f"{name}.png", caption, root=folder) for name, (_, caption) in drawn.items()),
        "<h2>Provenance</h2>",
        f"<pre>{html.escape(json.dumps(provenance, indent=1, ensure_ascii=False))}</pre>",
    ]
    (folder / "report.html").write_text(page.document(title, parts), encoding="utf-8")
