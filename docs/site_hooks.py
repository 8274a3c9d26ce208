"""Parts of the site beyond the pages of docs: files of the root, scripts with what they print, links and formulas."""

import contextlib
import io
import re
import tempfile
from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

import matplotlib
from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

import ident
import sim
from experiments import identify

DOCS = Path(__file__).parent
ROOT_PAGES = {
    "README.md": "overview.md",
    "CONTRIBUTING.md": "contributing.md",
    "CHANGELOG.md": "changelog.md",
    "paper.md": "paper.md",
    "CITATION.cff": "CITATION.cff",
}
TEMPLATES = DOCS.parent / "experiments" / "document" / "templates"
"""Templates of the pages of results, whose colours and pictures these pages have as well."""

EXAMPLE = "example"
"""Folder of the report that the first page shows: of the arm in README."""

GALLERY = "Each picture is drawn by the part of a script behind it, which runs when these pages are built."
"""Opening of the gallery."""

FORMULA = re.compile(r"(```.*?```|`[^`\n]+`)|\$\$(.+?)\$\$|\$(.+?)\$", re.DOTALL)
"""Code, which stays as it is, or a formula on lines of its own, or one within a line."""

EQUATIONS = "equations.md"
FUNCTIONS = "reference/equations.md"
"""Reference of the functions of equations that no front door has."""

NAME = r"`((?:ident|sim)(?:\.\w+)+)`"
ELSEWHERE = re.compile(rf"```.*?```|^#.*?$|\[[^\]]*\]\([^)]*\)|{NAME}", re.DOTALL | re.MULTILINE)
"""Code blocks, headings and links, which stay as they are, or a name."""

NUMBERS = r"\d+(?:-\d+)?(?:(?:,| and)\s\d+(?:-\d+)?)*"
MENTIONED = re.compile(rf"<(a|autoref|pre|code|h\d|math)\b.*?</\1>|\bEqs?\.\s{NUMBERS}", re.DOTALL)
"""HTML that stays as it is, or numbers of equations."""

PUBLIC = {f"{p.__name__}.{name}": f"{getattr(p, name).__module__}.{name}" for p in (ident, sim) for name in p.__all__}
"""Names in the modules that define them, by the names of the front doors."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Adds pages that are made from other files, and figures that their scripts draw."""
    pages: dict[str, str | bytes] = {page: _of_root(name) for name, page in ROOT_PAGES.items()}
    for package in (ident, sim):
        names = [f"::: {getattr(package, name).__module__}.{name}" for name in package.__all__]
        pages[f"reference/{package.__name__}.md"] = "\n\n".join([f"# {package.__name__}", *names])
    for script in sorted((DOCS / "tutorials").glob("*.py")):
        pages |= script_page(script)
    drawn = {script.stem: script_page(script) for script in sorted((DOCS / "gallery").glob("*.py"))}
    pages["gallery.md"] = gallery(drawn)
    pages["shared.css"] = (TEMPLATES / "shared.css").read_text(encoding="utf-8")
    pages["index.md"] = first_page()
    for name, each in drawn.items():
        pages |= each | {f"gallery/{name}.md": f"{each[f'gallery/{name}.md']}\n[All pictures](../gallery.md)\n"}
    pages[FUNCTIONS] = reference_of_equations(_equations(files))
    for name, content in pages.items():
        files.append(File.generated(config, name, content=content))
    return files


def on_post_build(config: MkDocsConfig) -> None:
    """Writes the report that the first page shows; among the files its tables in Markdown would become pages."""
    folder = Path(config.site_dir) / EXAMPLE
    folder.mkdir(exist_ok=True)
    for name, content in example().items():
        (folder / name).write_bytes(content)


@cache
def example() -> dict[str, bytes]:
    """Files of the report on README's arm, by name."""
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(io.StringIO()):
        files = [str(DOCS.parent / "scenes" / name) for name in ("arm.xml", "arm.csv")]
        identify.main([*files, "--base", "base", "--formats", "none", "--name", EXAMPLE, "--out", folder])
        return {path.name: path.read_bytes() for path in (Path(folder) / EXAMPLE).iterdir()}


def first_page() -> str:
    """The first page, with verdict and pictures of that report."""
    shown = re.findall(
        r'<p class="verdict.*?</p>|<div class="pictures">.*?</div>', example()["report.html"].decode(), re.DOTALL
    )
    return (DOCS / "index.md").read_text(encoding="utf-8").replace("<!-- report -->", "\n".join(shown))


def on_page_markdown(markdown: str, files: Files, **_: Any) -> str:
    """Links to scripts' pages and names of the reference, and writes formulas as MathML, shown without a script."""
    entries = PUBLIC | {name: name for name in (*PUBLIC.values(), *functions(_equations(files)))}

    def written(match: re.Match[str]) -> str:
        code, block, inline = match.groups()
        if block:  # which narrow screens scroll, by keys as well
            return convert(block, display="block").replace("<math", '<math tabindex="0"', 1)
        return code or convert(inline)

    def linked(match: re.Match[str]) -> str:
        name = match[1]
        return f"[`{name}`][{entries[name]}]" if name in entries else match[0]

    pages = re.sub(r"\]\(((?:tutorials|gallery)/\w+)\.py\)", r"](\1.md)", markdown)
    return ELSEWHERE.sub(linked, FORMULA.sub(written, pages))


