"""Pages that hold everything they show: templates of HTML, filled with results."""

import base64
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from jinja2 import Environment, PackageLoader, StrictUndefined

from experiments.output import figures
from experiments.output.results import Results


def rendered(template: str, root: Path, shown: Mapping[str, Results], formats: Iterable[str], **values: object) -> str:
    """A page in one file.

    Args:
        template: File of the folder `templates`.
        root: Folder of the page.
        shown: Results by the names of their folders in `root`, or by an empty name those in `root` itself; they are
            written, with figures as PNG.
        formats: Formats of the figures.
        values: What else the template takes.
    """

    def png(folder: str, name: str) -> str:
        return base64.b64encode((root / folder / f"{name}.png").read_bytes()).decode()

    environment = Environment(
        loader=PackageLoader("experiments.output"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
    )
    environment.filters |= {"parameters": figures.PARAMETER.split, "indented": _indented}
    environment.globals |= {"results": shown, "formats": sorted(set(formats)), "png": png}
    return environment.get_template(template).render(values)


def _indented(content: Any) -> str:
    """JSON for readers."""
    return json.dumps(content, indent=1, ensure_ascii=False)
