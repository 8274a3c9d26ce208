"""Report on the study of a person: tables, a figure, key numbers, and the terminal's text."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from experiments.data.simulated_person import MOVED, Laboratory, PersonStudy
from experiments.document import tabular
from experiments.document.document import Card, Document, Headline, Plot
from experiments.document.result_folder import OUTPUTS as RESULTS
from experiments.reports import identify_page
from experiments.reports.human_figure import figure, growth, predicted_deviations
from ident.geometry.inertia import com_from_parameters
from ident.tolerances import INTERVAL
from sim.motion.person import ACTIVITIES

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
    phi, std = study.segments
    true, prior = (arm.known.reshape(-1, 10) for arm in (study.true, study.mechanism))
    rows: list[tuple[tabular.Cell, ...]] = []
    for k, name in enumerate(study.true.bodies):
        first = 1 + int(np.argmax(np.abs(true[k, 1:4])))
        inertia = 4 + int(np.argmax(true[k, 4:7]))
        rows.append((name, *(float(x[k, j]) for j in (0, first, inertia) for x in (true, prior, phi, std))))
    columns = ["segment"]
    for what in ("mass", "first_moment", "inertia"):
        columns += [f"{what}_{which}" for which in ("true", "prior", "estimate", "std")]
    title = "Segments: mass, largest component of the first moment, and of the inertia about the joint"
    heads = {
        f"{what}_{which}": f"{'s.d.' if which == 'std' else which}, {what.replace('_', ' ')} ({unit})"
        for what, unit in (("mass", "kg"), ("first_moment", "kg m"), ("inertia", "kg m²"))
        for which in ("true", "prior", "estimate", "std")
    }
    deviations = {f"{what}_estimate": f"{what}_std" for what in ("mass", "first_moment", "inertia")}
    return tabular.Table(title, tuple(columns), tuple(rows), deviations=deviations, heads=heads)


def table_prediction(study: PersonStudy) -> tabular.Table:
    """Errors of the wrench of motions that were not recorded."""
    rows: list[tuple[tabular.Cell, ...]] = [(name, *map(float, errors)) for name, errors in study.errors.items()]
    title = "Errors of the wrench of motions that were not recorded, over its standard deviation"
    return tabular.Table(title, ("candidate", *study.estimate.channels[:6]), tuple(rows), decimals=3)


def table_coverage(persons: Sequence[Mapping[str, Any]]) -> tabular.Table:
    """Coverage of the intervals of determined combinations, for each person and for all together."""
    rows: list[tuple[tabular.Cell, ...]] = []
    for number, person in enumerate(persons, start=1):
        rows.append((str(number), *_counted([person]), person["noise_of_angles"], person["times_better"]))
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
    return tabular.Table(title, ("person", *heads), tuple(rows), decimals=2, heads=heads)


def _counted(persons: Sequence[Mapping[str, Any]]) -> tuple[tabular.Cell, ...]:
    """Number of determined combinations, coverage of their 95 % intervals, and RMS z: with set-up, by noise alone."""
    out: list[tabular.Cell] = []
    for kind in ("with_setup", "of_noise"):
        std, errors = (np.concatenate([person[kind][key] for person in persons]) for key in ("std", "z"))
        z = errors[std < MOVED]
        out += [
            len(z),
            *(map(float, (np.mean(np.abs(z) < INTERVAL), np.sqrt(np.mean(z**2)))) if len(z) else (None,) * 2),
        ]
    return tuple(out)


def numbers(study: PersonStudy) -> dict[str, Any]:
    """Key numbers for scripts."""
    estimate, (phi, std) = study.estimate, study.segments
    segments = {
        name: {"true": t, "prior": p, "estimate": x, "std": s}
        for name, t, p, x, s in zip(
            study.true.bodies,
            *(y.reshape(-1, 10).tolist() for y in (study.true.known, study.mechanism.known, phi, std)),
            strict=True,
        )
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
