"""Report on identifications of many logs: one table of all, failures by name, and the parameters over the logs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from experiments.data.batch import Outcome, spreads
from experiments.document import tabular
from experiments.document.document import Document
from experiments.document.result_folder import OUTPUTS as RESULTS
from ident.judgement.verdict import Outcome as Verdict

OUTPUTS = (*RESULTS, "batch.json")
"""Patterns of the files that it writes."""

TABLES = "table_logs", "table_parameters"
"""Its tables."""


def logs_table(outcomes: Sequence[Outcome]) -> tabular.Table:
    """Verdict, doubts and residuals of every log, or the sentence with which it failed."""
    return tabular.Table(
        "Logs, each identified by itself",
        *tabular.columns(
            log=[each.log for each in outcomes],
            verdict=[each.verdict or "failed" for each in outcomes],
            predicted=["" if each.error else _predicted(each) for each in outcomes],
            doubts=[", ".join(each.doubts) for each in outcomes],
            least_ratio=[min(each.ratios.values(), default=float("nan")) for each in outcomes],
            largest_ratio=[max(each.ratios.values(), default=float("nan")) for each in outcomes],
            cpu_s=[each.seconds for each in outcomes],
            results=[each.folder and f"{each.folder}/" for each in outcomes],
            error=[each.error for each in outcomes],
        ),
        heads={
            "predicted": "channels predicted",
            "least_ratio": "residual over signal, least",
            "largest_ratio": "largest",
            "cpu_s": "CPU time (s)",
        },
        decimals=2,
    )


def _predicted(outcome: Outcome) -> str:
    """Number of the channels that a log's estimate predicts, of those that count."""
    return f"{len(outcome.predicted)} of {len(outcome.predicted) + len(outcome.missed)}"


def parameters_table(outcomes: Sequence[Outcome]) -> tabular.Table:
    """Parameters over the logs that did not fail: mean, spread, and agreement with the logs' own deviations."""
    rows = spreads(outcomes)
    return tabular.Table(
        "Parameters over the logs, SI units",
        *tabular.columns(
            parameter=[each.name for each in rows],
            logs=[each.logs for each in rows],
            mean=[each.mean for each in rows],
            std_of_mean=[each.std for each in rows],
            between_logs=[each.between for each in rows],
            rms_z=[each.rms_z for each in rows],
        ),
        units=tuple(each.unit for each in rows),
        heads={"std_of_mean": "s.d. of the mean", "between_logs": "s.d. between logs", "rms_z": "RMS z"},
        notes=(
            "The mean is weighted by the inverse variances of the logs, which include the set-up's uncertainty and "
            "count as independent. RMS z is about one where the logs' own deviations are right, and less where the "
            "logs share an error of the set-up.",
        ),
    )


def document(model: Path, outcomes: Sequence[Outcome], provenance: dict[str, Any]) -> Document:
    """Tables of all logs and of the parameters over them.

    Args:
        model: The model's file.
        outcomes: What became of each log.
        provenance: Provenance of the results.
    """
    failed = [each for each in outcomes if each.error]
    counts = [f"{sum(each.verdict == word.value for each in outcomes)} {word.value}" for word in Verdict]
    return Document(
        f"{model.name}, identified from each of {len(outcomes)} logs",
        findings=[(f"{each.log} failed: {each.error}", True) for each in failed],
        lines=[f"{len(outcomes)} logs: {', '.join(counts)}, {len(failed)} failed."],
        heading="The logs",
        tables={TABLES[0]: logs_table(outcomes)}
        | ({TABLES[1]: parameters_table(outcomes)} if len(failed) < len(outcomes) else {}),
        numbers={"batch": {"logs": [each.to_dict() for each in outcomes]}, "provenance": provenance},
    )
