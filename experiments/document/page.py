"""Self-contained HTML pages: templates filled with documents."""

import base64
import hashlib
import json
from collections.abc import Iterable, Mapping
from functools import cache
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from experiments.document import escape
from experiments.document.document import Document
from experiments.document.symbols import pieces

EMBEDDED = {"png": "image/png", "svg": "image/svg+xml"}
"""Formats of figures that a page can embed, the first of those that are written, and their media types."""


def page(template: str, root: Path, shown: Mapping[str, Document], formats: Iterable[str], **values: object) -> str:
    """A page in one file, which runs only its own script and loads nothing.

    Args:
        template: File of the folder `templates`.
        root: Folder of the page.
        shown: Written documents by folder name in `root`; the empty name stands for `root` itself.
        formats: Formats in which the figures are written. No figure is drawn again for the page: it embeds the file of
            one of these formats, and links to a figure that is written as PDF alone.
        values: Other variables of the template.
    """
    chosen = sorted(set(formats))
    embedded = next((ending for ending in EMBEDDED if ending in chosen), None)

    def picture(folder: str, name: str) -> str:
        if embedded is None:
            return ""
        content = (root / folder / f"{name}.{embedded}").read_bytes()
        return f"data:{EMBEDDED[embedded]};base64,{base64.b64encode(content).decode()}"

    given = {"results": shown, "formats": chosen, "picture": picture}
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


def _visible(value: Any) -> Any:
    """A text without marks of writing direction; keeps the type of HTML texts."""
    return type(value)(escape.visible(value)) if isinstance(value, str) else value


def _digest(text: str) -> str:
    """Hash by which a page's content security policy names an allowed script or style."""
    return "sha256-" + base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()


def _indented(content: Any) -> str:
    """Indented JSON."""
    return json.dumps(content, indent=1, ensure_ascii=False)
