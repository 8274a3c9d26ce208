"""Report on the study of a person: tables, a figure, key numbers, and the terminal's text."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from experiments.document import tabular
from experiments.document.figures import empty_figure
from experiments.document.result_folder import OUTPUTS as RESULTS
from experiments.document.tabular import of_small
from experiments.document.writer import Card, Document, Headline, Plot
from experiments.reports import identify_page
from experiments.studies.person_on_plates import MOVED, PersonStudy
from experiments.studies.person_recordings import Laboratory
from ident.display.plots import Axes, Figure, few_decades
from ident.geometry.inertia import com_from_parameters
from ident.tolerances import INTERVAL
from sim.motion.person import ACTIVITIES

COLORS = {"prior": "0.55", "estimate": "C0"}

KINDS = {"masses": slice(0, 1), "first moments": slice(1, 4), "inertias": slice(4, 10)}
KIND_COLORS = ("C0", "C1", "C2")
"""Parameters of a segment by kind, and their colours."""

TICKS = (0.02, 0.05, 0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50)
"""Ticks of logarithmic axes, as far as they are in sight."""

SHARES = (0.15, 0.3, 0.6, 1.0)
"""Fractions of each recording's length at which the precision is evaluated."""


def figure(study: PersonStudy, feet_alone: PersonStudy) -> Figure:
    """Errors of first moments, and the precision gained by more recordings and seconds, with and without the rail."""
    with empty_figure(3.1, wide=True) as drawing:
        left, middle, right = drawing.subplots(1, 3)
        _segments(left, study)
        _growth(middle, study, feet_alone)
        _predictions(right, study, feet_alone)
        for ax in (left, middle, right):
            ax.legend(loc="upper center", bbox_to_anchor=(0.45, -0.2), ncols=2, fontsize=7, columnspacing=1)
    return drawing


def _segments(ax: Axes, study: PersonStudy) -> None:
    """Draws the error of each first moment's vector relative to its size, of prior and estimate."""
    first = {name: x[:, 1:4] for name, x in study.segments.items()}
    size = np.linalg.norm(first["true"], axis=1)
    rows = np.arange(len(size))
    for name, offset in (("prior", -0.15), ("estimate", 0.15)):
        error = 100 * np.linalg.norm(first[name] - first["true"], axis=1) / size
        ax.plot(error, rows + offset, "o", ms=3, color=COLORS[name], label=name)
    half = 100 * INTERVAL * np.linalg.norm(first["std"], axis=1) / size
    ax.hlines(rows + 0.15, 0, half, color=COLORS["estimate"], lw=0.9, alpha=0.5, label="95 % interval")
    ax.set_yticks(rows, [name.replace("_", " ") for name in study.true.bodies])
    ax.invert_yaxis()
    ax.set_xscale("symlog", linthresh=10, linscale=1)
    ax.xaxis.set_major_formatter("{x:g}")
    ax.set_xlim(left=0)
    ax.set_xlabel("Error of the first moment (%)", labelpad=2)
    ax.set_title("(a) First moments of segments")


def growth(study: PersonStudy) -> np.ndarray:
    """Standard deviations over the prior's by kind, geometric means, for each number of recordings (k + 1, 3)."""
    lengths = study.seconds * np.tri(len(study.activities) + 1, len(study.activities), -1)
    deviations = np.array([study.after(own.tolist())[1] for own in lengths])
    logs = np.log(deviations / deviations[0])
    return np.exp(np.stack([logs[..., which].mean(axis=(1, 2)) for which in KINDS.values()], axis=1))


def _growth(ax: Axes, study: PersonStudy, feet_alone: PersonStudy) -> None:
    """Draws the standard deviations of segments over the number of recordings."""
    numbers = np.arange(len(study.activities) + 1)
    for each, style, contacts in ((study, "-", "plates and rail"), (feet_alone, "--", "plates")):
        for name, marker, color, ratio in zip(KINDS, "osD", KIND_COLORS, growth(each).T, strict=True):
            label = name if each is study else f"_{name}, {contacts}"
            ax.plot(numbers, ratio, marker + style, ms=3, lw=0.9, color=color, label=label)
        ax.plot([], [], style, color="0.3", lw=0.9, label=contacts)
    ax.set_xticks(numbers, ["none", *(f"+ {activity}" for activity in study.activities)], rotation=30, ha="right")
    ax.set_ylabel("S.d. over the prior's", labelpad=2)
    ax.set_title(f"(b) Recordings of {study.seconds:g} s each")


