"""The docs are true: their Python runs, their commands are accepted, and their names and links exist."""

import pkgutil
import re
import shlex
import tomllib
from pathlib import Path

import matplotlib.pyplot as plt
import pytest
from stand_ins import leave_undrawn, not_drawn, use_truth

import experiments
import scenes
import sim
from experiments import columns, identify, misaligned
from experiments.document import figures
from multicontact.__main__ import COMMANDS
from sim.motion.excitation import DOUBLE_PENDULUM

ROOT = Path(experiments.__file__).parents[1]
pytestmark = pytest.mark.skipif(not (ROOT / "docs").exists(), reason="only a checkout has docs")
PAGES = {path.name: path for path in sorted([*ROOT.glob("*.md"), *(ROOT / "docs").glob("*.md")])}
TEXTS = {name: path.read_text(encoding="utf-8") for name, path in PAGES.items()}


def blocks(language):
    codes_of = {name: re.findall(rf"```{language}\n(.*?)```", text, re.DOTALL) for name, text in TEXTS.items()}
    return {name: codes for name, codes in codes_of.items() if codes}


EXPECTED = {
    "README.md": r"m1 \+ m2 \+ m3.*Usable.*: held-out residuals.*tool +not determined \(0\.8\d to 4\.\d+\)",
    "identify.md": r"turned by 5\.\d+ ± 2\.\d+° about -z .*, ± 0\.00\d+° if the .* a turn of all joint axes about z",
    "python.md": r"± 0\.\d+   m2rz2 \+ 0\.425 m3",
    "models.md": r"\d bodies touch the floor.*sum of contacts - Y phi: \de-1[0-9]",
    "tables_and_figures.md": r"60 samples of .*ground_force",
    "long_recordings.md": "3000 samples, condition number 27",
}
"""Output of each page's examples, as a regular expression."""

SLOW = {name: pytest.mark.slow for name in ("python.md", "identify.md")}


@pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")
@pytest.mark.parametrize("page", [pytest.param(page, marks=SLOW.get(page, ())) for page in blocks("python")])
def test_examples_run(page, capsys, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "scenes").symlink_to(Path(scenes.__file__).parent)
    if page != "README.md":
        (tmp_path / "arm.xml").symlink_to(Path(scenes.__file__).parent / "double_pendulum.xml")
        sim.simulate(scenes.load("double_pendulum"), DOUBLE_PENDULUM).save("run.csv")
    reads_figures = page == "tables_and_figures.md"
    if reads_figures:
        monkeypatch.setattr(figures, "drawn", not_drawn)
        use_truth(monkeypatch)
        assert misaligned.main(["--samples", "60"]) == 0
    else:
        leave_undrawn(monkeypatch)
    for code in blocks("python")[page]:
        if "viewer" not in code:
            exec(compile(code, page, "exec"), {})
    if reads_figures:
        assert len(plt.gcf().axes) == 6 and {len(ax.lines) for ax in plt.gcf().axes} == {3}
        plt.close()
    assert re.search(EXPECTED.get(page, ""), capsys.readouterr().out, re.DOTALL)
    if page == "README.md":
        assert len(sim.mechanism("identified.xml", base="base").bodies) == 5
        guess, fit = (shlex.split(line, comments=True)[2:] for line in blocks("sh")[page][-1].splitlines())
        columns.main(guess)
        args = identify.parser().parse_args(fit)
        assert all(Path(path).exists() for path in (args.model, *args.logs, args.columns))


def commands():
    """Arguments of each command in shell blocks of the pages and of the tutorials' remarks, by the first word of it."""
    tutorials = (ROOT / "docs" / "tutorials").glob("*.py")
    remarks = {x.name: re.sub("^# ?", "", x.read_text(encoding="utf-8"), flags=re.MULTILINE) for x in tutorials}
    for name, text in (TEXTS | remarks).items():
        for line in "".join(re.findall(r"```sh\n(.*?)```", text, re.DOTALL)).replace("\\\n", "").splitlines():
            if match := re.match(r"(?:python -m experiments\.?|multicontact )(\w*)(.*)", line):
                yield pytest.param(match[1], shlex.split(match[2], comments=True), id=f"{name}: {line.split('  ')[0]}")


@pytest.mark.parametrize(("name", "arguments"), list(commands()))
def test_commands_are_accepted(name, arguments):
    COMMANDS[name or "paper"].parser().parse_args(arguments)


def without_code(text):
    return re.sub(r"```.*?```", "", text, flags=re.DOTALL)


