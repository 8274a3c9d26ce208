"""One self-contained page with every table and figure beside the paper's numbers, from the files that studies wrote."""

import html
import json
from pathlib import Path
from typing import Any

from experiments.cli.defaults import REDRAWN
from experiments.output import page
from experiments.output.contacts_report import DIFFERS
from experiments.output.tilted_axes_report import WINDOW
from experiments.studies import paper
from ident.recordings.atomic import replacing

WHY = (
    "The paper prints neither its excitation nor its noise nor the direction of the tilt. Ours were fitted to its "
    "condition numbers and to the simplified column of Table III. Its five large errors agree in sign, and four of "
    "them to within 13 %; five of its eight small ones have the opposite sign.",
    "The full column of Table III is not reproduced: ours is better, and the cause is unknown.",
    "The paper's errors are absolute, although its text calls them relative: several true values are zero.",
    "Ixx2, Ixx3 and Ixz3 of Table IV belong to no rigid body: centre-of-mass inertias were put where inertias about "
    "the frame origins belong. The scene is physical, and differs by the parallel-axis terms.",
    "The noise levels are ours, and so are the pose sensors that the full model's axes are recovered from.",
)
"""Why our numbers differ from the printed ones."""


def write_index(results: Path) -> None:
    """Writes `results/index.html` from the folders of `python -m experiments` beside it.

    Args:
        results: Folder that holds the studies' results, figures among them as PNG.
    """
    folders = ("mechanism", "misaligned", "multicontact", "several_contacts")
    mechanism, misaligned, multicontact, several = (results / name for name in folders)
    parts = [
        f"<h1>{html.escape(paper.TITLE)}: reproduction</h1>",
        f"<p>The study of {html.escape(paper.AUTHORS)}, simulated in MuJoCo and identified anew. Every number of ours "
        "comes from the runs whose provenance stands at the end.</p>",
        "<h2>At a glance</h2>",
        _headline(_json(misaligned / "summary.json"), _json(multicontact / "summary.json")),
        "<h2>Why numbers differ</h2>",
        "<ul>" + "".join(f"<li>{page.prose(reason)}</li>" for reason in WHY) + "</ul>",
        "<h2>The mechanism</h2>",
        page.figure(
            mechanism / "figure_1.png",
            "Figure 1. The double pendulum (left) and its frames (right; x red, y green, "
            "z blue), drawn from the scene's geometry.",
        ),
        page.table(mechanism / "table_1.csv", "Table I, as printed: modified DH parameters"),
        page.table(mechanism / "table_2.csv", "Table II, from the scene: home poses and joint twists"),
        "<h2>Misaligned rotations (Section VI)</h2>",
        page.table(
            misaligned / "table_3.csv",
            "Table III. True base parameters and errors, kg, kg m and kg m²",
            {
                "deviation_simplified": ("error_simplified", "paper_error_simplified"),
                "deviation_full": ("error_full", "paper_error_full"),
            },
        ),
        page.table(misaligned / "table_3_full.csv", "The full model on its own columns"),
        page.figure(
            misaligned / "figure_2.png",
            "Figure 2. Recovered wrench: simplified model red, full model blue, true black.",
        ),
        page.figure(
            misaligned / "figure_3.png",
            "Figure 3. Absolute error of the recovered wrench against the true, noise-free one, faint, and its running "
            f"root mean square over {WINDOW} samples: simplified red, full blue.",
        ),
        page.table(misaligned / "table_wrench_errors.csv", "Errors of the recovered wrench (Figure 3) by channel"),
        *_monte_carlo(misaligned),
        "<h2>Multiple contacts (Section VII)</h2>",
        page.table(
            multicontact / "table_4.csv",
            "Table IV. True base parameters and errors, kg, kg m and kg m². The entries with an asterisk "
            "differ from the paper's by the parallel-axis terms.",
            {"deviation": ("error", "paper_error")},
            marked=DIFFERS,
        ),
        page.table(multicontact / "table_4_ignoring.csv", "The contact taken into account, and ignored"),
        page.figure(
            multicontact / "figure_4.png",
            "Figure 4. Measured ground wrench red, true total wrench blue, wrench recovered from the estimates black.",
        ),
        page.figure(multicontact / "figure_5.png", "Figure 5. Measured total wrench less the predicted one."),
        *_monte_carlo(multicontact),
        *_several_contacts(several),
        "<h2>Provenance</h2>",
        *(_provenance(folder / "provenance.json") for folder in (misaligned, multicontact, several)),
    ]
    with replacing(results / "index.html") as temporary:
        temporary.write_text(page.document(f"{paper.TITLE}: reproduction", parts), encoding="utf-8")


