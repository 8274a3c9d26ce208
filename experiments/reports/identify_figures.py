"""Figures of an identification, and its replay on a page."""

from collections.abc import Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from matplotlib.ticker import NullFormatter

from experiments.document import figures, styles, symbols
from experiments.document.replay import Replay, every_nth
from experiments.document.symbols import in_words, regrouped_in_words
from ident.display.plots import amplitude_spectrum
from ident.estimate import Estimate
from ident.estimation.equations import COMPONENTS
from ident.estimation.units import channel_unit, unit_of
from ident.geometry.inertia import body_index
from ident.judgement.finding import Finding
from ident.parameters.prior import KNOWN, parameters_identified
from ident.tolerances import INTERVAL

LEFT_OUT = " None are drawn where samples were left out."


def replay(result: Estimate) -> Replay:
    """Replay of an estimate's first recording, with the predictions of the estimate and of its rivals."""
    log, part = result.prepared, result.part
    arm, samples, time = log.mechanism, log.samples, log.recording.time
    fits = {
        "predicted": result.fit,
        "with the model's own bodies": result.fit.with_psi(result.fit.equations.from_model[: result.base.rank]),
        "with the updated model's": result.fit.with_psi(result.psi_updated),
    }
    drawn = every_nth(len(time), len(result.channels) * (1 + len(fits)))
    motion = samples.motion[drawn]
    used = np.isin(drawn, log.taken(slice(None)))[:, None]
    predicted = {name: np.where(used, fit.predicted(motion), np.nan) for name, fit in fits.items()}
    included = result.trajectory is not None and bool(result.trajectory.known)
    known = {**KNOWN, **log.recording.known}
    spans = [(time[part.stop], time[-1])] if part.stop < len(time) - log.edge else []
    return Replay(
        mechanism=arm,
        recording=log.recording,
        motion=samples.motion,
        channels=[(channel, channel_unit(channel, arm.tree)) for channel in result.channels],
        drawn=drawn,
        curves={"measured": samples.measured[drawn]} | predicted,
        estimate=result.consistent().phi,
        identified=parameters_identified(arm, result.base, result.covariance, known, included=included),
        spans=spans,
        shaded="held out, not fitted" if spans else "",
        remark="All predictions use the estimated set-up." + LEFT_OUT * (not used.all()),
        parameters=[_parameter(result, k) for k in range(len(result.fit.names))],
        findings=[place(finding, result) for finding in result.findings],
    )


def _parameter(result: Estimate, k: int) -> dict[str, Any]:
    """Text shown for a pressed coefficient: its meaning, value and interval."""
    name, arm, base = result.fit.names[k], result.prepared.mechanism, result.base
    value, std = float(result.fit.values[k]), float(np.sqrt(result.covariance_setup[k, k]))
    own = unit_of(name) or ""
    text = regrouped_in_words(base, k, arm) if k < base.rank else in_words(name, arm)
    text = f"{text[0].upper()}{text[1:]}. Estimate {value:.4g} {own}".rstrip()
    text += f", 95 % interval {value - INTERVAL * std:.4g} to {value + INTERVAL * std:.4g}"
    if k < base.rank:
        text += f"; the model as it came has {float(result.fit.equations.from_model[k]):.4g}"
    body = body_index(name) if k < base.rank else None
    return {
        "name": name,
        "value": value,
        "std": std,
        "text": f"{text}.",
        "body": None if body is None else arm.tree.inertial[body],
    }


def place(finding: Finding, result: Estimate) -> dict[str, Any]:
    """Text and places shown for a pressed finding: body, channels and span of time in the first log, if any."""
    log, at = result.logs[0].log, finding.place
    tree, sensors = log.mechanism.tree, log.recording.sensors
    moved = {body.joint: name for body, name in zip(tree.bodies, tree.names, strict=True) if body.joint}
    touched = [sensors[name].body for name in at.wrenches if name in sensors]
    bodies = [name for name in (*at.bodies, *(moved.get(joint) for joint in at.joints), *touched) if name in tree.names]
    span = at.span if at.log == 0 else None
    kinds = {"body": at.bodies, "joint": at.joints, "wrench": at.wrenches, "channel": at.channels}
    about = [_listed(kind, names) for kind, names in kinds.items() if any(names)]
    about += [f"{at.span[0]:.2f} s to {at.span[1]:.2f} s" + f" of log {at.log + 1}" * (at.log > 0)] if at.span else []
    return {
        "where": f"The finding is about {'; '.join(about)}." if about else "",
        "body": tree.names.index(bodies[0]) if bodies else None,
        "channels": [channel for channel in at.channels if channel in result.channels],
        "span": list(span) if span else None,
    }