def anchors(file):
    """Link targets of a page's headings, as renderers of Markdown form them."""
    headings = re.findall(r"^#+ (.*)$", without_code(file.read_text(encoding="utf-8")), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


def test_links_lead_somewhere():
    broken = []
    for name, text in TEXTS.items():
        for target in re.findall(r"\]\((?!http)([^)\s]+)\)", without_code(text)):
            path, _, anchor = target.partition("#")
            file = PAGES[name].parent / path if path else PAGES[name]
            if not file.exists() or (anchor and anchor not in anchors(file)):
                broken.append(f"{name}: {target}")
    assert broken == []


def test_what_the_pages_name_exists():
    named = "\n".join(text for name, text in TEXTS.items() if name != "CHANGELOG.md")
    rooms = re.findall(r"`((?:ident|sim|experiments|scenes|tests)/[\w/.]*)`", named)
    assert len(rooms) > 30 and [room for room in rooms if not (ROOT / room).exists()] == []
    missing = [name for name in re.findall(r"`((?:ident|sim)\.\w+(?:\.\w+)*)[`(]", named) if not resolves(name)]
    assert missing == []
    tests = "".join(path.read_text(encoding="utf-8") for path in (ROOT / "tests").rglob("*.py"))
    assert [name for name in re.findall(r"`(test_\w+)`", named) if f"def {name}(" not in tests] == []


def resolves(dotted):
    try:
        pkgutil.resolve_name(dotted)
    except (ImportError, AttributeError):
        return False
    return True


def test_every_column_has_a_head_and_the_first_page_is_short():
    """As a reader of a screen reader needs it."""
    found = {name: re.findall(r"^(\|.*\|)\n\|(?: *:?-+:? *\|)+$", text, re.M) for name, text in TEXTS.items()}
    heads = [(name, head) for name, each in found.items() for head in each]
    assert len(heads) > 50 and [each for each in heads if re.search(r"\| *\|", each[1])] == []
    assert len(TEXTS["README.md"].splitlines()) <= 150


NUMBERS = r"\d+(?:-\d+)?(?:(?:,| and)\s\d+(?:-\d+)?)*"


def numbers(text):
    """Numbers of a list such as `1-3, 5`."""
    ranges = ((int(a), int(b or a)) for a, b in re.findall(r"(\d+)(?:-(\d+))?", text))
    return {k for first, last in ranges for k in range(first, last + 1)}


def test_every_equation_has_functions_that_name_it():
    text = TEXTS["equations.md"].split("## Axes from poses")[0]
    _, *parts = re.split(rf"^Eqs?\. ({NUMBERS})", text, flags=re.MULTILINE)
    described = set()
    for listed, block in zip(parts[::2], parts[1::2], strict=True):
        names = re.findall(r"`(ident(?:\.\w+)+)`", block)
        described |= numbers(listed) if names else set()
        for name in names:
            mentions = re.findall(rf"Eqs?\.\s({NUMBERS})", pkgutil.resolve_name(name).__doc__)
            assert numbers(listed) <= set().union(*map(numbers, mentions)), name
    assert described == {*range(1, 19)}


def test_one_version_everywhere():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    cited = dict(re.findall(r"^(version|date-released): (\S+)$", citation, re.MULTILINE))
    newest, day = re.search(r"^## (\S+) \((\d{4}-\d\d-\d\d)\)$", TEXTS["CHANGELOG.md"], re.MULTILINE).groups()
    assert cited == {"version": version, "date-released": day} and newest == version


@pytest.mark.extras
def test_the_notebook_runs_and_shows_tables_figures_and_a_link(tmp_path):
    nbclient, nbformat = pytest.importorskip("nbclient"), pytest.importorskip("nbformat")
    for needed in ("ipykernel", "pandas"):
        pytest.importorskip(needed)
    notebook = nbformat.read(ROOT / "docs/notebooks/estimate.ipynb", as_version=4)
    assert not any(cell.get("outputs") for cell in notebook.cells)
    imports = re.findall(r"^(?:import|from) (\w+)", "\n".join(cell.source for cell in notebook.cells), re.MULTILINE)
    assert {*imports} <= {"multicontact", "pathlib"}
    nbclient.NotebookClient(notebook, timeout=300, resources={"metadata": {"path": str(tmp_path)}}).execute()
    outputs = [cell.outputs for cell in notebook.cells if cell.cell_type == "code"]
    shown = [{kind for out in each for kind in out.get("data", {})} for each in outputs]
    assert all("text/html" in shown[k] for k in (0, 1, 2, 5)) and all("image/png" in shown[k] for k in (3, 4))
    # One picture for each cell: figures are shown once.
    assert all(len(outputs[k]) == 1 for k in (3, 4))
    html = outputs[5][-1]["data"]["text/html"]
    assert '<a href="arm/report.html"' in html and (tmp_path / "arm" / "report.html").is_file()
