"""Views of an identification: its screen of text, pictures, figures with their captions, and a replay."""

from collections.abc import Iterator, Sequence
from textwrap import shorten
from typing import Any

import numpy as np

from experiments.document import pictures, tabular, typography
from experiments.document.figures import SHEET, paper_style
from experiments.document.pictures import Interval
from experiments.document.replay import Replay, every_nth
from experiments.document.typography import sentences, wrapped
from experiments.document.writer import Card, Document, Headline
from ident.display import plots
from ident.display.plots import Figure
from ident.estimate import Estimate
from ident.estimation.equations import COMPONENTS
from ident.estimation.noise import channel_unit, unit_of
from ident.geometry.inertia import body_index
from ident.judgement.finding import Finding, line_of
from ident.judgement.fit_findings import about_best
from ident.judgement.wording import listed, number_of
from ident.parameters.prior import KNOWN, parameters_identified
from ident.regression.held_out import ESTIMATE
from ident.tolerances import DRIVE, INTERVAL

FIRST = 5
"""Largest number of findings on a screen of 24 lines."""


def screen(made: Document, result: Estimate) -> str:
    """Text for the terminal on 24 lines: verdict, channels by candidate, and the first findings; the page has all."""
    more = number_of(len(made.findings) - FIRST, "more finding") + " and " if len(made.findings) > FIRST else ""
    lines = [Headline.of(result.verdict()).line, "", _ratios(result, 11), *first_lines(made.findings)]
    return "\n".join([*lines, f"--verbose prints {more}notes; the page has all numbers."])


def first_lines(cards: Sequence[Card]) -> list[str]:
    """First sentences of the first findings, a line each."""
    return [_remark(card.text, 112, card.doubt) for card in cards[:FIRST]]


def verbose(made: Document, result: Estimate) -> str:
    """Longer text for the terminal: verdict, doubts, the main remarks and numbers; page and tables have the rest."""
    # With so many remarks, and channels or bodies, an arm takes 40 lines, four legs of twelve joints 50.
    most, channels = 8, 12
    doubts, remarks = ([each for each in result.findings if each.doubt is kind] for kind in (True, False))
    notes = result.prepared.notes
    hidden = {"more remark": len(remarks) - most, "more note": len(notes) - most}
    left = [number_of(count, what) for what, count in hidden.items() if count > 0]
    tables = ", ".join(f"{name}.md ({len(table.rows)} rows)" for name, table in made.tables.items())
    lines = [
        f"Verdict: {made.verdict}",
        *(each.line for each in doubts),
        *(_remark(each.text) for each in remarks[:most]),
        "",
        *made.lines[:3],
        *(_remark(note) for note in notes[:most]),
        "",
        _ratios(result, channels),
        *_bodies(result, channels),
        f"The page has {', '.join([*left, 'all details'])}.",
        f"Tables, also as .csv and .tex: {tables}.",
    ]
    return wrapped("\n".join(lines))


def _remark(text: str, most: int = 225, doubt: bool = False) -> str:
    """First sentence of a finding, in at most so many letters."""
    return line_of(shorten(sentences(text)[0], most, placeholder=" …"), doubt)


def _ratios(result: Estimate, most: int) -> str:
    """Table of the residuals over the signal by candidate, of the worst channels if there are more than so many."""
    held, channels, idle = result.held_out, result.channels, result.verdict().idle
    every = {ESTIMATE: held.ratio, **result.rivals}
    shown = np.sort(np.argsort(-held.ratio, kind="stable")[:most])
    alike = about_best(np.array([ratio[shown] for ratio in every.values()])).T
    names = [channels[k] for k in shown]
    cut = [name if len(name) <= 30 else f"{name[:29]}…" for name in names]
    columns = {"channel": cut} | {name: ratio[shown] for name, ratio in every.items()}
    columns["best"] = [
        "not counted" if name in idle else listed(each for each, best in zip(every, own, strict=True) if best)
        for name, own in zip(names, alike, strict=True)
    ]
    of = f", the {most} worst of {len(channels)} channels" if len(channels) > most else ""
    return tabular.Table(f"Residual of the {held.part} part over its signal{of}", *tabular.columns(**columns)).text()