def _listed(kind: str, names: Sequence[str]) -> str:
    """Names after their kind, in the singular or plural."""
    several = {"body": "bodies", "wrench": "wrenches"}.get(kind, f"{kind}s")
    return f"{kind if len(names) == 1 else several} {', '.join(names)}"


MEASURED, ESTIMATED = figures.INKS[:2]
"""Colours of measurements and of estimates, as on the page."""

COLUMN_PANELS = 16
"""Largest number of channels in a figure of one column; more take the width of the page."""

UNCERTAIN: dict[str, Any] = {"color": "0.8", "lw": 0, "zorder": 0, "label": "Low velocity, not judged"}
"""Style of spans in which joints are so slow that friction makes their torques indeterminate."""


def held_out_figure(result: Estimate) -> Figure:
    """Measured and predicted channels on the held-out part."""
    held = result.held_out
    measured = held.samples.measured
    time, measured, predicted = map(held.interrupted, (held.time, measured, measured - held.residual))
    slow = held.interrupted(~held.moving, by=False)
    with styles.paper_style():
        figure, axes = _panels(result)
        for k, ax in enumerate(axes):
            ax.plot(time, measured[:, k], color=MEASURED, lw=1.2, label="Measured")
            ax.plot(time, predicted[:, k], color=ESTIMATED, ls="--", lw=0.8, label="Predicted")
            if slow[:, k].any():
                spans = figures.visible_spans(figures.spans(time, slow[:, k]), float(np.ptp(held.time)))
                # Lines of the grid would look like the shortest spans.
                ax.grid(visible=False, axis="x")
                bars = np.stack([spans[:, 0], np.diff(spans)[:, 0]], axis=1)
                ax.broken_barh(bars.tolist(), (0, 1), transform=ax.get_xaxis_transform(), **UNCERTAIN)
            ax.set_ylabel(_label(result, k), labelpad=2)
            figures.few_ticks(ax)
            ax.set_xlim(held.time[0], held.time[-1])
        _finish(figure, axes, "Time (s)", [Patch(**UNCERTAIN)] if slow.any() else [])
    return figure


def held_out_caption(result: Estimate) -> str:
    """Caption of the held-out figure."""
    caption = f"Measured and predicted channels on the {result.held_out.part} part."
    if not result.held_out.moving.all():
        caption += " Grey: joints so slow that friction makes their torques uncertain; not judged."
    if result.trajectory:
        step = min(result.trajectory.steps)
        caption += f" The splines of the fitted motion have a knot every {1e3 * step:.3g} ms throughout."
    return caption


def parameters_figure(result: Estimate) -> Figure:
    """Base parameters with 95 % intervals including the set-up, beside the model's, each over the largest of these."""
    arm, shown = result.prepared.mechanism, _shown(result)
    value, std = result.psi[shown], result.std_setup[shown]
    prior = result.fit.equations.from_model[shown]
    size = np.maximum(np.maximum(np.abs(value), np.abs(prior)), INTERVAL * std)
    size = np.where(size > 0, size, 1)
    names = [symbols.named_symbol(result.base.names[k], arm.bodies) for k in shown]
    with styles.paper_style():
        figure, panels = styles.row_panels(names, "Value over the largest of estimate, model and half-width")
        for ax, rows in panels:
            ax.axvline(0, color="0.8", lw=0.6)
            half, own = INTERVAL * (std / size)[rows], (value / size)[rows]
            style: dict[str, Any] = {"fmt": "o", "ms": 2.5, "lw": 0.8, "color": ESTIMATED}
            ax.errorbar(own, rows, xerr=half, label="Estimate, 95 % with set-up", **style)
            ax.plot((prior / size)[rows], rows, "|", color=MEASURED, ms=7, label="Model")
        figure.legend(*panels[0][0].get_legend_handles_labels(), loc="outside upper center", ncols=2)
    return figure


