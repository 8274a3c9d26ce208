"""What Section VII shows of contacts: Table IV, Figures 4 and 5, key numbers, and the text for the terminal."""

import argparse
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import scenes
from experiments.cli.defaults import SCENE
from experiments.output import figures, report
from experiments.output.results import Results
from experiments.studies import monte_carlo, paper
from experiments.studies.contacts import Study, cells, joint_trial, problem, study, total, trial
from experiments.studies.fitting import ESTIMATORS

DIFFERS = frozenset({"Ixx2", "Ixx3", "Ixz3"})
"""Entries of Table IV that no rigid body can have."""

FOOTNOTE = (
    "The paper put inertias about the centres of mass into parameters that are defined about the frame origins; no "
    "rigid body has those. The scene's values differ by exactly the parallel-axis terms."
)

CONTACT_LINES = (figures.Line("tab:green"), figures.Line("tab:orange"))
"""How the contacts' wrenches are drawn."""


def table_4(result: Study) -> report.Table:
    """Errors with all contacts' wrenches, beside the paper's."""
    return report.Table(
        f"Base parameters with {'several contacts' if result.several else 'a contact'}, kg, kg m and kg m²; joint: "
        + ESTIMATORS["joint"],
        *report.columns(
            parameter=result.fit.base.names,
            true_paper=[paper.TABLE_4[name][0] for name in result.fit.base.names],
            true_scene=result.fit.psi_true,
            error=result.fit.error,
            paper_error=[paper.TABLE_4[name][1] for name in result.fit.base.names],
            joint_error=result.joint.error,
            joint_std=result.joint.std,
        ),
        marked=DIFFERS,
        footnote=FOOTNOTE,
    )


def table_4_ignoring(result: Study) -> report.Table:
    """What the ground wrench alone gives, or all wrenches but one's, beside the estimate from all of them."""
    least_squares: dict[str, np.ndarray] = {
        "std_wrench_noise": result.fit.estimate.std,
        "error_weighted": result.weighted.error,
        "std_weighted": result.weighted.estimate.std,
    }
    alone = result.ignoring["all"]
    without = {"estimated_ignoring": alone.estimate.psi, "error_ignoring": alone.error}
    if result.several:
        without = {f"error_ignoring_{name}": fit.error for name, fit in result.ignoring.items()}
    without["joint_error_ignoring" + "_all" * result.several] = result.joint_ignoring.error
    return report.Table(
        f"Ordinary and weighted least squares, and the contact{'s' * result.several} ignored, kg, kg m and kg m²; "
        f"std of wrench noise, {result.fit.estimate.noise}; joint: {ESTIMATORS['joint']}",
        *report.columns(
            parameter=result.fit.base.names,
            true=result.fit.psi_true,
            estimated=result.fit.estimate.psi,
            error=result.fit.error,
            **(without | least_squares if result.several else least_squares | without),
            regrouping=result.fit.base.expressions(),
        ),
    )


def table_contacts(result: Study) -> report.Table:
    """When each contact touches, and how much."""
    found, known = summary(result), result.known

    def each(number: str) -> list[Any]:
        return [found[f"{site}_{number}"] for site in cells(known).values()]

    return report.Table(
        "Contacts: shares of the samples in which each touches, and touches alone, number of episodes, peak force",
        *report.columns(
            contact=known.sites,
            link=[body for body, _ in known.sites.values()],
            touches=each("fraction"),
            touches_alone=each("fraction_alone"),
            episodes=map(str, each("episodes")),
            peak_force_N=each("peak_force_N"),
        ),
    )


def figure_4(result: Study) -> Figure:
    """Measured ground wrench, true total wrench and the wrench recovered from the estimates, over time."""
    return figures.wrench_panels(
        result.recording.time,
        {
            "Ground, measured": (result.recording.wrench("ground").values, figures.Line("tab:red", width=0.6)),
            "Total, true": (result.true.values, figures.Line("tab:blue", width=1.8)),
            "Recovered": (result.fit.predicted, figures.Line("black", width=0.6)),
        },
        "Time (s)",
        shaded=together(result),
    )


def figure_5(result: Study) -> Figure:
    """Measured total wrench less the wrench predicted from the estimates, over time."""
    return figures.wrench_panels(
        result.recording.time,
        {"Measured - predicted": (result.measured.values - result.fit.predicted, figures.Line("black", width=0.4))},
        "Time (s)",
        symbol=r"\Delta {}",
        shaded=together(result),
    )


def figure_contacts(result: Study) -> Figure:
    """What each contact takes from the ground wrench, measured and moved to the base frame, over time."""
    known, recording = result.known, result.recording
    taken = {name: total(known, recording, {name}).values - result.measured.values for name in known.sites}
    return figures.wrench_panels(
        recording.time,
        {name.capitalize(): (taken[name], line) for name, line in zip(taken, CONTACT_LINES, strict=False)},
        "Time (s)",
        shaded=together(result),
    )