def _bodies(result: Estimate, most: int) -> list[str]:
    """Table of masses and centres of mass with intervals, or a sentence if there are more bodies."""
    full = result.consistent()
    if len(full.bodies) > most:
        masses = [f"{each.body} {each.words} kg" for each in full.rows[::10] if each.determined]
        known = f": {', '.join(masses)}" if masses else ""
        return [f"The data determine {len(masses)} of {len(full.bodies)} masses{known}."]
    return ["Bodies of the updated model, with 95 % intervals (-: not determined)", str(full), ""]


LEFT_OUT = " None are drawn where samples were left out."


def first_screen(result: Estimate) -> Iterator[str]:
    """Yields the pictures of the first screen: channels by candidate, parameters by body, worst and best channel."""
    channels, worst = prediction(result)
    precision = result.verdict().precision
    yield channels
    yield pictures.parameters(_intervals(result), () if precision is None else precision.known, result.base.rank)
    yield worst


def prediction(result: Estimate) -> Iterator[str]:
    """Yields pictures of the prediction: of all channels by candidate, and of the worst and the best channel."""
    held, verdict = result.held_out, result.verdict()
    yield pictures.candidates(result.channels, {ESTIMATE: held.ratio, **result.rivals}, verdict.idle)
    ranked = sorted(verdict.counted or verdict.ratios, key=verdict.ratios.__getitem__)
    time, measured, predicted = held.curves
    panels = {}
    for word, channel in dict(worst=ranked[-1], best=ranked[0]).items():
        k, unit = result.channels.index(channel), channel_unit(channel, result.prepared.mechanism.tree)
        title = f"{word}: {channel.replace('_', ' ')}, {verdict.ratios[channel]:.2g} of the signal ({unit})"
        panels[title] = measured[:, k], predicted[:, k]
    yield pictures.curves(time, panels)