def parameters_caption(result: Estimate) -> str:
    """Caption of the figure of parameters."""
    caption = "Base parameters with 95 % intervals that include the uncertainty of the set-up, and the model's values."
    shown, rank = len(_shown(result)), result.base.rank
    some = f" Shown are the {shown} of {rank} with the narrowest relative intervals; the table has all."
    return caption + some * (shown < rank)


def _shown(result: Estimate) -> list[int]:
    """Indices of the base parameters; if too many for a page, of those with the narrowest relative intervals."""
    prior = result.fit.equations.from_model[: result.base.rank]
    relative = result.std_setup / np.maximum(np.maximum(np.abs(result.psi), np.abs(prior)), 1e-300)
    narrowest = sorted(range(result.base.rank), key=relative.__getitem__)
    return sorted(narrowest[: styles.most_rows()])


def spectra_figure(result: Estimate) -> Figure:
    """Spectra of the measured channels and of their residuals on the held-out part, up to three times the cut-off."""
    held, prepared = result.held_out, result.prepared
    highest = (
        prepared.recording.rate / 2
        if prepared.cutoff is None
        else min(3 * prepared.cutoff, prepared.recording.rate / 2)
    )
    with styles.paper_style():
        figure, axes = _panels(result)
        for k, ax in enumerate(axes):
            # Where nothing is explained the residual is what is measured, which shows on both sides.
            for x, color, width, label in (
                (held.samples.measured, MEASURED, 1.6, "Measured"),
                (held.residual, ESTIMATED, 0.6, "Residual"),
            ):
                frequency, amplitude = amplitude_spectrum(x[:, k], prepared.recording.rate)
                shown = (frequency > 0) & (frequency <= highest)
                ax.loglog(frequency[shown], np.maximum(amplitude[shown], 1e-12), color=color, lw=width, label=label)
            ax.set_ylabel(_label(result, k, "/√Hz"), labelpad=2)
            figures.few_decades(ax.xaxis)
            figures.few_decades(ax.yaxis)
            ax.xaxis.set_minor_formatter(NullFormatter())
            ax.margins(x=0)
        figures.join_minor_ticks(axes)
        _finish(figure, axes, "Frequency (Hz)")
    return figure


def _panels(result: Estimate) -> tuple[Figure, list[Axes]]:
    """A figure with a panel for each channel, from top to bottom and then from left to right."""
    count = len(result.channels)
    columns, width = (2, styles.column_width()) if count <= COLUMN_PANELS else (4, styles.text_width())
    rows = -(-count // columns)
    figure = Figure(figsize=(width, min(0.7 + 0.9 * rows, styles.text_height())))
    grid = figure.subplots(rows, columns, sharex=True, squeeze=False)
    axes = list(grid.T.flat)
    for ax in axes[count:]:
        ax.set_axis_off()
    return figure, axes[:count]


def _finish(figure: Figure, axes: list[Axes], xlabel: str, extra: Sequence[Patch] = ()) -> None:
    """Labels the axes and adds the legend, with patches after the first panel's own entries."""
    places = [(ax, ax.get_subplotspec()) for ax in axes]
    lowest = {place.colspan.start: ax for ax, place in places if place is not None}
    for ax in lowest.values():
        ax.set_xlabel(xlabel, labelpad=2)
        ax.tick_params(labelbottom=True)
    figures.align_ylabels(axes)
    # Spans have one entry, whichever panels they are in.
    lines = [line for line in axes[0].lines if not str(line.get_label()).startswith("_")]
    figure.legend(handles=[*lines, *extra], loc="outside upper center", ncols=2)


def _label(result: Estimate, k: int, per: str = "") -> str:
    """Symbol or joint of a channel, and its unit, divided by `per`."""
    channel = result.channels[k]
    shown = f"${channel[0]}_{channel[1]}$ " if channel in COMPONENTS else f"{symbols.label(channel)}\n"
    return f"{shown}({channel_unit(channel, result.prepared.mechanism.tree)}{per})"
