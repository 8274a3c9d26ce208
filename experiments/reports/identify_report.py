"""Report on an identification: tables, figures, a page, numbers for scripts, and the updated model."""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from experiments.document import tabular, writer
from experiments.document.replay import RERUN
from experiments.document.result_folder import OUTPUTS as RESULTS
from experiments.document.tabular import of_deviations, of_small
from experiments.document.writer import Card, Document, Headline, Plot
from experiments.reports import identify_page as page
from experiments.studies.user_files import Following
from ident.estimate import Estimate
from ident.estimation.noise import channel_unit, coefficient_unit
from ident.files.readers import name_of
from ident.geometry.inertia import with_bodies
from ident.judgement.verdict import IDLE
from ident.judgement.wording import number_of
from ident.mechanism.mechanism import Mechanism
from ident.model.axes import column_place
from ident.parameters.base_parameters import separating_sensors
from ident.recordings.stated import Servo
from ident.tolerances import DRIVE, NAMED, ROUNDING
from sim.models.model_mechanism import Origin
from sim.models.model_update import write_model
from sim.models.opensim_model import OpenSimOrigin
from sim.models.xml_files import parsed

SPECTRA = "Amplitude spectra of the channels and of their residuals."
"""Caption."""

OUTPUTS = (*RESULTS, "estimate.json", "model.xml", "model.urdf", "model.osim", RERUN)
"""Patterns of the files that it writes."""


def parameters_table(result: Estimate) -> tabular.Table:
    """Base parameters with their uncertainty beside the model's own."""
    base, fit, log = result.base, result.fit, result.prepared
    others = [None] * (len(fit.names) - base.rank)
    wider = np.sqrt(np.diag(result.covariance_setup))
    model = [x if abs(x) > ROUNDING * std else 0.0 for x, std in zip(fit.equations.from_model, fit.std, strict=False)]
    priors: list[float | None] = [*model[: base.rank], *(x or None for x in model[base.rank :])]
    priors += [None] * (len(fit.names) - len(priors))
    lagging, footnote = _of_servos(result)
    # Relative deviations are shown of values that are clearly not zero.
    far = abs(fit.values) > 3 * wider
    columns = {
        "parameter": fit.names,
        "estimate": fit.values.tolist(),
        "std": fit.std.tolist(),
        "std_setup": wider.tolist(),
        "relative": np.divide(100 * wider, abs(fit.values), where=far, out=np.full(len(wider), np.nan)),
        "model": priors,
        "regrouping": [*base.expressions(digits=4), *("" for _ in others)],
    }
    if result.trajectory is not None and result.trajectory.known:
        columns |= {"moved_from_model_std": [*result.moved_from_prior.tolist(), *others]}
    table = tabular.Table(
        "Base parameters, SI units",
        *tabular.columns(**columns),
        caption="Identified base parameters beside the model's own",
        notes=(
            "S.d.: of noise alone; s.d. setup: with the uncertainty of the set-up.",
            "Relative: s.d. setup over the estimate, empty where the estimate is not far from zero.",
        ),
        deviations={"estimate": "std_setup"},
        heads={"relative": "relative (%)"},
        digits={"std": of_deviations(fit.std), "model": of_small(priors, wider), "relative": [1] * len(wider)},
        marked=lagging,
        footnote=footnote,
        regrouped={"": base.expressions(digits=4)},
        bodies=log.mechanism.bodies,
        units=tuple(coefficient_unit(name, log.mechanism.tree) for name in fit.names),
        carriers=log.mechanism.tree.carriers,
    )
    return table.without(result.undetermined, result.undetermined_sentence)


def _of_servos(result: Estimate) -> tuple[frozenset[str], str]:
    """Names of the viscous friction of commanded joints, and a note on it; both empty without commands."""
    viscous = {f"{DRIVE['viscous']}({joint})" for joint in result.prepared.recording.servos}
    names, setup = frozenset(viscous.intersection(result.fit.equations.drives)), result.trajectory
    has_lag = setup is not None and any(each.kind == "lag" for each in setup.setup.values())
    means = "only the s.d. setup includes it" if has_lag else "no s.d. here includes it"
    note = f"Viscous friction of a commanded joint is the lag of its servo, ΔFv = kp Δlag: {means}."
    return names, note if names else ""