def _intervals(result: Estimate) -> dict[str, list[Interval]]:
    """Base parameters and drives by body; a drive belongs to the body that its joint moves."""
    arm, fit, rank = result.prepared.mechanism, result.fit, result.base.rank
    std, model, carriers = np.sqrt(np.diag(result.covariance_setup)), fit.equations.from_model, arm.tree.carriers
    bodies: dict[str, list[Interval]] = {name: [] for name in arm.bodies}
    drives = [kind for kind in DRIVE.values() if any(name.startswith(f"{kind}(") for name in fit.names)]
    for k, name in enumerate(fit.names):
        kind, _, freedom = name.removesuffix(")").partition("(")
        body = arm.bodies[result.base.kept[k] // 10] if k < rank else carriers.get(freedom) if kind in drives else None
        if body is not None and name not in result.undetermined:
            column = int(result.base.kept[k] % 10) if k < rank else 10 + drives.index(kind)
            stated = None if k >= len(model) or (k >= rank and not model[k]) else float(model[k])
            each = Interval(name, column, float(fit.values[k]), INTERVAL * float(std[k]), float(std[k]), stated)
            bodies.setdefault(body, []).append(each)
    return {name: each for name, each in bodies.items() if each}


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
    text, body, model = typography.in_words(name, arm), None, ""
    if k < base.rank:
        text = typography.regrouped_in_words(base, k, arm)
        model = f"; the model as it came has {float(result.fit.equations.from_model[k]):.4g}"
        body = arm.tree.inertial[body_index(name) or 0]
    text = f"{text[0].upper()}{text[1:]}. Estimate {value:.4g} {unit_of(name) or ''}".rstrip()
    text += f", 95 % interval {value - INTERVAL * std:.4g} to {value + INTERVAL * std:.4g}{model}."
    return {"name": name, "value": value, "std": std, "text": text, "body": body}


def place(finding: Finding, result: Estimate) -> dict[str, Any]:
    """Text and places shown for a pressed finding: body, channels and span of time in the first log, if any."""
    log, at = result.logs[0].log, finding.place
    tree, sensors = log.mechanism.tree, log.recording.sensors
    moved = {body.joint: name for body, name in zip(tree.bodies, tree.names, strict=True) if body.joint}
    touched = [sensors[name].body for name in at.wrenches if name in sensors]
    bodies = [name for name in (*at.bodies, *(moved.get(joint) for joint in at.joints), *touched) if name in tree.names]
    span = at.span if at.log == 0 else None
    kinds = {("body", "bodies"): at.bodies, ("joint", "joints"): at.joints}
    kinds |= {("wrench", "wrenches"): at.wrenches, ("channel", "channels"): at.channels}
    about = [f"{kind[len(names) > 1]} {', '.join(names)}" for kind, names in kinds.items() if any(names)]
    about += [f"{at.span[0]:.2f} s to {at.span[1]:.2f} s" + f" of log {at.log + 1}" * (at.log > 0)] if at.span else []
    return {
        "where": f"The finding is about {'; '.join(about)}." if about else "",
        "body": tree.names.index(bodies[0]) if bodies else None,
        "channels": [channel for channel in at.channels if channel in result.channels],
        "span": list(span) if span else None,
    }


def held_out_figure(result: Estimate) -> Figure:
    """Measured and predicted channels on the held-out part."""
    held = result.held_out
    with paper_style():
        slow = held.interrupted(~held.moving, by=False)
        return plots.fit_figure(SHEET, _labels(result), held.curves, slow)


def parameters_figure(result: Estimate) -> Figure:
    """Base parameters with 95 % intervals including the set-up, beside the model's, each over the largest of these."""
    bodies, model = result.prepared.mechanism.bodies, result.fit.equations.from_model[: result.base.rank]
    names = [typography.named_symbol(name, bodies) for name in result.base.names]
    with paper_style():
        return plots.parameters_figure(SHEET, names, result.psi, INTERVAL * result.std_setup, model)


def spectra_figure(result: Estimate) -> Figure:
    """Spectra of the measured channels and of their residuals on the held-out part, up to three times the cut-off."""
    held, cutoff, rate = result.held_out, result.prepared.cutoff, result.prepared.recording.rate
    highest = np.inf if cutoff is None else 3 * cutoff
    with paper_style():
        pair = (held.samples.measured, held.residual)
        return plots.spectra_figure(SHEET, _labels(result, "/√Hz"), rate, pair, highest)


def _labels(result: Estimate, per: str = "") -> list[str]:
    """Symbols or joints of the channels, and their units, divided by `per`."""
    units = {name: channel_unit(name, result.prepared.mechanism.tree) for name in result.channels}
    shown = {name: f"${name[0]}_{name[1]}$" if name in COMPONENTS else typography.label(name) for name in units}
    return [f"{shown[name]} ({unit}{per})" for name, unit in units.items()]


def held_out_caption(result: Estimate) -> str:
    """Caption of the held-out figure."""
    caption = f"Measured and predicted channels on the {result.held_out.part} part."
    if not result.held_out.moving.all():
        caption += " Grey: joints so slow that friction makes their torques uncertain; not judged."
    if result.trajectory:
        step = min(result.trajectory.steps)
        caption += f" The splines of the fitted motion have a knot every {1e3 * step:.3g} ms throughout."
    return caption


def parameters_caption(result: Estimate) -> str:
    """Caption of the figure of parameters."""
    caption = "Base parameters with 95 % intervals that include the uncertainty of the set-up, and the model's values."
    shown, rank = min(SHEET.most_rows, result.base.rank), result.base.rank
    some = f" Shown are the {shown} of {rank} with the narrowest relative intervals; the table has all."
    return caption + some * (shown < rank)