def predicted_deviations(study: PersonStudy) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Total seconds, and s.d. of the wrench of motions not recorded over the prior's, for each motion and all."""
    kinds = dict(zip(study.activities, np.eye(len(study.activities)), strict=True))
    kinds["all"] = np.ones(len(study.activities))
    lengths = study.seconds * np.array(SHARES)
    return {
        name: (lengths * taken.sum(), np.array([study.predicted_deviation(list(length * taken)) for length in lengths]))
        for name, taken in kinds.items()
    }


def _predictions(ax: Axes, study: PersonStudy, feet_alone: PersonStudy) -> None:
    """Draws the standard deviation of the wrench of motions not recorded over the seconds recorded."""
    every = predicted_deviations(study)
    for name in study.activities:
        ax.loglog(*every[name], ".-", ms=3, lw=0.7, label=name)
    ax.loglog(*every["all"], "o-", ms=3, lw=1.2, color="black", label="all, plates and rail")
    ax.loglog(*predicted_deviations(feet_alone)["all"], "o--", ms=3, lw=1, color="0.5", label="all, plates")
    few_decades(ax, TICKS)
    ax.set_xlabel("Seconds recorded", labelpad=2)
    ax.set_ylabel("S.d. over the prior's", labelpad=2)
    ax.set_title("(c) Wrench of motions not recorded")


ABOUT = (
    "A simulated person moves on two force plates and holds a rail, and is identified from a prior whose bodies are "
    "wrong by a fifth, in a laboratory whose set-up differs from what is stated. The tables show the accuracy of each "
    "segment and of the wrench of motions that were not recorded."
)
"""The page's text on the study."""


def recording_file(number: int | str, activity: str) -> str:
    """File name of a simulated recording, numbered from 1."""
    return f"recording_{number}_{activity.replace(' ', '_')}.npz"


OUTPUTS = (*RESULTS, *(recording_file("*", activity) for activity in ACTIVITIES))
"""Patterns of the files that it writes."""


def table_segments(study: PersonStudy) -> tabular.Table:
    """Mass, largest component of the first moment and largest inertia of each segment: truth, prior, estimate, s.d."""
    true, every = study.segments["true"], np.arange(len(study.true.bodies))
    places = {("mass", "kg"): 0, ("first_moment", "kg m"): 1 + np.abs(true[:, 1:4]).argmax(axis=1)}
    places[("inertia", "kg m²")] = 4 + true[:, 4:7].argmax(axis=1)
    columns: dict[str, Sequence[tabular.Cell]] = {"segment": study.true.bodies}
    heads, deviations, digits = dict[str, str](), dict[str, str](), dict[str, tabular.Decimals]()
    for (what, unit), place in places.items():
        deviations[f"{what}_estimate"] = f"{what}_std"
        values = {which: x[every, place].tolist() for which, x in study.segments.items()}
        columns |= {f"{what}_{which}": own for which, own in values.items()}
        digits |= {f"{what}_{which}": of_small(values[which], values["std"]) for which in ("true", "prior")}
        words = {which: "s.d." if which == "std" else which for which in values}
        heads |= {f"{what}_{which}": f"{word}, {what.replace('_', ' ')} ({unit})" for which, word in words.items()}
    title = "Segments: mass, largest component of the first moment, and of the inertia about the joint"
    return tabular.Table(title, *tabular.columns(**columns), deviations=deviations, digits=digits, heads=heads)


def table_prediction(study: PersonStudy) -> tabular.Table:
    """Errors of the wrench of motions that were not recorded."""
    rows = [[name, *errors.tolist()] for name, errors in study.errors.items()]
    title = "Errors of the wrench of motions that were not recorded, over its standard deviation"
    return tabular.Table(title, ("candidate", *study.estimate.channels[:6]), rows)


def table_coverage(persons: Sequence[Mapping[str, Any]]) -> tabular.Table:
    """Coverage of the intervals of determined combinations, for each person and for all together."""
    rows: list[tuple[tabular.Cell, ...]] = [
        (str(number), *_counted([person]), person["noise_of_angles"], person["times_better"])
        for number, person in enumerate(persons, start=1)
    ]
    rows.append(("all", *_counted(persons), None, None))
    heads = {
        "determined": "determined",
        "hold": "coverage of 95 % intervals",
        "rms_z": "RMS z",
        "determined_by_noise": "determined, noise alone",
        "hold_by_noise": "coverage of 95 % intervals, noise alone",
        "rms_z_by_noise": "RMS z, noise alone",
        "noise_of_angles": "estimated noise of angles (°)",
        "times_better": "times better than the prior, worst channel",
    }
    title = "Coverage of the intervals of determined combinations: each row another person, motion and noise"
    return tabular.Table(title, ("person", *heads), rows, decimals=2, heads=heads)


