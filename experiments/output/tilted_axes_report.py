"""What Section VI shows of tilted axes: Table III, Figures 2 and 3, key numbers, and the text for the terminal."""

import argparse
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from experiments.cli.defaults import SCENE
from experiments.output import figures, report
from experiments.output.results import Results
from experiments.studies import monte_carlo, paper
from experiments.studies.fitting import ESTIMATORS, Trial
from experiments.studies.tilted_axes import Study, design, joint_trial, study, trial
from ident.mechanism.axes import angle

TRUE_LINE = figures.Line("black", width=1.6)
SIMPLIFIED_LINE = figures.Line("tab:red")
FULL_LINE = figures.Line("tab:blue", style="--")

X_AXIS = np.array([1.0, 0.0, 0.0])
"""Joint axis of the simplified model."""

CHANNELS = ("Fx", "Fy", "Fz", "τx", "τy", "τz")
"""The wrench's components as the paper names them."""

STILL = 1e-9
"""Standard deviation, N or N m, up to which a channel only shows rounding."""

WINDOW = 25
"""Samples that a running mean of Figure 3 takes, a quarter of a second."""


def table_3(result: Study) -> report.Table:
    """Both models on the table's 13 names, beside the paper's errors."""
    simplified, full = result.simplified, result.full_on_table
    published = [paper.TABLE_3[name] for name in simplified.base.names]
    return report.Table(
        "True base parameters and errors of the simplified and of the full model, kg, kg m and kg m²; joint: "
        + ESTIMATORS["joint"],
        *report.columns(
            parameter=simplified.base.names,
            true_simplified=simplified.psi_true,
            error_simplified=simplified.error,
            paper_error_simplified=[row[0] for row in published],
            joint_error_simplified=result.joint["simplified"].error,
            true_full=full.psi_true,
            error_full=full.error,
            paper_error_full=[row[1] for row in published],
            joint_error_full=result.joint["full"].error,
            joint_std_full=result.joint["full"].std,
        ),
    )


def table_3_full(result: Study) -> report.Table:
    """The full model on its own first independent columns."""
    full = result.full
    return report.Table(
        f"The full model on its own base parameters, kg, kg m and kg m²; std of wrench noise, {full.estimate.noise}",
        *report.columns(
            parameter=full.base.names,
            true=full.psi_true,
            estimated=full.estimate.psi,
            error=full.error,
            std_wrench_noise=full.estimate.std,
            regrouping=full.base.expressions(digits=4),
        ),
    )


def table_wrench_errors(result: Study) -> report.Table:
    """Root mean squares of both recovered wrenches' errors by channel, and their ratio to the channel's own s.d."""
    std = result.recording.noise_free.wrench("ground").values.std(axis=0)
    rms = [np.sqrt((wrench_error(result, model) ** 2).mean(axis=0)) for model in (result.simplified, result.full)]
    rows = tuple(
        (name, float(s), *map(float, x), *(float(r / s) if s > STILL else None for r in x))
        for name, s, *x in zip(CHANNELS, std, *rms, strict=True)
    )
    return report.Table(
        "RMS errors of the recovered wrench, N and N m, and their ratio to the s.d. of the true, noise-free one",
        ("channel", "true_std", "rms_simplified", "rms_full", "ratio_simplified", "ratio_full"),
        rows,
    )


def wrench_error(result: Study, model: Trial) -> np.ndarray:
    """Recovered less true, noise-free wrench (N, 6)."""
    return model.predicted - result.recording.noise_free.wrench("ground").values


def figure_2(result: Study) -> Figure:
    """Recovered wrenches against the true one, over time."""
    return figures.wrench_panels(
        result.recording.time,
        {
            "True": (result.recording.noise_free.wrench("ground").values, TRUE_LINE),
            "Simplified": (result.simplified.predicted, SIMPLIFIED_LINE),
            "Full": (result.full.predicted, FULL_LINE),
        },
        "Time (s)",
    )


def figure_3(result: Study) -> Figure:
    """Absolute errors of the recovered wrenches over samples, faint, and their running root mean squares.

    Where both models err alike, as joint noise makes them, samples hide one another; their means lie side by side.
    """
    drawn = {
        "Simplified": (wrench_error(result, result.simplified), replace(SIMPLIFIED_LINE, width=1.4)),
        "Full": (wrench_error(result, result.full), FULL_LINE),
    }
    samples = {
        name: (np.abs(error), figures.Line(line.color, width=0.3, alpha=0.35)) for name, (error, line) in drawn.items()
    }
    means = {f"{name}, running RMS": (_running_rms(error), line) for name, (error, line) in drawn.items()}
    number = np.arange(1, len(result.recording.time) + 1)
    return figures.wrench_panels(number, samples | means, "Sample", symbol=r"|\Delta {}|", bottom=0)