def quality_table(result: Estimate) -> tabular.Table:
    """Prediction errors of each channel on the held-out part, where joints that rub move, and where they rest."""
    held, tree, nan = result.held_out, result.prepared.mechanism.tree, np.full(len(result.channels), np.nan)
    rivals = [held.rivals.get(name) for name in ("model", "least squares")]
    own, *others = (nan if x is None else held.ratio_at_rest(x) for x in (held.residual, *rivals))
    columns = {
        "signal_std": (held.signal, held.signal),
        "residual_rms": (held.rms, own * held.signal),
        "ratio": (held.ratio, own),
        "relative_rms": (held.relative_rms, nan),
        "ratio_model_as_it_came": (nan if rivals[0] is None else held.ratio_of(rivals[0]), others[0]),
        "ratio_least_squares": (nan if rivals[1] is None else held.ratio_of(rivals[1]), others[1]),
        "ratio_updated_model": (held.ratio_with(result.psi_updated), nan),
        "correlation_s": (result.correlation, nan),
    }
    notes = dict.fromkeys(result.unexplained, "not explained by this motion")
    notes |= {channel: f"not counted: {IDLE[why]}" for channel, why in result.verdict().idle.items()}
    rows, units = list[tuple[tabular.Cell, ...]](), list[str]()
    for k, channel in enumerate(result.channels):
        moving, resting = zip(*((float(a[k]), float(b[k])) for a, b in columns.values()), strict=True)
        rows.append((channel, *moving, notes.get(channel, "")))
        if np.isfinite(own[k]):
            rows.append((f"{channel}, at rest", *resting, "not judged: friction is anything up to breakaway"))
        units += [channel_unit(channel, tree)] * (len(rows) - len(units))
    heads = {"ratio_model_as_it_came": "ratio, model as it came", "ratio_least_squares": "ratio, least squares"}
    title, names, more = f"Prediction of the {held.part} part", ("channel", *columns, "note"), ""
    if lacking := not_held(updated_file(result.prepared.mechanism), result):
        heads["ratio_updated_model"] = "ratio, updated model*"
        more = f"With all drives beside its bodies. {lacking[0]}"
    return tabular.Table(title, names, rows, units=tuple(units), heads=heads, footnote=more)


def full_table(result: Estimate) -> tabular.Table:
    """Physically consistent bodies with their intervals beside the model's."""
    rows, finite = result.consistent().rows, np.isfinite
    decimals, whole = tuple(each.decimals for each in rows), (0,) * len(rows)
    return tabular.Table(
        "Full, physically consistent parameters, SI units",
        *tabular.columns(
            body=[each.body for each in rows],
            quantity=[each.quantity for each in rows],
            unit=[each.unit for each in rows],
            estimate=[each.estimate for each in rows],
            lower=[each.lower if finite(each.lower) and each.limits else None for each in rows],
            upper=[each.upper if finite(each.upper) else None for each in rows],
            from_data_percent=[100 * each.share for each in rows],
            model=[each.model for each in rows],
            note=["as stated" if each.stated else "" if each.determined else "not determined" for each in rows],
        ),
        digits={**dict.fromkeys(("estimate", "lower", "upper", "model"), decimals), "from_data_percent": whole},
        heads={"lower": "95 % from", "upper": "to", "from_data_percent": "from data (%)"},
        caption="Physically consistent bodies, 95 % intervals, inertia about the origin of the body's frame",
        notes=(
            "Intervals include all physical bodies that the estimate allows.",
            "From data: 1 less the variance over that of a model's word. Not determined: less than half.",
        ),
    )


def data_lines(result: Estimate) -> list[str]:
    """Lines on the data: samples, structure, excitation and checks."""
    log = result.prepared
    gained = separating_sensors(log.mechanism, log.sensors)
    more = {"values": result.determined_values, "separating": gained, "with_bodies": with_bodies, "most": NAMED}
    return writer.sentences("identify_data.txt", result=result, log=log, **more)