def _counted(persons: Sequence[Mapping[str, Any]]) -> Iterator[tabular.Cell]:
    """Yields determined combinations, coverage of their 95 % intervals, RMS z: with set-up, by noise alone."""
    for kind in ("with_setup", "of_noise"):
        std, errors = (np.concatenate([person[kind][key] for person in persons]) for key in ("std", "z"))
        z = errors[std < MOVED]
        yield len(z)
        yield float(np.mean(np.abs(z) < INTERVAL)) if len(z) else None
        yield float(np.sqrt(np.mean(z**2))) if len(z) else None


def numbers(study: PersonStudy) -> dict[str, Any]:
    """Key numbers for scripts."""
    estimate = study.estimate
    segments = {
        name: {kind: x[k].tolist() for kind, x in study.segments.items()} for k, name in enumerate(study.true.bodies)
    }
    predictions = {name: [x.tolist() for x in each] for name, each in predicted_deviations(study).items()}
    centres = {name: com_from_parameters(np.array(each["estimate"]))[1].tolist() for name, each in segments.items()}
    return {
        "activities": list(study.activities),
        "seconds": study.seconds,
        "base_parameters": len(study.psi),
        "combinations": len(study.determined),
        "determined": int(study.determined.sum()),
        "coverage_of_determined": study.coverage if study.determined.any() else None,
        "rms_z": float(np.sqrt((study.distances[1] ** 2).mean())),
        "set_up": [{"name": each.name, "value": each.value, "std": each.std} for each in estimate.setup],
        "verdict": str(estimate.verdict()),
        "segments": segments,
        "growth": growth(study).tolist(),
        "foretold": {name: dict(zip(("seconds", "deviation"), x, strict=True)) for name, x in predictions.items()},
        "errors": {name: dict(zip(estimate.channels, x.tolist(), strict=False)) for name, x in study.errors.items()},
        "times_better": (study.errors["prior"] / study.errors["trajectory estimate"]).tolist(),
        "centres_of_mass": centres,
    }


def measured(laboratory: Laboratory) -> str:
    """A sentence on the source of the angles and their noise."""
    if laboratory.markers:
        noise, skin = 1e3 * laboratory.marker, 1e3 * laboratory.skin
        return f"Angles come from markers, with noise of {noise:g} mm, on skin that moves by {skin:g} mm."
    kind = f"correlated at {laboratory.decay:g} from sample to sample" if laboratory.decay else "white"
    return f"Angles have noise of {laboratory.angle_deg:g}°, {kind}."


def count(persons: Sequence[Mapping[str, Any]], laboratory: Laboratory, provenance: dict[str, Any]) -> Document:
    """Document of the coverage of intervals over several persons."""
    about = "Each person has motions, noise, errors of the set-up and a prior that is wrong by a fifth of its own."
    return Document(
        f"Persons on two force plates{', at a rail' if laboratory.rail else ''}",
        f"{about} {measured(laboratory)}",
        tables={"table_coverage": table_coverage(persons)},
        numbers={"summary": {"persons": list(persons)}, "provenance": provenance},
    )


def document(study: PersonStudy, feet_alone: PersonStudy, provenance: dict[str, Any]) -> Document:
    """Results of a person who holds the rail and of one who does not, with a replay."""
    caption = (
        "A person on two force plates who holds a rail: error of each segment's first moment before and after "
        f"{len(study.activities)} recordings of {study.seconds:g} s, with the 95 % interval of the estimate (a); "
        "standard deviations of all segments' parameters, geometric means over those known beforehand, as recordings "
        "are added (b), and of the wrench of motions that were not recorded, geometric means over the channels, as "
        "recordings of one motion or of all of them get longer (c); with the rail and without."
    )
    estimate, determined = study.estimate, study.determined
    line = f"{determined.sum()} of {len(determined)} independent combinations of base parameters are determined"
    if determined.any():
        line += f"; {100 * study.coverage:.0f} % of their 95 % intervals contain the true value"
    return Document(
        "A person on two force plates, at a rail",
        f"{ABOUT} {measured(study.laboratory)}",
        headline=Headline.of(estimate.verdict()),
        verdict=str(estimate.verdict()),
        pictures=[*identify_page.first_screen(estimate)],
        findings=[*map(Card.of, estimate.findings)],
        lines=[f"{line}."],
        tables={"table_segments": table_segments(study), "table_prediction": table_prediction(study)},
        figures={"figure_human": Plot(partial(figure, study, feet_alone), caption)},
        numbers={
            "summary": {"plates_and_rail": numbers(study), "plates": numbers(feet_alone)},
            "provenance": provenance,
        },
        # There is no table of base parameters, whose rows could be pressed.
        replay=replace(identify_page.replay(estimate), parameters=()),
        recordings={
            recording_file(number, activity): recording
            for number, (activity, recording) in enumerate(zip(study.activities, study.recordings, strict=True), 1)
        },
    )
