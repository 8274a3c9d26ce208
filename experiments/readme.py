"""Writes the generated parts of README.md: `python -m experiments.readme`, from the root of a checkout."""

import re
import sys
from pathlib import Path

from experiments import figures, misaligned, misaligned_study, multicontact, multicontact_study, report
from sim.atomic import replacing


def table_3(result: misaligned_study.Study) -> str:
    """Table III with our errors beside the paper's, in Markdown."""
    rows = misaligned.table_3(result).rows
    name, _, simplified, paper_simplified, _, full, paper_full = zip(*rows, strict=True)
    columns = {
        "parameter": name,
        "simplified, paper": paper_simplified,
        "simplified, ours": simplified,
        "full, paper": paper_full,
        "full, ours": full,
    }
    return report.Table("", *report.columns(**columns), decimals=2).markdown()


def table_4(result: multicontact_study.Study) -> str:
    """Table IV with our errors beside the paper's, in Markdown."""
    name, true_paper, true_scene, error, paper_error = zip(*multicontact.table_4(result).rows, strict=True)
    columns = {
        "parameter": name,
        "true, paper": true_paper,
        "true, scene": true_scene,
        "error, paper": paper_error,
        "error, ours": error,
    }
    footnote = multicontact.FOOTNOTE
    rows = report.columns(**columns)
    return report.Table("", *rows, decimals=2, marked=multicontact.DIFFERS, footnote=footnote).markdown()


def with_block(text: str, name: str, content: str) -> str:
    """The text with the part between `<!-- name -->` and `<!-- end name -->` replaced."""
    pattern = re.compile(rf"(<!-- {name} -->\n).*?(<!-- end {name} -->)", re.DOTALL)
    if not pattern.search(text):
        raise ValueError(f"README.md needs a block '<!-- {name} -->' that ends with '<!-- end {name} -->'.")
    return pattern.sub(lambda match: f"{match[1]}{content}{match[2]}", text)


def main() -> int:
    """Entry point; returns the exit code."""
    readme = Path("README.md")
    tilted, touching = misaligned_study.study(), multicontact_study.study()
    text = with_block(readme.read_text(encoding="utf-8"), "table 3", table_3(tilted))
    text = with_block(text, "table 4", table_4(touching))
    figures.save(misaligned.figure_2(tilted), Path("docs"), "figure_2", ["png"])
    with replacing(readme) as temporary:
        temporary.write_text(text, encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