def _equations(files: Files) -> str:
    """Text of the page of equations."""
    page = files.get_file_from_path(EQUATIONS)
    assert page is not None
    return page.content_string


def reference_of_equations(text: str) -> str:
    """Page of the functions that the equations name and no front door has."""
    names = [f"::: {name}" for name in functions(text) if name not in PUBLIC.values()]
    about = "One sample at a time, as the paper writes them, and rigid motions."
    return "\n\n".join(["# Functions of the equations", about, *names])


def script_page(script: Path) -> dict[str, str | bytes]:
    """The page of a script, remarks at the margin being its text, and its figures; it runs in a folder of its own."""
    matplotlib.use("Agg")
    from matplotlib import pyplot

    lines, files, names = [], {}, {"__name__": "__main__"}
    parts = re.split(r"((?:^#.*\n)+)", script.read_text(encoding="utf-8"), flags=re.MULTILINE)
    with tempfile.TemporaryDirectory() as folder, contextlib.chdir(folder):
        for part in parts:
            if part.startswith("#"):
                lines.append(re.sub(r"^# ?", "", part, flags=re.MULTILINE))
            elif part.strip():
                with contextlib.redirect_stdout(io.StringIO()) as printed, contextlib.redirect_stderr(io.StringIO()):
                    exec(compile(part, str(script), "exec"), names)
                lines.append(f"```python\n{part.strip()}\n```\n")
                if printed.getvalue():
                    lines.append(f"```text\n{printed.getvalue().rstrip()}\n```\n")
            for figure in pyplot.get_fignums():
                drawn, name = io.BytesIO(), f"{script.stem}_{len(files)}.png"
                pyplot.figure(figure).savefig(drawn, dpi=120)
                files[f"{script.parent.name}/{name}"] = drawn.getvalue()
                lines.append(f'<a id="figure-{len(files) - 1}"></a>\n')
                lines.append(f"![{pyplot.figure(figure).get_suptitle()}]({name})\n")
            pyplot.close("all")
    return {f"{script.parent.name}/{script.stem}.md": "\n".join(lines), **files}


def gallery(drawn: Mapping[str, Mapping[str, str | bytes]]) -> str:
    """A page with each script's pictures, and the title and sentence above each, which link to its place there."""
    cards = []
    for name, files in drawn.items():
        sections = re.findall(r"^## (.*)\n\n((?:.+\n)+)", str(files[f"gallery/{name}.md"]), re.MULTILINE)
        for k, (title, sentence) in enumerate(sections):
            link, picture = f'<a href="gallery/{name}.html#figure-{k}">', f"gallery/{name}_{k}.png"
            image = f'{link}<img src="{picture}" alt="{title}"></a>'
            cards.append(f"<figure>{image}<figcaption>{link}{title}</a><br>{sentence.strip()}</figcaption></figure>")
    return "\n".join(["# Gallery", "", GALLERY, "", '<div class="gallery">', *cards, "</div>", ""])


def _of_root(name: str) -> str:
    """A page of the root, with links as they are from docs."""
    text = (DOCS.parent / name).read_text(encoding="utf-8")
    text = text.replace("](docs/", "](").replace("](gallery/)", "](gallery.md)")
    for page, moved in ROOT_PAGES.items():
        text = text.replace(f"]({page}", f"]({moved}")
    return text


def on_page_content(html: str, page: Page, **_: object) -> str:
    """Gives each equation an anchor on its page, and links to it wherever another page mentions it."""
    if page.file.src_uri == EQUATIONS:
        return re.sub(rf"<p>(?=Eqs?\.\s({NUMBERS}))", lambda match: f"{_anchors(match[1])}<p>", html)
    to = "../" * page.url.count("/") + "equations.html#eq-"

    def linked(match: re.Match[str]) -> str:
        if match[1]:
            return match[0]
        return re.sub(r"(?:Eqs?\.\s)?(\d+)", lambda each: f'<a href="{to}{each[1]}">{each[0]}</a>', match[0])

    return MENTIONED.sub(linked, html)


def functions(text: str) -> list[str]:
    """Names of a package's functions in a page's text, once each."""
    return list(dict.fromkeys(re.findall(NAME, text)))


def _anchors(numbers: str) -> str:
    """An anchor for each equation of a list such as `1-3` or `15, 16`."""
    ranges = [(part[1], part[2] or part[1]) for part in re.finditer(r"(\d+)(?:-(\d+))?", numbers)]
    return "".join(f'<a id="eq-{k}"></a>' for first, last in ranges for k in range(int(first), int(last) + 1))
