"""Tables and numbers of README.md and of docs agree with a fresh run."""

import json
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest
from shared_studies import packaged_study

import experiments
from docs.tools import benchmark
from docs.tools import pages as blocks
from experiments.data.simulated_study import summary
from experiments.reports import study_report

ROOT = Path(experiments.__file__).parents[1]
DOCS = ROOT / "docs"
pytestmark = pytest.mark.skipif(not DOCS.exists(), reason="only a checkout has docs")


def page(name):
    return (DOCS / name).read_text(encoding="utf-8")


def block(name, block):
    return re.search(rf"<!-- {block} -->\n(.*?)<!-- end {block} -->", page(name), re.DOTALL)[1]


def cells(markdown):
    return [[cell.strip() for cell in line.strip("| \n").split("|")] for line in markdown.strip().splitlines()]


@pytest.mark.parametrize(
    ("name", "table", "study"),
    [
        pytest.param("table 3", blocks.table_3, "misaligned", marks=pytest.mark.slow),
        ("table 4", blocks.table_4, "multicontact"),
    ],
)
def test_tables_are_not_stale(name, table, study):
    printed = cells(block("study.md", name))
    current = table(packaged_study(study))
    fresh = cells(current.markdown())
    assert [row[0] for row in printed] == [row[0] for row in fresh]
    assert printed[0] == fresh[0]
    # Other platforms may differ in the last bits, and round a half the other way.
    shown = np.array([row[1:] for row in printed[2:15]], float)
    exact = np.array([row[1:] for row in current.rows], float)
    np.testing.assert_allclose(shown, exact, atol=0.0051)


def test_condition_numbers_are_not_stale():
    text = page("study.md")
    tilted, touching = packaged_study("misaligned"), packaged_study("multicontact")
    for fit, published in (
        (tilted.fit("simplified"), "38.1"),
        (tilted.fit("full"), "334.2"),
        (touching.fit("contact"), "36.5"),
    ):
        assert f"{fit.estimate.condition_number:.1f} (paper {published})" in text.replace("\n", " ")


def test_errors_of_the_wrench_are_not_stale():
    study = packaged_study("misaligned")
    printed, fresh = cells(block("study.md", "wrench errors")), cells(blocks.table_wrench_errors(study).markdown())
    assert [re.sub(r"[\d.]+", "#", cell) for row in printed for cell in row] == [
        re.sub(r"[\d.]+", "#", cell) for row in fresh for cell in row
    ]
    for row, expected in zip(printed[2:], study_report.table(study, "table_wrench_errors").rows, strict=True):
        std, simplified, full = (np.array(re.findall(r"[\d.]+", cell), float) for cell in row[1:])
        np.testing.assert_allclose([*std, simplified[0], full[0]], expected[1:4], atol=0.0051)
        np.testing.assert_allclose([simplified[1], full[1]], 100 * np.array(expected[4:]), atol=0.51)
    share = {
        name: f"{100 * ratio:.0f} %" for name, *_, ratio, _ in study_report.table(study, "table_wrench_errors").rows
    }
    share["epsilon"] = (
        f"{study.fit('simplified').estimate.epsilon / np.linalg.norm(study.recording.wrench('ground').values):.1%}"
    )
    assert share["epsilon"] == "1.5%"
    for name in ("study.md", "reproduction.md"):
        quoted = page(name).replace("\n", " ")
        words = f"{share['Fx']} of F_x's standard deviation, {share['τy']} of τ_y's and {share['τz']} of τ_z's"
        assert words in quoted and "1.5 % of the wrench" in quoted


def test_the_benchmark_is_the_one_on_record():
    shown = block("speed.md", "benchmark")
    record = json.loads(page("benchmark.json"))
    assert shown == benchmark.markdown(record)
    assert record["machine"] in shown


@pytest.mark.skipif(
    int(mujoco.__version__.split(".")[0]) < 4, reason="the hand's weld twists otherwise before MuJoCo 4"
)
def test_numbers_of_two_contacts_are_not_stale():
    numbers = summary(packaged_study("multicontact", contact="pad handle"))
    condition, error = f"{numbers['condition_number']:.1f}", f"{numbers['largest_error']:.2f}"
    pad, hand, both = (f"{numbers[f'largest_error_ignoring{x}']:.1f}" for x in ("_pad", "_handle", ""))
    share = f"touches the pad in {100 * numbers['fraction_all_touch']:.0f} % of the samples"
    sentences = {
        "study.md": [
            f"{share}. The condition number is {condition}. The largest error is {error} ",
            f" {pad} without the pad's, {hand} without the hand's and {both} with the ground's alone",
        ],
        "reproduction.md": [
            f"up to {numbers['contact_handle_peak_force_N']:.0f} N, and link 2 {share}",
            f"up to {numbers['contact_pad_peak_force_N']:.0f} N; so both touch",
            f"| condition number | {condition} |",
            f"both measured | {error} |",
            f"are ignored | {pad}, {hand}, {both} |",
        ],
    }
    for name, expected in sentences.items():
        text = " ".join(page(name).split())
        assert [sentence for sentence in expected if sentence not in text] == []
