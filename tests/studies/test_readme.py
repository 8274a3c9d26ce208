"""README's generated table is that of a fresh run, and its example runs."""

import json
import re
from pathlib import Path

import mujoco
import numpy as np
import pytest

import experiments
import scenes
import sim
from experiments.benchmark import words
from experiments.output import readme_blocks, tilted_axes_report
from experiments.output.contacts_report import summary
from experiments.studies import contacts, tilted_axes
from sim.motion.excitation import DOUBLE_PENDULUM

README = Path(experiments.__file__).parents[1] / "README.md"
pytestmark = pytest.mark.skipif(not README.exists(), reason="only a checkout has a README.md")


def cells(markdown):
    return [[cell.strip() for cell in line.strip("| \n").split("|")] for line in markdown.strip().splitlines()]


@pytest.mark.parametrize(
    ("name", "table", "study"),
    [
        ("table 3", readme_blocks.table_3, tilted_axes.study),
        ("table 4", readme_blocks.table_4, contacts.study),
    ],
)
def test_tables_are_not_stale(name, table, study):
    text = README.read_text(encoding="utf-8")
    printed = cells(re.search(rf"<!-- {name} -->\n(.*?)<!-- end {name} -->", text, re.DOTALL)[1])
    found = table(study())
    fresh = cells(found.markdown())
    assert [row[0] for row in printed] == [row[0] for row in fresh]
    assert printed[0] == fresh[0]
    # Other platforms may differ in the last bits, and round a half the other way.
    shown = np.array([row[1:] for row in printed[2:15]], float)
    exact = np.array([row[1:] for row in found.rows], float)
    np.testing.assert_allclose(shown, exact, atol=0.0051)


def test_condition_numbers_are_not_stale():
    text = README.read_text(encoding="utf-8")
    tilted, touching = tilted_axes.study(), contacts.study()
    for fit, published in ((tilted.simplified, "38.1"), (tilted.full, "334.2"), (touching.fit, "36.5")):
        assert f"{fit.estimate.condition_number:.1f} (paper {published})" in text.replace("\n", " ")


def test_errors_of_the_wrench_are_not_stale():
    study = tilted_axes.study()
    text = README.read_text(encoding="utf-8")
    printed = re.search(r"<!-- wrench errors -->\n(.*?)<!-- end wrench errors -->", text, re.DOTALL)[1]
    found, fresh = cells(printed), cells(readme_blocks.table_wrench_errors(study).markdown())
    assert [re.sub(r"[\d.]+", "#", cell) for row in found for cell in row] == [
        re.sub(r"[\d.]+", "#", cell) for row in fresh for cell in row
    ]
    for row, expected in zip(found[2:], tilted_axes_report.table_wrench_errors(study).rows, strict=True):
        std, simplified, full = (np.array(re.findall(r"[\d.]+", cell), float) for cell in row[1:])
        np.testing.assert_allclose([*std, simplified[0], full[0]], expected[1:4], atol=0.0051)
        np.testing.assert_allclose([simplified[1], full[1]], 100 * np.array(expected[4:]), atol=0.51)
    share = {name: f"{100 * ratio:.0f} %" for name, *_, ratio, _ in tilted_axes_report.table_wrench_errors(study).rows}
    share["epsilon"] = (
        f"{study.simplified.estimate.epsilon / np.linalg.norm(study.recording.wrench('ground').values):.1%}"
    )
    assert share["epsilon"] == "1.5%"
    for file in (README, README.parent / "REPRODUCTION.md"):
        quoted = file.read_text(encoding="utf-8").replace("\n", " ")
        words = f"{share['Fx']} of F_x's standard deviation, {share['τy']} of τ_y's and {share['τz']} of τ_z's"
        assert words in quoted and "1.5 % of the wrench" in quoted


def test_the_benchmark_is_the_one_on_record():
    text = README.read_text(encoding="utf-8")
    shown = re.search(r"<!-- benchmark -->\n(.*?)<!-- end benchmark -->", text, re.DOTALL)[1]
    record = json.loads((README.parent / "docs" / "benchmark.json").read_text(encoding="utf-8"))
    assert shown == words.readme_block(record)
    assert record["machine"]["processor"] in shown


