"""Generated parts of README.md and of docs: tables of both studies, figures, the benchmark, and the example's log.

`python -m docs.tools.pages` writes them, from the root of a checkout.
"""

import html
import json
import re
from collections.abc import Iterable, Mapping, Sequence
from importlib.resources import files
from pathlib import Path
from textwrap import fill
from typing import Any

import numpy as np
from matplotlib.animation import PillowWriter
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D

import scenes
from docs.tools import benchmark, end_to_end
from docs.tools.noise import Case, filtered
from docs.tools.noise_conditions import CONDITIONS
from docs.tools.noise_recordings import save_log
from experiments.data.simulated_study import SimulatedStudy
from experiments.data.validation import WORSE, Study, inside
from experiments.document import figures, result_folder, tabular, typography
from experiments.reports import study_report
from experiments.reports import validation_tables as tables
from experiments.reports.identify_page import first_screen
from experiments.reports.validation_report import (
    STEEL,
    held_out_figure,
    known_picture,
    overview_lines,
    published_figure,
    summary_figure,
    truth_lines,
    worse_lines,
)
from experiments.studies.person_on_plates import USUAL
from experiments.studies.simulation import study
from experiments.studies.validation.files import registry
from experiments.studies.validation.validation_study import study_of
from ident import read_log
from ident.errors import InputError
from ident.files.atomic import replacing
from ident.identification import identify
from sim import mechanism

BENCHMARK = "benchmark.json"
"""Record of the benchmark."""

CONDITION = "person_half_degree"
"""A person who bows on a force plate, with angles measured to half a degree."""

JOINT = "hip"
SHOWN = (10.0, 16.0)
"""Times in the figure, s."""

CONTACT = "handle"
"""The contact in the animation: a hand at the end of the second link."""

WINDOW = (1.7, 7.7)
"""Times in the animation, s."""

GROUND, HAND, TOTAL, ESTIMATE = "C1", "C2", "black", "C0"


def table_3(result: SimulatedStudy) -> tabular.Table:
    """Table III with our errors beside the paper's, by least squares and by the trajectory estimate."""
    by_name = dict[str, Sequence[Any]]()
    for shown in (study_report.table(result, name) for name in ("table_3", "table_3_searched")):
        by_name |= dict(zip(shown.columns, zip(*shown.rows, strict=True), strict=True))
    columns = {"parameter": by_name["parameter"]}
    for model in ("simplified", "full"):
        for head, kind in (("paper", "paper_error"), ("ours", "error"), ("trajectory", "trajectory_error")):
            columns[f"{model}, {head}"] = by_name[f"{kind}_{model}"]
    columns["axes searched, trajectory"] = by_name["trajectory_error_searched"]
    return tabular.Table("", *tabular.columns(**columns), decimals=2)


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
    origins = [part["provenance"] for part in (results, results["end_to_end"])]
    changed = made.exists() and any(str(origin["git_commit"]).endswith("-dirty") for origin in origins)
    if changed or any(origin["options"]["quick"] for origin in origins):
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
    validated = validated_numbers(root)
    tilted, touching = study("misaligned"), study("multicontact")
    tables = {
        "table 3": table_3(tilted).markdown(),
        "tilts": study_report.table(tilted, "table_tilts").markdown(),
        "wrench errors": study_report.table(tilted, "table_wrench_errors").markdown(),
        "table 4": table_4(touching).markdown(),
    }
    _replace_blocks(docs / "study.md", tables)
    ways = end_to_end.markdown(measured["end_to_end"])
    _replace_blocks(docs / "speed.md", {"benchmark": benchmark.markdown(measured), "end to end": ways})
    write_validation(root, validated)
    with result_folder.results_folder(docs) as folder:
        figures.save(study_report.figure(tilted, "figure_2"), folder, "figure_2", ["png"])
        figures.save(benchmark.figure(measured), folder, "benchmark", ["svg"])
        figures.save(figure_estimator(), folder, "estimator", ["svg"])
        (folder / "result.svg").write_text(result_picture(), encoding="utf-8")
        save_animation(study("multicontact", contact=CONTACT), folder / "mechanism.gif")
        result_folder.write_json(folder / BENCHMARK, measured)
    save_log(root / "scenes" / "arm.csv")


