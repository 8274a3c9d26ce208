"""Tables, numbers and the example's log of README.md and of docs agree with a fresh run, or with the run on record."""

import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import mujoco
import numpy as np
import pytest
from commands import entries_of
from shared_studies import packaged_study

import experiments
import ident
import scenes
import sim
from docs.tools import benchmark, end_to_end, noise_recordings
from docs.tools import pages as blocks
from docs.tools.noise_conditions import drives, truth
from experiments.data.simulated_study import summary
from experiments.reports import study_report
from experiments.studies.validation.files import registry
from experiments.studies.validation.validation_study import study_of
from ident.errors import InputError
from ident.geometry.inertia import parameters_from_com

ROOT = Path(experiments.__file__).parents[1]
DOCS = ROOT / "docs"
pytestmark = pytest.mark.skipif(not DOCS.exists(), reason="only a checkout has docs")


def page(name):
    return (DOCS / name).read_text(encoding="utf-8")


def words(name):
    return " ".join(page(name).split())


def block(name, block):
    return re.search(rf"<!-- {block} -->\n(.*?)<!-- end {block} -->", page(name), re.DOTALL)[1]


def cells(markdown):
    return [[cell.strip() for cell in line.strip("| \n").split("|")] for line in markdown.strip().splitlines()]


def assert_shown(printed, exact, atol):
    """Numbers of a printed table are rounded ones; platforms differ in the last bits and round halves otherwise."""
    np.testing.assert_allclose(np.array(printed, float), np.array(exact, float), atol=atol)


def test_tables_are_not_stale():
    misaligned, multicontact = packaged_study("misaligned", seed=0), packaged_study("multicontact", contact="pad")
    for name, current in {"table 3": blocks.table_3(misaligned), "table 4": blocks.table_4(multicontact)}.items():
        printed, fresh = cells(block("study.md", name)), cells(current.markdown())
        assert [row[0] for row in printed] == [row[0] for row in fresh] and printed[0] == fresh[0]
        assert_shown([row[1:] for row in printed[2:15]], [row[1:] for row in current.rows], 0.0051)
    for name in ("tilts", "wrench errors"):
        printed, current = (
            cells(block("study.md", name)),
            study_report.table(misaligned, f"table_{name.replace(' ', '_')}"),
        )
        # Title, heads and their rule, before the rows with names and perhaps units.
        assert printed[:4] == cells(current.markdown())[:4]
        assert_shown(
            [row[1 - len(current.columns) :] for row in printed[4:]], [row[1:] for row in current.rows], 5.1e-4
        )


def test_numbers_of_both_studies_are_not_stale():
    tilted, touching = packaged_study("misaligned", seed=0), packaged_study("multicontact", contact="pad")
    fits = tilted.fit("simplified"), tilted.fit("full"), touching.fit("contact")
    for fit, published in zip(fits, ("38.1", "334.2", "36.5"), strict=True):
        assert f"{fit.estimate.condition_number:.1f} (paper {published})" in words("study.md")
    rows = study_report.table(tilted, "table_wrench_errors").rows
    share = {name: f"{100 * ratio:.0f} %" for name, *_, ratio, _, _ in rows}
    whole = fits[0].estimate.epsilon / np.linalg.norm(tilted.recording.wrench("ground").values)
    for name in ("study.md", "reproduction.md"):
        quoted = f"{share['Fx']} of F_x's standard deviation, {share['τy']} of τ_y's and {share['τz']} of τ_z's"
        assert quoted in words(name) and f"{100 * whole:.1f} % of the wrench" in words(name)


def test_the_benchmark_is_the_one_on_record():
    record = json.loads(page("benchmark.json"))
    assert block("speed.md", "benchmark") == benchmark.markdown(record)
    assert block("speed.md", "end to end") == end_to_end.markdown(record["end_to_end"])
    assert [row["way"] for row in record["end_to_end"]["rows"]] == [way.name for way in end_to_end.WAYS]


def ways_measured(folder, monkeypatch, ways):
    monkeypatch.setattr(end_to_end, "WAYS", ways)
    benchmark.main(["--end-to-end", "--quick", "--out", str(folder / "benchmark.json")])
    record = json.loads((folder / "benchmark.json").read_text(encoding="utf-8"))
    assert record["rows"] == json.loads(page("benchmark.json"))["rows"]
    return record["end_to_end"]["rows"]


def test_ways_that_are_not_installed_or_fail_are_named(tmp_path, monkeypatch, capsys):
    weighted, peer = end_to_end.WAYS[1], end_to_end.WAYS[3]
    absent, failing = replace(peer, packages=("absent",)), replace(weighted, name="failing", arguments=("absent",))
    made, failed = ways_measured(tmp_path, monkeypatch, (weighted, absent, failing))
    assert made["ratio"] == 1 and 0 < made["torques"] < 0.3 and 20 < made["megabytes"] < 1000
    printed = capsys.readouterr().out
    assert f"{peer.name} is not compared with" in printed and printed.count("No module named absent") == 1
    assert "No module named absent" in failed["failure"]
    beside_failure = end_to_end._row_of(weighted, [made], [failed], SimpleNamespace(errors=lambda _: {}))
    assert beside_failure["seconds"] == made["seconds"] and np.isnan(beside_failure["ratio"])