def test_a_new_benchmark_takes_the_place_of_the_one_shown_unless_it_is_a_quick_one(tmp_path):
    def record(folder, processor, quick, commit="0123abc"):
        folder.mkdir(parents=True, exist_ok=True)
        content = {
            "machine": {"processor": processor},
            "provenance": {"options": {"quick": quick}, "git_commit": commit},
        }
        (folder / "benchmark.json").write_text(json.dumps(content))

    record(tmp_path / "docs", "shown", quick=False)
    assert readme_blocks.benchmark_results(tmp_path)["machine"]["processor"] == "shown"
    record(tmp_path / "results" / "benchmark", "new", quick=False)
    assert readme_blocks.benchmark_results(tmp_path)["machine"]["processor"] == "new"
    record(tmp_path / "results" / "benchmark", "new", quick=True)
    with pytest.raises(ValueError, match="without --quick"):
        readme_blocks.benchmark_results(tmp_path)
    record(tmp_path / "results" / "benchmark", "new", quick=False, commit="0123abc-dirty")
    with pytest.raises(ValueError, match="of a checkout with changes"):
        readme_blocks.benchmark_results(tmp_path)


@pytest.mark.skipif(
    int(mujoco.__version__.split(".")[0]) < 4, reason="the hand's weld twists otherwise before MuJoCo 4"
)
def test_numbers_of_two_contacts_are_not_stale():
    found = summary(contacts.study(contact="pad handle"))
    condition, error = f"{found['condition_number']:.1f}", f"{found['largest_error']:.2f}"
    pad, hand, both = (f"{found[f'largest_error_ignoring{x}']:.1f}" for x in ("_pad", "_handle", ""))
    share = f"touches the pad in {100 * found['fraction_all_touch']:.0f} % of the samples"
    sentences = {
        "README.md": [
            f"{share}. The condition number is {condition}. The largest error is {error} ",
            f" {pad} without the pad's, {hand} without the hand's and {both} with the ground's alone",
        ],
        "REPRODUCTION.md": [
            f"up to {found['contact_handle_peak_force_N']:.0f} N, and link 2 {share}",
            f"up to {found['contact_pad_peak_force_N']:.0f} N; so both touch",
            f"| condition number | {condition} |",
            f"both measured | {error} |",
            f"are ignored | {pad}, {hand}, {both} |",
        ],
    }
    for name, expected in sentences.items():
        text = " ".join((README.parent / name).read_text(encoding="utf-8").split())
        assert [sentence for sentence in expected if sentence not in text] == []


def test_a_block_is_replaced_and_a_missing_one_is_named():
    text = "a\n<!-- t -->\nold\n<!-- end t -->\nb"
    assert readme_blocks.with_block(text, "t", "new\n") == "a\n<!-- t -->\nnew\n<!-- end t -->\nb"
    with pytest.raises(ValueError, match="<!-- u -->"):
        readme_blocks.with_block(text, "u", "")


def test_the_examples_run(capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scenes").symlink_to(Path(scenes.__file__).parent)
    (tmp_path / "arm.xml").symlink_to(Path(scenes.__file__).parent / "double_pendulum.xml")
    sim.simulate(scenes.load("double_pendulum"), DOUBLE_PENDULUM).save("run.csv")
    examples = re.findall(r"```python\n(.*?)```", README.read_text(encoding="utf-8"), re.DOTALL)
    for code in examples:
        if "viewer" not in code:
            exec(compile(code, str(README), "exec"), {})
    printed = capsys.readouterr().out
    assert "m2rz2 + 0.425 m3" in printed and "Usable: held-out residuals" in printed
    assert len(sim.mechanism("arm_identified.xml", base="base").bodies) == 3
    assert re.search(r"'ground' is turned by 5\.0\d+ ± 0\.0\d+° about -z .* a turn of all joint axes about z", printed)
    assert "3000 samples, one pass in QR coordinates, 0 of 6 chunks by stacked QR" in printed
    assert re.search(r"sum of contacts - Y phi: \de-1[0-9]", printed)


def test_every_room_that_readme_names_exists():
    rooms = re.findall(r"`((?:ident|sim|experiments)/[\w/]*)`", README.read_text(encoding="utf-8"))
    assert len(rooms) > 10 and [room for room in rooms if not (README.parent / room).is_dir()] == []


def test_every_test_that_the_documents_name_exists():
    root = README.parent
    tests = "".join(path.read_text(encoding="utf-8") for path in (root / "tests").rglob("*.py"))
    for name in re.findall(r"`(test_\w+)`", (root / "REPRODUCTION.md").read_text(encoding="utf-8")):
        assert f"def {name}(" in tests, name
