"""Self-contained HTML pages: templates filled with documents."""

import base64
import hashlib
import json
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from experiments.document import escape, figures
from experiments.document.document import Document
from experiments.document.symbols import pieces


def page(template: str, root: Path, shown: Mapping[str, Document], formats: Iterable[str], **values: object) -> str:
    """A page in one file, which runs only its own script and loads nothing.

    Args:
        template: File of the folder `templates`.
        root: Folder of the page.
        shown: Written documents by folder name in `root`; the empty name stands for `root` itself.
        formats: Formats of the figures.
        values: Other variables of the template.
    """

    def png(folder: str, name: str) -> str:
        drawn = root / folder / f"{name}.png"
        return base64.b64encode(drawn.read_bytes() if drawn.is_file() else _png(shown[folder], name)).decode()

    given = {"results": shown, "formats": sorted(set(formats)), "png": png}
    return _environment().get_template(template).render(**given, **values)


@cache
def _environment() -> Environment:
    """The templates; they are compiled at first use, which takes as long as filling them."""
    environment = Environment(
        loader=PackageLoader("experiments.document"),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_visible,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"pieces": pieces, "indented": _indented, "digest": _digest}
    return environment


def _png(document: Document, name: str) -> bytes:
    """A figure as PNG that was written in other formats only."""
    return figures.drawn(document.figures[name][0], "png")


def _visible(value: Any) -> Any:
    """A text without marks of writing direction; keeps the type of HTML texts."""
    return type(value)(escape.visible(value)) if isinstance(value, str) else value


def _digest(text: str) -> str:
    """Hash by which a page's content security policy names an allowed script or style."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _indented(content: Any) -> str:
    """Indented JSON."""
    return json.dumps(content, indent=1, ensure_ascii=False)