def write_validation(root: Path, numbers: dict[str, Any]) -> None:
    """Writes the record of a validation, its figures, and the parts of pages that show it."""
    shown = study_of(numbers, registry())
    _replace_blocks(root / "docs" / "validation.md", page_blocks(shown))
    for name in ("README.md", "paper.md"):
        _replace_blocks(root / name, summary_blocks(shown))
    with result_folder.results_folder(root / "docs") as folder:
        (folder / "validation_known.svg").write_text(standalone([known_picture(shown)], 520, 260), encoding="utf-8")
        figures.save(summary_figure(shown), folder, "validation", ["svg"])
        figures.save(held_out_figure(shown), folder, "validation_held_out", ["svg"])
        figures.save(published_figure(shown), folder, "validation_published", ["svg"])
        write_record(folder / VALIDATION, numbers)


def _replace_blocks(page: Path, contents: Mapping[str, str]) -> None:
    """Replaces blocks of a page by name."""
    text = page.read_text(encoding="utf-8")
    for name, content in contents.items():
        text = with_block(text, name, content)
    with replacing(page) as temporary:
        temporary.write_text(text, encoding="utf-8")


VALIDATION = "validation.json"
"""Record of the shown run in docs."""

KNOWN = "Estimates less true values in half-widths of their 95 % intervals, by system"
"""Words for a picture."""


def validated_numbers(root: Path) -> dict[str, Any]:
    """Key numbers for docs/validation.md: those of `results/validate`, or else the current ones.

    Raises:
        InputError: They are of some recordings only.
    """
    made, shown = root / "results" / "validate" / "summary.json", root / "docs" / VALIDATION
    numbers = json.loads((made if made.exists() else shown).read_text(encoding="utf-8"))
    there = {*numbers["recordings"], *(each["entry"] for each in numbers["truths"].values())}
    if missing := [name for name, entry in registry().items() if entry.tried and name not in there]:
        raise InputError(
            f"docs/validation.md shows all recordings, but '{made}' has no {', '.join(missing)}: run it on all."
        )
    return dict(numbers)


def write_record(path: Path, numbers: dict[str, Any]) -> None:
    """Writes the numbers as JSON, a line for each recording."""
    rest = {key: value for key, value in numbers.items() if key != "recordings"}
    lines = [f"{json.dumps(name)}: {json.dumps(each)}" for name, each in numbers["recordings"].items()]
    text = ",\n".join(lines)
    with replacing(path) as temporary:
        temporary.write_text(f'{json.dumps(rest)[:-1]}, "recordings": {{\n{text}\n}}}}\n', encoding="utf-8")


def page_blocks(study: Study) -> dict[str, str]:
    """Contents of the blocks of docs/validation.md, by name."""
    shown = {
        "truth": tables.table_truth(study),
        "peers": tables.table_peers(study),
        "recordings": tables.table_recordings(study),
        "held out": tables.table_held_out(study),
        "published": tables.table_published(study),
        "steel": tables.table_steel(study.validations[STEEL]),
        "agreement": tables.table_agreement(study),
        "was published": tables.table_was_published(study),
    }
    registered = "".join(
        f"| `{entry.name}` | {typography.markdown(entry.title)} | {entry.source.repository} | "
        f"{entry.source.licence or 'not verified'} | {typography.markdown(entry.note)} |\n"
        for entry in study.untried
    )
    head = "| name | recording | repository | licence | what is missing |\n| --- | --- | --- | --- | --- |\n"
    texts = {name: table.markdown() for name, table in shown.items()}
    verdicts = "".join(f"<li>{html.escape(f'{each.entry.title}: {each.verdict}')}</li>\n" for each in study)
    worse = (tables.table_worse(study), tables.table_outside(study), tables.table_missed(study))
    shown_worse = [_list(worse_lines(study)), *(table.markdown() for table in worse if table.rows)]
    return {
        "known": f"**{truth_lines(study)[0]}**\n\n![{KNOWN}](validation_known.svg)\n",
        "sentences": _list(overview_lines(study)),
        "worse": "\n".join(shown_worse),
        # HTML, as Markdown within it is not read everywhere.
        "verdicts": f"<details><summary>Verdicts in words</summary>\n<ul>\n{verdicts}</ul>\n</details>\n",
        **texts,
        "untried": head + registered,
    }