def document(
    result: Estimate,
    model: Path | None,
    logs: Sequence[Path],
    provenance: dict[str, Any],
    following: Following | None = None,
    *,
    geometry: bool = False,
) -> Document:
    """Tables, figures, numbers and a replay of an identification, and the updated model file.

    Args:
        result: The identification.
        model: The model's file, None for one without.
        logs: The identified logs, none for recordings without files.
        provenance: Provenance of the results.
        following: Errors of models that are simulated with the recorded commands, if there are any.
        geometry: True to displace joints of the updated model, too.
    """
    updated, bodies = updated_file(result.prepared.mechanism), result.prepared.mechanism.bodies
    recordings = ", ".join(map(name_of, logs)) or number_of(len(result.logs), "recording")
    made = Document(
        f"{model.name if model else 'A mechanism'}, identified from {recordings}",
        headline=Headline.of(result.verdict()),
        verdict=str(result.verdict()),
        pictures=[*page.first_screen(result)],
        findings=[*map(Card.of, result.findings)],
        lines=[*data_lines(result), *not_held(updated, result), *following_lines(following)],
        heading="The recording",
        folded={"Bodies by number": [", ".join(f"{k} is {name}" for k, name in enumerate(bodies, 1))]},
        tables={
            "table_base_parameters": parameters_table(result),
            "table_held_out": quality_table(result),
            "table_full_parameters": full_table(result),
            **({"table_scales": scales_table(result)} if result.scales else {}),
            **({} if following is None else {"table_following": following_table(following)}),
        },
        figures={
            "figure_held_out": Plot(partial(page.held_out_figure, result), page.held_out_caption(result)),
            "figure_spectra": Plot(partial(page.spectra_figure, result), SPECTRA),
            "figure_parameters": Plot(partial(page.parameters_figure, result), page.parameters_caption(result)),
        },
        numbers={"estimate": result.to_dict(), "provenance": provenance},
        replay=page.replay(result),
        files={updated: partial(_write_updated, result, geometry)} if updated else {},
    )
    return replace(made, screen=page.screen(made, result), verbose=page.verbose(made, result))


def scales_table(result: Estimate) -> tabular.Table:
    """Estimated scales of joint torques, and the gains of servos that follow."""
    none, stated = Servo(np.nan, np.nan), result.prepared.recording.servos
    scale, std = zip(*result.scales.values(), strict=True)
    return tabular.Table(
        "Scales of joint torques, true over stated",
        *tabular.columns(
            joint=tuple(result.scales),
            scale=scale,
            std=std,
            kp_stated=[stated.get(joint, none).kp for joint in result.scales],
            kp=[result.servos.get(joint, none).kp for joint in result.scales],
            kv=[result.servos.get(joint, none).kv for joint in result.scales],
        ),
        deviations={"scale": "std"},
        caption="Estimated scales of joint torques, with the gains of servos in SI units",
        notes=("Standard deviations of kp and kv are as large, relative to them, as that of the scale.",),
    )


def following_table(following: Following) -> tabular.Table:
    """Errors of simulated coordinates of the model as it came and of the updated one."""
    before, after, ratio = (x.tolist() for x in (following.before, following.after, following.ratio))
    return tabular.Table(
        "Coordinates simulated with the recorded commands, RMS error",
        *tabular.columns(joint=following.joints, model_as_it_came=before, updated_model=after, ratio=ratio),
        units=following.units,
    )


def following_lines(following: Following | None) -> list[str]:
    """Sentence on how well the updated model follows recorded coordinates, if it was simulated."""
    if following is None:
        return []
    diverges = {"before": np.isnan(following.before).any(), "after": np.isnan(following.after).any()}
    median = np.median(following.ratio)
    return writer.sentences("identify_following.txt", made=following, diverges=diverges, median=median)


def _write_updated(result: Estimate, geometry: bool, path: Path) -> None:
    """Writes the model with the physical bodies and the drives of an estimate, and perhaps with displaced joints."""
    displaced = result.displaced if geometry else {}
    write_model(path, result.prepared.mechanism, result.consistent(), result.drives_updated, displaced)


def updated_file(mechanism: Mechanism) -> str | None:
    """Name of the file of a mechanism's updated model; None for a mechanism that came compiled or without a model."""
    source = mechanism.source
    if isinstance(source, OpenSimOrigin):
        return "model.osim"
    if not isinstance(source, Origin) or source.text is None:
        return None
    file = source.text if isinstance(source.text, str | Path) else None
    return "model.urdf" if file and parsed(Path(file)).tag == "robot" else "model.xml"


def not_held(updated: str | None, result: Estimate) -> list[str]:
    """Line on the fitted drives that the updated model's format cannot hold."""
    if not updated:
        return []
    kinds = {"model.urdf": ("rotor", "spring", "stribeck"), "model.osim": DRIVE}.get(updated, ("stribeck",))
    columns = tuple(f"{DRIVE[kind]}(" for kind in kinds)
    # No file has friction or rotors of motors that move several joints.
    motors = result.fit.equations.axes.motors
    fitted = (*result.fit.equations.drives, *result.consistent().rotors)
    names = [name for name in fitted if name.startswith(columns) or column_place(name)[1] in motors]
    return [f"{updated} cannot hold {', '.join(names)}."] if names else []
