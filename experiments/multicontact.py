"""Section VII: identification with a contact at the end of the second link (Table IV, Figures 4 and 5)."""

import argparse
import sys
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

import scenes
from experiments import figures, monte_carlo, options, paper, report
from experiments.multicontact_study import SCENE, SENSOR, Study, problem, study, trial

DIFFERS = frozenset({"Ixx2", "Ixx3", "Ixz3"})
"""Entries of Table IV that no rigid body can have."""

FOOTNOTE = (
    "The paper put inertias about the centres of mass into parameters that are defined about the frame origins; no "
    "rigid body has those. The scene's values differ by exactly the parallel-axis terms."
)


def table_4(result: Study) -> report.Table:
    """Errors with the contact's wrench, beside the paper's."""
    return report.Table(
        "Base parameters with several contacts, kg, kg m and kg m²",
        *report.columns(
            parameter=result.fit.base.names,
            true_paper=[paper.TABLE_4[name][0] for name in result.fit.base.names],
            true_scene=result.fit.psi_true,
            error=result.fit.error,
            paper_error=[paper.TABLE_4[name][1] for name in result.fit.base.names],
        ),
        marked=DIFFERS,
        footnote=FOOTNOTE,
    )


def table_4_ignoring(result: Study) -> report.Table:
    """What the ground wrench alone gives, beside the estimate from both wrenches."""
    return report.Table(
        "Ordinary and weighted least squares, and the contact ignored, kg, kg m and kg m²; "
        f"std of wrench noise, {result.fit.estimate.noise}",
        *report.columns(
            parameter=result.fit.base.names,
            true=result.fit.psi_true,
            estimated=result.fit.estimate.psi,
            error=result.fit.error,
            std_wrench_noise=result.fit.estimate.std,
            error_weighted=result.weighted.error,
            std_weighted=result.weighted.estimate.std,
            estimated_ignoring=result.ignoring.estimate.psi,
            error_ignoring=result.ignoring.error,
            regrouping=result.fit.base.expressions(),
        ),
    )


def figure_4(result: Study) -> Figure:
    """Measured ground wrench, true total wrench and the wrench recovered from the estimates, over time."""
    return figures.wrench_panels(
        result.recording.time,
        {
            "Ground, measured": (result.recording.wrench("ground"), figures.Line("tab:red", width=0.6)),
            "Total, true": (result.true.wrench, figures.Line("tab:blue", width=1.8)),
            "Recovered": (result.fit.predicted, figures.Line("black", width=0.6)),
        },
        "Time (s)",
    )


def figure_5(result: Study) -> Figure:
    """Measured total wrench less the wrench predicted from the estimates, over time."""
    return figures.wrench_panels(
        result.recording.time,
        {"Measured - predicted": (result.measured.wrench - result.fit.predicted, figures.Line("black", width=0.4))},
        "Time (s)",
        symbol=r"\Delta {}",
    )


def summary(result: Study) -> dict[str, Any]:
    """Key numbers for scripts."""
    recording, estimate = result.recording, result.fit.estimate
    force = np.linalg.norm(recording.noise_free[f"{SENSOR}_force"], axis=1)
    numbers = {
        "condition_number": estimate.condition_number,
        "rank": result.fit.base.rank,
        "rows": estimate.rows,
        "epsilon": estimate.epsilon,
        "paper_condition_number": paper.CONDITION_NUMBER_MULTICONTACT,
        "largest_error": float(np.abs(result.fit.error).max()),
        "largest_error_ignoring": float(np.abs(result.ignoring.error).max()),
        "contact_peak_force_N": float(force.max()),
        "tracking_error_rad": recording.provenance["tracking_error_rad"],
        "noise": dict(recording.noise),
    }
    if "pad_normal_force" in recording.true:
        touching = recording.true["pad_normal_force"] > 0
        numbers["contact_fraction"] = float(touching.mean())
        numbers["contact_episodes"] = int(touching[0] + np.sum(~touching[:-1] & touching[1:]))
    return numbers


def report_text(result: Study) -> str:
    """What the terminal shows."""
    found = summary(result)
    rows, columns = paper.SHAPE_MULTICONTACT
    lines = [
        table_4(result).text(),
        table_4_ignoring(result).text(),
        f"Condition number: {found['condition_number']:.1f} at {found['rows']}x{found['rank']} "
        f"(paper: {paper.CONDITION_NUMBER_MULTICONTACT} at {rows}x{columns})",
        f"Largest error: {found['largest_error']:.3f} with the contact, "
        f"{found['largest_error_ignoring']:.3f} when it is ignored",
        f"Peak contact force: {found['contact_peak_force_N']:.0f} N",
    ]
    if "contact_fraction" in found:
        lines.append(
            f"In contact: {found['contact_fraction']:.0%} of the samples, in {found['contact_episodes']} episodes"
        )
    return "\n".join(lines)


def write(result: Study, folder: Path, formats: Iterable[str]) -> None:
    """Writes all tables, figures and the summary into a folder."""
    table_4(result).write(folder, "table_4")
    table_4_ignoring(result).write(folder, "table_4_ignoring")
    figures.save(figure_4(result), folder, "figure_4", formats)
    figures.save(figure_5(result), folder, "figure_5", formats)
    report.write_json(folder / "summary.json", summary(result))


def run(args: argparse.Namespace) -> None:
    """Runs the study and writes and prints its results."""
    choices = {key: getattr(args, key) for key in ("seed", "samples", "contact", "noise_scale")}
    result = study(**choices)
    names = result.fit.base.names
    plan = monte_carlo.Plan(
        scene={"name": SCENE, "contact": args.contact},
        analyse=partial(trial, problem(args.contact)),
        names=names,
        published={"multicontact": [paper.TABLE_4[name][1] for name in names]},
    )
    writing = partial(write, result, formats=args.formats)
    monte_carlo.conclude(args, choices, result.recording, plan, writing, report_text(result))


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.study_parser("multicontact", __doc__)
    out.add_argument("--contact", choices=scenes.CONTACTS, default="pad", help="what the second link touches")
    return out


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return options.run(run, parser(), argv)


if __name__ == "__main__":
    sys.exit(main())