def _list(lines: Sequence[str]) -> str:
    """List of sentences."""
    return "".join(f"- {typography.markdown(line)}\n" for line in lines)


def summary_blocks(study: Study) -> dict[str, str]:
    """Contents of the blocks of README.md and paper.md, by name: known parameters, and the main other numbers."""
    ratio, held = study.against_best, {kind: f"{100 * inside(z):.0f} %" for kind, z in study.trial_z.items()}
    best, worse = int((ratio <= 1).sum()), int((ratio > WORSE).sum())
    systems = len({each.entry.folder for each in study})
    text = (
        f"On {len(study.validations)} public recordings of {systems} systems, identified unattended, the estimate "
        f"predicts held-out data best in {best} of {len(ratio)} channels, and in {worse} it is worse by more than 5 % "
        "than the model as it came or least squares at the best of five cut-offs. Of the differences between "
        f"recordings of one system, {held['bodies']} of the bodies' and {held['friction']} of the frictions' are "
        "inside their 95 % intervals: friction changes from trial to trial. Where the verdict is 'unusable', "
        f"{held['unusable']} are."
    )
    return {name: f"{fill(each, 140)}\n" for name, each in (("known", truth_lines(study)[0]), ("validation", text))}


def result_picture() -> str:
    """Channels and parameters of the report on README's arm, as one SVG drawing in the colours of pages."""
    folder = Path(scenes.__file__).parent
    arm = mechanism(folder / "arm.xml", "base")
    return standalone([*first_screen(identify(arm, read_log(folder / "arm.csv", arm)))][:2], 360, 310)


def standalone(shown: Iterable[str], width: int, height: int) -> str:
    """Pictures of a page, each of this size, beside each other as one SVG drawing."""
    style = (files("experiments.document") / "templates" / "shared.css").read_text(encoding="utf-8")
    size = f'width="{width}" height="{height}" preserveAspectRatio="xMidYMin"'
    placed = [svg.replace("<svg ", f'<svg x="{(width + 30) * k}" {size} ') for k, svg in enumerate(shown)]
    head = f'<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 {(width + 30) * len(placed) - 30} {height}">'
    return f"{head}<style>{style} svg {{ background: var(--paper); }}</style>{''.join(placed)}</svg>\n"


def figure_estimator() -> Figure:
    """Accelerations of a joint by method over a few seconds, rad/s²."""
    case = Case.drawn(CONDITIONS[CONDITION], 0, 0)
    arm, recording = case.subject.mechanism, case.recording
    estimate = identify(arm, recording, offsets=False, holdout=0)
    k = arm.tree.joints.index(JOINT)
    curves = (
        (f"angles, low-passed at {USUAL:.0f} Hz", filtered(case, USUAL)[0], figures.Line("C1", 0.7)),
        ("motion that the servos follow", case.subject.commanded, figures.Line("black", 2.0)),
        ("trajectory estimate", estimate.prepared.samples.motion, figures.Line("C0", 1.2, "--")),
    )
    with figures.paper_style():
        figure = Figure(figsize=(6.4, 2.6))
        ax = figure.subplots()
        for label, motion, line in curves:
            ax.plot(recording.time, motion.ddq[:, k], color=line.color, lw=line.width, ls=line.style, label=label)
        ax.set(xlim=SHOWN, xlabel="Time (s)", ylabel=f"Acceleration of the {JOINT} (rad/s²)")
        ax.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
    return figure


