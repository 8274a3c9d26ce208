"""Links between the paper's equations and their functions, and from names in the text to the reference."""

import re

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from mkdocs.structure.pages import Page

import ident
import sim

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
    """Adds the reference of the equations' functions."""
    page = files.get_file_from_path(EQUATIONS)
    assert page is not None
    names = [f"::: {name}" for name in functions(page.content_string) if name not in PUBLIC.values()]
    text = "\n\n".join(
        ["# Functions of the equations", "One sample at a time, as the paper writes them, and rigid motions.", *names]
    )
    files.append(File.generated(config, FUNCTIONS, content=text))
    return files


def on_page_markdown(markdown: str, files: Files, **_: object) -> str:
    """Links names of the reference to their entries."""
    page = files.get_file_from_path(EQUATIONS)
    assert page is not None
    entries = PUBLIC | {name: name for name in (*PUBLIC.values(), *functions(page.content_string))}

    def linked(match: re.Match[str]) -> str:
        name = match[1]
        return f"[`{name}`][{entries[name]}]" if name in entries else match[0]

    return ELSEWHERE.sub(linked, markdown)


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
