"""Section VI: what a 5° tilt of the joint axes does to a model that neglects it (Table III, Figures 2 and 3)."""

import argparse
import sys
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments import figures, monte_carlo, options, paper, report
from experiments.misaligned_study import AZIMUTH_DEG, SCENE, Study, problem, study, trial
from ident.screw import angle

TRUE_LINE = figures.Line("black", width=1.6)
SIMPLIFIED_LINE = figures.Line("tab:red")
FULL_LINE = figures.Line("tab:blue", style="--")


def table_3(result: Study) -> report.Table:
    """Both models on the table's 13 names, beside the paper's errors."""
    simplified, full = result.simplified, result.full_on_table
    published = [paper.TABLE_3[name] for name in simplified.base.names]
    return report.Table(
        "Errors of the base parameters (Table III), kg, kg m and kg m²",
        *report.columns(
            parameter=simplified.base.names,
            true_simplified=simplified.psi_true,
            error_simplified=simplified.error,
            paper_error_simplified=[row[0] for row in published],
            true_full=full.psi_true,
            error_full=full.error,
            paper_error_full=[row[1] for row in published],
        ),
    )


def table_3_full(result: Study) -> report.Table:
    """The full model on its own first independent columns."""
    full = result.full
    return report.Table(
        "The full model on its own base parameters, kg, kg m and kg m²",
        *report.columns(
            parameter=full.base.names,
            true=full.psi_true,
            estimated=full.estimate.psi,
            error=full.error,
            std_wrench_noise=full.estimate.std,
            regrouping=full.base.expressions(digits=4),
        ),
    )


def figure_2(result: Study) -> Figure:
    """Recovered wrenches against the true one, over time."""
    return figures.wrench_panels(
        result.recording.time,
        {
            "True": (result.recording.noise_free.wrench("ground"), TRUE_LINE),
            "Simplified": (result.simplified.predicted, SIMPLIFIED_LINE),
            "Full": (result.full.predicted, FULL_LINE),
        },
        "Time (s)",
    )


def figure_3(result: Study) -> Figure:
    """Absolute errors of the recovered wrenches against the true, noise-free one, over samples."""
    true = result.recording.noise_free.wrench("ground")
    return figures.wrench_panels(
        np.arange(1, len(true) + 1),
        {
            "Simplified": (np.abs(result.simplified.predicted - true), figures.Line("tab:red", width=0.5)),
            "Full": (np.abs(result.full.predicted - true), figures.Line("tab:blue", width=0.4)),
        },
        "Sample",
        symbol=r"|\Delta {}|",
        bottom=0,
    )


def summary(result: Study) -> dict[str, Any]:
    """Key numbers for scripts."""
    recovered, recording = result.recovered, result.recording
    fits = {"simplified": result.simplified, "full": result.full, "full_on_table": result.full_on_table}
    numbers: dict[str, Any] = {}
    for name, model in fits.items():
        numbers |= {
            f"condition_number_{name}": model.estimate.condition_number,
            f"rank_{name}": model.base.rank,
            f"rows_{name}": model.estimate.rows,
            f"epsilon_{name}": model.estimate.epsilon,
        }
    return numbers | {
        "paper_condition_number_simplified": paper.CONDITION_NUMBER_SIMPLIFIED,
        "paper_condition_number_full": paper.CONDITION_NUMBER_FULL,
        "axis_error_deg": float(np.degrees(result.axis_error.max())),
        "axis_std_deg": float(np.degrees(max(axis.std for axis in recovered.axes))),
        "axis_difference_alone_deg": float(np.degrees(angle(*(axis.vector for axis in recovered.separate)))),
        "rank_axes_apart": result.rank_apart,
        "axes_parallel_p_value": float(recovered.p_values[1]),
        "tracking_error_rad": recording.provenance["tracking_error_rad"],
        "noise": dict(recording.noise),
    }


def report_text(result: Study) -> str:
    """What the terminal shows."""
    found = summary(result)

    def condition(name: str) -> str:
        return f"{found[f'condition_number_{name}']:.1f} at {found[f'rows_{name}']}x{found[f'rank_{name}']}"

    def printed(number: float, shape: tuple[int, int]) -> str:
        return f" (paper: {number} at {shape[0]}x{shape[1]})"

    lines = (
        table_3(result).text(),
        table_3_full(result).text(),
        "Condition numbers",
        f"  simplified model: {condition('simplified')}"
        + printed(paper.CONDITION_NUMBER_SIMPLIFIED, paper.SHAPE_SIMPLIFIED),
        f"  full model, its own columns: {condition('full')}" + printed(paper.CONDITION_NUMBER_FULL, paper.SHAPE_FULL),
        f"  full model, the table's names: {condition('full_on_table')}",
        "Recovered axes",
        f"  {found['axis_error_deg']:.3f} deg from the true ones, predicted standard deviation "
        f"{found['axis_std_deg']:.3f} deg;",
        f"  joint by joint {found['axis_difference_alone_deg']:.3f} deg apart (rank {result.rank_apart});",
        f"  a Wald test cannot tell that from parallel (p = {found['axes_parallel_p_value']:.2f}),",
        f"  so both joints were given one direction (rank {result.full.base.rank})",
    )
    return "\n".join(lines)


def write(result: Study, folder: Path, formats: Iterable[str]) -> None:
    """Writes all tables, figures and the summary into a folder."""
    table_3(result).write(folder, "table_3")
    table_3_full(result).write(folder, "table_3_full")
    figures.save(figure_2(result), folder, "figure_2", formats)
    figures.save(figure_3(result), folder, "figure_3", formats)
    report.write_json(folder / "summary.json", summary(result))


def run(args: argparse.Namespace) -> None:
    """Runs the study and writes and prints its results."""
    choices = {key: getattr(args, key) for key in ("seed", "samples", "tilt_deg", "azimuth_deg", "noise_scale")}
    result = study(**choices)
    names = result.simplified.base.names
    plan = monte_carlo.Plan(
        scene={"name": SCENE, "tilt_deg": args.tilt_deg, "azimuth_deg": args.azimuth_deg},
        analyse=partial(trial, problem(args.tilt_deg, args.azimuth_deg)),
        names=names,
        published={m: [paper.TABLE_3[n][k] for n in names] for k, m in enumerate(("simplified", "full"))},
    )
    writing = partial(write, result, formats=args.formats)
    monte_carlo.conclude(args, choices, result.recording, plan, writing, report_text(result))


def parser() -> argparse.ArgumentParser:
    """Command-line options."""
    out = options.study_parser("misaligned", __doc__)
    out.add_argument("--tilt-deg", type=float, default=paper.TILT_DEG, help="angle of both joint axes from X")
    out.add_argument("--azimuth-deg", type=float, default=AZIMUTH_DEG, help="direction of the tilt, from +Y to +Z")
    return out


def main(argv: Sequence[str] | None = None) -> int:
    """Entry point; returns the exit code."""
    return options.run(run, parser(), argv)


if __name__ == "__main__":
    sys.exit(main())