def save_animation(result: SimulatedStudy, path: Path) -> None:
    """Writes a GIF of the mechanism from the side with its force arrows, beside the moment at the base over time.

    Args:
        result: The study with `CONTACT` alone.
        path: The file.
    """
    first, last = np.searchsorted(result.recording.time, WINDOW)
    per_second, points = 10, _points(result)
    writer = PillowWriter(per_second)
    # By Eq. 17 the total is the ground's wrench less the one that the link exerts on the hand.
    ground = result.recording.wrench("ground").values
    forces = np.stack([ground, result.measured.values - ground], axis=1)[..., 1:3]
    with figures.paper_style(), replacing(path) as temporary:
        figure = Figure(figsize=(6.4, 3.0), layout=ConstrainedLayoutEngine(h_pad=0.08))
        side, curves = figure.subplots(1, 2, width_ratios=(1, 1.3))
        cursor = _draw_curves(curves, result)
        with writer.saving(figure, temporary, dpi=100):
            for sample in range(int(first), int(last), round(result.recording.rate / per_second)):
                _draw_side(side, points[sample], forces[sample])
                cursor.set_xdata([result.recording.time[sample]] * 2)
                writer.grab_frame()
                # The layout is solved once, or the frames would jitter.
                figure.set_layout_engine("none")


def _points(result: SimulatedStudy) -> np.ndarray:
    """Both joints and the load cell in Y and Z of the base frame, m (N, 3, 2)."""
    tree = result.known.tree
    q, *_ = result.recording.noise_free.joint_states(tree.joints)
    poses = tree.poses(q)
    body, pose = result.known.sites[CONTACT]
    links = [tree.names.index(name) for name in ("link1", body)]
    cell = poses[:, links[1]] @ pose
    return np.stack([poses[:, links[0]], poses[:, links[1]], cell], axis=1)[..., 1:3, 3]


def _draw_side(ax: Axes, points: np.ndarray, forces: np.ndarray) -> None:
    """Draws one frame: the mechanism and an arrow for each force."""
    ax.clear()
    ax.set(xlim=(-0.75, 0.95), ylim=(-0.62, 1.15), aspect="equal")
    ax.set_axis_off()
    ax.plot([0, 0], [-0.45, -0.06], color="0.6", lw=8, solid_capstyle="butt")
    ax.plot(*points[:2].T, color="C0", lw=6, solid_capstyle="round")
    ax.plot(*points[1:].T, color="C4", lw=5, solid_capstyle="round")
    ax.plot(*points.T, "o", color="0.15", ms=6)
    for name, start, force, color, height in (
        ("ground", points[0], forces[0], GROUND, -0.6),
        ("hand", points[2], forces[1], HAND, -0.48),
    ):
        arrow = {"arrowstyle": "-|>,head_width=0.3", "color": color, "lw": 2.2, "shrinkA": 0, "shrinkB": 0}
        # 500 N are drawn a metre long.
        ax.annotate("", start + force / 500, start, arrowprops=arrow, annotation_clip=False)
        ax.text(0.2, height, f"{name}: {np.hypot(*force):.0f} N", color=color, fontsize=9)


def _draw_curves(ax: Axes, result: SimulatedStudy) -> Line2D:
    """Draws the moment about X over time, from the ground, with the hand, and predicted; returns the cursor."""
    component = 3
    time, (symbol, unit) = result.recording.time, figures.SYMBOLS[component]
    for label, wrench, line in (
        ("ground", result.recording.wrench("ground").values, figures.Line(GROUND, 1.0)),
        ("ground and hand", result.measured.values, figures.Line(TOTAL, 2.2)),
        (r"predicted, $Y\psi$", result.fit("contact").predicted, figures.Line(ESTIMATE, 1.2, "--")),
    ):
        ax.plot(time, wrench[:, component], color=line.color, lw=line.width, ls=line.style, label=label)
    ax.set(xlim=WINDOW, xlabel="Time (s)", ylabel=f"${symbol}$ ({unit})")
    ax.legend(loc="upper center", bbox_to_anchor=(0.5, 1.16), ncols=3, handlelength=1.4, columnspacing=1.0, fontsize=7)
    return ax.axvline(WINDOW[0], color="0.5", lw=1)


if __name__ == "__main__":
    write(Path())