@pytest.mark.extras
def test_other_software_finds_the_parameters(tmp_path, monkeypatch):
    for name in ("pinocchio", "casadi", "figaroh"):
        pytest.importorskip(name)
    rows = ways_measured(tmp_path, monkeypatch, end_to_end.WAYS[3:6])
    assert [row["torques"] < bound for row, bound in zip(rows, (0.03, 0.01, 0.5), strict=True)] == [True] * 3


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
        assert [sentence for sentence in expected if sentence not in words(name)] == []


@pytest.fixture(scope="module")
def shown():
    return study_of(json.loads(page(blocks.VALIDATION)), registry())


def test_pages_show_the_run_on_record(shown):
    for name, content in blocks.page_blocks(shown).items():
        assert block("validation.md", name) == content, name
    for name, content in blocks.summary_blocks(shown).items():
        for page in ("README.md", "paper.md"):
            text = (ROOT / page).read_text(encoding="utf-8")
            assert f"<!-- {name} -->\n{content}<!-- end {name} -->" in text, (page, name)


@pytest.mark.usefixtures("undrawn")
def test_a_new_run_takes_the_place_of_the_one_shown_unless_recordings_are_missing(tmp_path):
    numbers, summary, record = json.loads(page(blocks.VALIDATION)), "results/validate/summary.json", tmp_path / "docs"
    for name in ("docs/validation.md", "README.md", "paper.md"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(ROOT / name, tmp_path / name)
    (tmp_path / summary).parent.mkdir(parents=True)
    blocks.write_record(record / blocks.VALIDATION, numbers)
    assert blocks.validated_numbers(tmp_path) == numbers
    changed = {**numbers, "recordings": {name: {**x, "seconds": 1.0} for name, x in numbers["recordings"].items()}}
    (tmp_path / summary).write_text(json.dumps(changed), encoding="utf-8")
    blocks.write_validation(tmp_path, blocks.validated_numbers(tmp_path))
    assert entries_of(record / blocks.VALIDATION) == changed and (record / "validation.svg").exists()
    del changed["recordings"]["walker"]
    (tmp_path / summary).write_text(json.dumps(changed), encoding="utf-8")
    with pytest.raises(InputError, match="has no walker: run it on all"):
        blocks.validated_numbers(tmp_path)


SCENES = Path(scenes.__file__).parent


@pytest.fixture(scope="module")
def arm():
    return sim.mechanism(SCENES / "arm.xml", base="base")


@pytest.fixture(scope="module")
def estimate(arm):
    return ident.identify(arm, ident.read_log(SCENES / "arm.csv", arm))


@pytest.mark.slow
def test_the_log_is_made_anew(tmp_path):
    """To a few units of the last decimal, since simulations of other platforms differ in the last bits."""
    noise_recordings.save_log(tmp_path / "arm.csv")
    shipped = (SCENES / "arm.csv").read_text(encoding="utf-8").splitlines()
    made = (tmp_path / "arm.csv").read_text(encoding="utf-8").splitlines()
    assert shipped[0] == made[0] and len(shipped) == len(made) == 1 + 12 * 100
    a, b = (np.loadtxt(lines[1:], delimiter=",") for lines in (shipped, made))
    np.testing.assert_allclose(a, b, atol=0.021, rtol=0)
    np.testing.assert_allclose(a[:, 1:5], b[:, 1:5], atol=2.1e-5, rtol=0)
    assert (SCENES / "arm.csv").stat().st_size < 200_000


@pytest.mark.slow
def test_its_estimate_is_usable_and_its_intervals_cover_the_truth(arm, estimate):
    assert estimate.verdict().usable and not estimate.setup
    loaded = arm.known.copy()
    inertia = 0.4 * noise_recordings.BALL * noise_recordings.RADIUS**2 * np.eye(3)
    loaded[-10:] += parameters_from_com(noise_recordings.BALL, np.array(noise_recordings.PLACE), inertia)
    true = truth(estimate.fit.equations, loaded, drives(arm, scenes.load("arm").compile()))
    error = abs(estimate.fit.values[: len(true)] - true)
    assert len(true) > 35 and (error < 1.96 * estimate.fit.std[: len(true)]).mean() > 0.9
    assert (error < 1.96 * np.sqrt(np.diag(estimate.covariance_setup))[: len(true)]).all()


@pytest.mark.slow
def test_the_load_is_in_the_updated_tool_with_the_interval_of_readme(arm, estimate):
    consistent = estimate.consistent()
    *others, tool = consistent.phi[::10]
    assert tool == pytest.approx(0.8 + noise_recordings.BALL, abs=0.05)
    assert others == pytest.approx(arm.known[:-10:10], rel=0.05)
    text = (SCENES.parent / "README.md").read_text(encoding="utf-8")
    low, high = re.search(r"the tool has ([\d.]+) to ([\d.]+) kg", text).groups()
    assert (float(low), float(high)) == pytest.approx(tuple(consistent.intervals[-1][0]), abs=0.0051)
