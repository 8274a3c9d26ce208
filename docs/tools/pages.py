"""Generated parts of README.md and of docs: tables of both studies, figures, the benchmark, and the example's log.

`python -m docs.tools.pages` writes them, from the root of a checkout.
"""

import json
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from docs.tools import benchmark, drawings, validation_blocks
from docs.tools.drawings import figure_benchmark, figure_estimator, result_picture, standalone
from experiments.data.simulated_study import SimulatedStudy, summary
from experiments.document import figures, result_folder, tabular
from experiments.reports import study_figures, study_report
from experiments.reports.validation_figures import held_out_figure, published_figure, summary_figure
from experiments.reports.validation_report import known_picture
from experiments.studies.simulation import study
from experiments.studies.validation.files import registry
from experiments.studies.validation.validation_study import study_of
from ident.errors import InputError
from ident.files.atomic import replacing

BENCHMARK = "benchmark.json"
"""Record of the benchmark."""


def table_3(result: SimulatedStudy) -> tabular.Table:
    """Table III with our errors beside the paper's, by least squares and by the trajectory estimate."""
    by_name = dict[str, Sequence[Any]]()
    for shown in (study_report.table(result, name) for name in ("table_3", "table_3_searched")):
        by_name |= dict(zip(shown.columns, zip(*shown.rows, strict=True), strict=True))
    columns = {"parameter": by_name["parameter"]}
    for model in ("simplified", "full"):
        columns |= {
            f"{model}, paper": by_name[f"paper_error_{model}"],
            f"{model}, ours": by_name[f"error_{model}"],
            f"{model}, trajectory": by_name[f"trajectory_error_{model}"],
        }
    columns["axes searched, trajectory"] = by_name["trajectory_error_searched"]
    return tabular.Table("", *tabular.columns(**columns), decimals=2)


def table_wrench_errors(result: SimulatedStudy) -> tabular.Table:
    """Errors of the recovered wrenches by channel, in brackets relative to the true wrench."""
    rows = []
    for (channel, errors), (_, unit) in zip(summary(result)["wrench_errors"].items(), figures.SYMBOLS, strict=True):
        shown = (f"{errors[f'rms_{m}']:.2f} ({100 * errors[f'ratio_{m}']:.0f} %)" for m in ("simplified", "full"))
        rows.append((f"{channel}, {unit}", errors["true_std"], *shown))
    columns = ("channel", "s.d. of the true wrench", "error, simplified", "error, full")
    return tabular.Table("", columns, tuple(rows), decimals=2)


def table_4(result: SimulatedStudy) -> tabular.Table:
    """Table IV with our errors beside the paper's, by least squares and by the trajectory estimate."""
    shown = study_report.table(result, "table_4")
    name, true_paper, true_scene, error, paper_error, trajectory, _ = zip(*shown.rows, strict=True)
    columns = {
        "parameter": name,
        "true, paper": true_paper,
        "true, scene": true_scene,
        "error, paper": paper_error,
        "error, ours": error,
        "error, trajectory": trajectory,
    }
    return tabular.Table("", *tabular.columns(**columns), decimals=2, marked=shown.marked, footnote=shown.footnote)


def benchmark_results(root: Path) -> dict[str, Any]:
    """The benchmark for docs/speed.md: a new one in `results`, or else the current one.

    Raises:
        InputError: It was made with `--quick`, or in a checkout with uncommitted changes.
    """
    made, shown = root / "results" / BENCHMARK, root / "docs" / BENCHMARK
    results = json.loads((made if made.exists() else shown).read_text(encoding="utf-8"))
    commit = str(results["provenance"]["git_commit"])
    if results["provenance"]["options"]["quick"] or (made.exists() and commit.endswith("-dirty")):
        raise InputError(f"docs/speed.md shows a whole benchmark of a commit; '{made}' is quick, or of changed files.")
    return results


def with_block(text: str, name: str, content: str) -> str:
    """The text with the part between `<!-- name -->` and `<!-- end name -->` replaced."""
    pattern = re.compile(rf"(<!-- {name} -->\n).*?(<!-- end {name} -->)", re.DOTALL)
    if not pattern.search(text):
        raise InputError(f"The page needs a block '<!-- {name} -->' that ends with '<!-- end {name} -->'.")
    return pattern.sub(lambda match: f"{match[1]}{content}{match[2]}", text)


def write(root: Path) -> None:
    """Writes the generated parts of the pages, the figures, the benchmark's record, and the log of README's example."""
    docs = root / "docs"
    if not ((root / "README.md").is_file() and docs.is_dir()):
        raise InputError(f"The root of a checkout has a README.md and a folder docs; '{root}' has not.")
    measured = benchmark_results(root)
    validated = validation_blocks.results(root)
    tilted, touching = study("misaligned"), study("multicontact")
    tables = {
        "table 3": table_3(tilted).markdown(),
        "wrench errors": table_wrench_errors(tilted).markdown(),
        "table 4": table_4(touching).markdown(),
    }
    _replace_blocks(docs / "study.md", tables)
    _replace_blocks(docs / "speed.md", {"benchmark": benchmark.markdown(measured)})
    write_validation(root, validated)
    with result_folder.results_folder(docs) as folder:
        figures.save(study_figures.figure(tilted, "figure_2"), folder, "figure_2", ["png"])
        figures.save(figure_benchmark(measured), folder, "benchmark", ["svg"])
        figures.save(figure_estimator(), folder, "estimator", ["svg"])
        (folder / "result.svg").write_text(result_picture(), encoding="utf-8")
        drawings.save_animation(study("multicontact", contact=drawings.CONTACT), folder / "mechanism.gif")
        result_folder.write_json(folder / BENCHMARK, measured)
    drawings.save_log(root / "scenes" / "arm.csv")


def write_validation(root: Path, numbers: dict[str, Any]) -> None:
    """Writes the record of a validation, its figures, and the parts of pages that show it."""
    shown = study_of(numbers, registry())
    _replace_blocks(root / "docs" / "validation.md", validation_blocks.page_blocks(shown))
    for name in ("README.md", "paper.md"):
        _replace_blocks(root / name, validation_blocks.summary_blocks(shown))
    with result_folder.results_folder(root / "docs") as folder:
        (folder / "validation_known.svg").write_text(standalone([known_picture(shown)], 520, 260), encoding="utf-8")
        figures.save(summary_figure(shown), folder, "validation", ["svg"])
        figures.save(held_out_figure(shown), folder, "validation_held_out", ["svg"])
        figures.save(published_figure(shown), folder, "validation_published", ["svg"])
        validation_blocks.write_record(folder / validation_blocks.FILE, numbers)


def _replace_blocks(page: Path, contents: Mapping[str, str]) -> None:
    """Replaces blocks of a page by name."""
    text = page.read_text(encoding="utf-8")
    for name, content in contents.items():
        text = with_block(text, name, content)
    with replacing(page) as temporary:
        temporary.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    write(Path())