def _several_contacts(folder: Path) -> list[str]:
    """The study of contacts on different links."""
    found = _json(folder / "summary.json")
    return [
        "<h2>Several contacts at the same time (beyond the paper)</h2>",
        "<p>The paper has one contact besides the ground. Here a hand holds the first link all the time, and the "
        f"second one touches a pad in {100 * found['fraction_all_touch']:.0f} % of it. The condition number is "
        f"{found['condition_number']:.1f} ({found['rows']} × {found['rank']}), the largest error "
        f"{found['largest_error']:.2f}; ignoring the pad's wrench makes it {found['largest_error_ignoring_pad']:.1f}, "
        f"ignoring the hand's {found['largest_error_ignoring_handle']:.1f}, and ignoring both "
        f"{found['largest_error_ignoring']:.1f}.</p>",
        page.table(folder / "table_contacts.csv", "When each contact touches, as shares of the samples"),
        page.figure(
            folder / "figure_contacts.png",
            "Measured wrenches in the base frame that the links exert on the pad (green) and on the hand (orange).",
        ),
        page.table(
            folder / "table_4.csv",
            "True base parameters and errors, kg, kg m and kg m², beside those of Table IV",
            marked=DIFFERS,
        ),
        page.table(folder / "table_4_ignoring.csv", "All contacts taken into account, and some ignored"),
        page.figure(folder / "figure_4.png", "As Figure 4: measured ground, true total and recovered wrench."),
        page.figure(folder / "figure_5.png", "As Figure 5: measured total wrench less the predicted one."),
        *_monte_carlo(folder),
    ]


def _headline(misaligned: dict[str, Any], multicontact: dict[str, Any]) -> str:
    def row(what: str, ours: float, printed: float, shape: str) -> str:
        cells = (f"{printed:g}", f"{ours:.1f}", f"{100 * (ours / printed - 1):+.1f} %", shape)
        return f'<tr><td class="text">{what}</td>' + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>"

    def shape(found: dict[str, Any], suffix: str) -> str:
        return f"{found[f'rows{suffix}']} × {found[f'rank{suffix}']}"

    return (
        '<div class="scroll"><table><thead><tr><th class="text">condition number</th><th>paper</th><th>ours</th>'
        "<th>deviation</th><th>shape</th></tr></thead><tbody>"
        + row(
            "simplified model",
            misaligned["condition_number_simplified"],
            paper.CONDITION_NUMBER_SIMPLIFIED,
            shape(misaligned, "_simplified"),
        )
        + row(
            "full model", misaligned["condition_number_full"], paper.CONDITION_NUMBER_FULL, shape(misaligned, "_full")
        )
        + row(
            "contact at the end link",
            multicontact["condition_number"],
            paper.CONDITION_NUMBER_MULTICONTACT,
            shape(multicontact, ""),
        )
        + "</tbody></table></div>"
        f"<p>The joint axes were recovered to {misaligned['axis_error_deg']:.3f}°. Ignoring the contact raises the "
        f"largest error from {multicontact['largest_error']:.2f} to {multicontact['largest_error_ignoring']:.1f}.</p>"
    )


def _monte_carlo(folder: Path) -> list[str]:
    """Monte Carlo results, if the study ran trials."""
    if not (folder / "monte_carlo.json").exists():
        return []
    found = _json(folder / "monte_carlo.json")
    parts = [
        page.table(path, f"Errors of the {path.stem.removeprefix('monte_carlo_')} model over {found['trials']} trials")
        for path in sorted(folder.glob("monte_carlo_*.csv"))
    ]
    redrawn = REDRAWN[found["provenance"]["options"]["redrawn"]]
    caption = (
        f"Errors over {found['trials']} trials beside the predicted interval and the paper's single run. Drawn anew: "
        f"{redrawn}."
    )
    return [*parts, page.figure(folder / "figure_monte_carlo.png", caption)]


def _provenance(path: Path) -> str:
    return f"<pre>{html.escape(json.dumps(_json(path), indent=1, ensure_ascii=False))}</pre>"


def _json(path: Path) -> dict[str, Any]:
    return json.loads(path.read_text(encoding="utf-8"))