def together(result: Study) -> dict[str, np.ndarray]:
    """When several contacts all touch, for the figures (N,)."""
    return {"All touch": np.all(list(result.touching.values()), axis=0)} if result.several else {}


def summary(result: Study) -> dict[str, Any]:
    """Key numbers for scripts."""
    recording, estimate = result.recording, result.fit.estimate
    ignoring = {name: float(np.abs(fit.error).max()) for name, fit in result.ignoring.items()}
    return {
        "condition_number": estimate.condition_number,
        "rank": result.fit.base.rank,
        "rows": estimate.rows,
        "epsilon": estimate.epsilon,
        "paper_condition_number": paper.CONDITION_NUMBER_MULTICONTACT,
        "largest_error": float(np.abs(result.fit.error).max()),
        "largest_error_ignoring": ignoring.pop("all"),
        **{f"largest_error_ignoring_{name}": error for name, error in ignoring.items()},
        **_touches(result),
        "tracking_error_rad": recording.provenance["tracking_error_rad"],
        "noise": dict(recording.noise),
    }


def joint_summary(result: Study) -> dict[str, float | None]:
    """Key numbers of the joint estimate, which takes longer than all the rest."""
    return {
        "largest_error": result.joint.largest_error,
        "largest_error_ignoring": result.joint_ignoring.largest_error,
        "rms_z": result.joint.rms_z,
    }


def _shown(error: float | None) -> str:
    return "not determined" if error is None else report.number(error)


def _touches(result: Study) -> dict[str, float]:
    """When each contact touches, and how much; how often all do, and none does."""
    number = np.sum(list(result.touching.values()), axis=0)
    found: dict[str, float] = {}
    for name, touching in result.touching.items():
        site = cells(result.known)[name]
        found |= {
            f"{site}_fraction": float(touching.mean()),
            f"{site}_fraction_alone": float(np.mean(touching & (number == 1))),
            f"{site}_episodes": int(touching[0] + np.sum(~touching[:-1] & touching[1:])),
            f"{site}_peak_force_N": float(np.linalg.norm(result.recording.true[f"{site}_force"], axis=1).max()),
        }
    return found | {
        "contact_peak_force_N": max(x for key, x in found.items() if key.endswith("_peak_force_N")),
        "fraction_all_touch": float(np.mean(number == len(result.touching))),
        "fraction_none_touches": float(np.mean(number == 0)),
    }


def report_text(result: Study) -> str:
    """What the terminal shows."""
    numbers = summary(result)
    rows, columns = paper.SHAPE_MULTICONTACT
    errors = "; ".join(f"ignoring {name} {np.abs(fit.error).max():.3f}" for name, fit in result.ignoring.items())
    lines = [
        table_4(result).text(),
        table_4_ignoring(result).text(),
        table_contacts(result).text(),
        f"Condition number: {numbers['condition_number']:.1f} at {numbers['rows']}x{numbers['rank']} "
        f"(paper: {paper.CONDITION_NUMBER_MULTICONTACT} at {rows}x{columns})",
        f"Largest error: {numbers['largest_error']:.3f} with all contacts; {errors}",
        f"  of the joint estimate: {_shown(result.joint.largest_error)} with all contacts; "
        f"ignoring all {_shown(result.joint_ignoring.largest_error)}",
        f"All contacts touch in {numbers['fraction_all_touch']:.0%} of the samples, "
        f"none in {numbers['fraction_none_touches']:.0%}",
    ]
    return "\n".join(lines)


def results(result: Study) -> Results:
    """All tables, figures and the summary."""
    shown = Results(
        tables={"table_4": table_4(result), "table_4_ignoring": table_4_ignoring(result)},
        figures={
            "figure_4": (
                figure_4(result),
                "Measured ground wrench red, true total wrench blue, wrench recovered from the estimates black.",
            ),
            "figure_5": (figure_5(result), "Measured total wrench less the predicted one."),
        },
        numbers={"summary": summary(result) | {"joint": joint_summary(result)}},
    )
    if not result.several:
        return shown
    caption = "Measured wrenches in the base frame that the links exert on the pad (green) and on the hand (orange)."
    return shown | Results(
        tables={"table_contacts": table_contacts(result)},
        figures={"figure_contacts": (figure_contacts(result), caption)},
    )


def run(args: argparse.Namespace) -> Results:
    """Runs the study and writes and prints its results."""
    choices = {key: getattr(args, key) for key in ("seed", "samples", "contact", "noise_scale")}
    choices["contact"] = contact = " ".join(scenes.load_cells(" ".join(args.contact)))
    result = study(**choices)
    names = result.fit.base.names
    plan = monte_carlo.Plan(
        scene={"name": SCENE, "contact": contact},
        analyse=partial(trial, problem(contact)),
        names=names,
        published={"multicontact": [paper.TABLE_4[name][1] for name in names]},
        joint=partial(joint_trial, problem(contact)),
        joint_model="multicontact",
    )
    return monte_carlo.conclude(args, choices, result.recording, plan, results(result), report_text(result))