def _running_rms(x: np.ndarray) -> np.ndarray:
    """Root mean square of up to `WINDOW` samples around each (N, 6)."""
    sums = np.concatenate([np.zeros((1, 6)), np.cumsum(x**2, axis=0)])
    middle = np.arange(len(x))
    first, last = np.maximum(middle - WINDOW // 2, 0), np.minimum(middle + WINDOW // 2 + 1, len(x))
    return np.sqrt((sums[last] - sums[first]) / (last - first)[:, None])


def summary(result: Study) -> dict[str, Any]:
    """Key numbers for scripts."""
    recovered, recording = result.recovered, result.recording
    errors = table_wrench_errors(result)
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
        "wrench_errors": {str(name): dict(zip(errors.columns[1:], row, strict=True)) for name, *row in errors.rows},
        "tilt_recovered_deg": float(np.degrees(angle(recovered.axes[0].vector, X_AXIS))),
        "axis_error_deg": float(np.degrees(result.axis_error.max())),
        "axis_std_deg": float(np.degrees(max(axis.std for axis in recovered.axes))),
        "axis_difference_alone_deg": float(np.degrees(angle(*(axis.vector for axis in recovered.separate)))),
        "rank_axes_apart": result.rank_apart,
        "axes_parallel_p_value": float(recovered.p_values[1]),
        "tracking_error_rad": recording.provenance["tracking_error_rad"],
        "noise": dict(recording.noise),
    }


def joint_summary(result: Study) -> dict[str, float | None]:
    """Key numbers of the joint estimates, which take longer than all the rest."""
    largest = {f"largest_error_{name}": model.largest_error for name, model in result.joint.items()}
    return largest | {"rms_z_full": result.joint["full"].rms_z}


def report_text(result: Study) -> str:
    """What the terminal shows."""
    numbers = summary(result)

    def condition(name: str) -> str:
        return f"{numbers[f'condition_number_{name}']:.4g} at {numbers[f'rows_{name}']}x{numbers[f'rank_{name}']}"

    def printed(number: float, shape: tuple[int, int]) -> str:
        return f" (paper: {number} at {shape[0]}x{shape[1]})"

    lines = (
        table_3(result).text(),
        table_3_full(result).text(),
        table_wrench_errors(result).text(),
        "Condition numbers",
        f"  simplified model: {condition('simplified')}"
        + printed(paper.CONDITION_NUMBER_SIMPLIFIED, paper.SHAPE_SIMPLIFIED),
        f"  full model, its own columns: {condition('full')}" + printed(paper.CONDITION_NUMBER_FULL, paper.SHAPE_FULL),
        f"    (what tells these columns apart is the tilt alone, {numbers['tilt_recovered_deg']:.3g} deg as recovered)",
        f"  full model, the table's names: {condition('full_on_table')}",
        "Recovered axes",
        f"  {numbers['axis_error_deg']:.3f} deg from the true ones, predicted standard deviation "
        f"{numbers['axis_std_deg']:.3f} deg;",
        f"  joint by joint {numbers['axis_difference_alone_deg']:.3f} deg apart (rank {result.rank_apart});",
        f"  a Wald test cannot tell that from parallel (p = {numbers['axes_parallel_p_value']:.2f}),",
        f"  so both joints were given one direction (rank {result.full.base.rank})",
    )
    return "\n".join(lines)


def results(result: Study) -> Results:
    """All tables, figures and the summary."""
    return Results(
        tables={
            "table_3": table_3(result),
            "table_3_full": table_3_full(result),
            "table_wrench_errors": table_wrench_errors(result),
        },
        figures={
            "figure_2": (figure_2(result), "Recovered wrench: simplified model red, full model blue, true black."),
            "figure_3": (
                figure_3(result),
                "Absolute error of the recovered wrench against the true, noise-free one, faint, and its running root "
                f"mean square over {WINDOW} samples: simplified red, full blue.",
            ),
        },
        numbers={"summary": summary(result) | {"joint": joint_summary(result)}},
    )


def run(args: argparse.Namespace) -> Results:
    """Runs the study and writes and prints its results."""
    choices = {key: getattr(args, key) for key in ("seed", "samples", "tilt_deg", "azimuth_deg", "noise_scale")}
    result = study(**choices)
    names = result.simplified.base.names
    plan = monte_carlo.Plan(
        scene={"name": SCENE, "tilt_deg": args.tilt_deg, "azimuth_deg": args.azimuth_deg},
        analyse=partial(trial, design()),
        names=names,
        published={m: [paper.TABLE_3[n][k] for n in names] for k, m in enumerate(("simplified", "full"))},
        joint=partial(joint_trial, design()),
        joint_model="full",
        remark="No predicted interval of the full model knows the errors of the recovered axes.",
    )
    return monte_carlo.conclude(args, choices, result.recording, plan, results(result), report_text(result))
