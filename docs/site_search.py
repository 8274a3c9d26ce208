"""Search in pages that are opened from a folder, where browsers refuse the plugin's worker and its requests."""

import json
from collections.abc import Sequence
from pathlib import Path

from mkdocs.config.defaults import MkDocsConfig

WORKER = "search/main.js"
"""The plugin's script, which starts a worker that requests the index."""

PERMALINK = "\\u00b6"
"""Sign of a heading's link to itself, as it is in JSON."""

SCRIPT = "js/search.js"
"""The theme's script, which loads the index as a script."""


def on_config(config: MkDocsConfig) -> MkDocsConfig:
    """Replaces the plugin's script by the theme's."""
    config.extra_javascript = [SCRIPT if str(script) == WORKER else script for script in config.extra_javascript]
    return config


def on_post_build(config: MkDocsConfig) -> None:
    """Writes the plugin's index as a script, and removes what the theme's script does without."""
    folder = Path(config.site_dir) / "search"
    index = json.loads((folder / "search_index.json").read_text(encoding="utf-8"))
    text = f"const searchEntries = {json.dumps(_once(index['docs']), separators=(',', ':'))};\n"
    (folder / "search_index.js").write_text(text.replace(PERMALINK, ""), encoding="utf-8")
    for name in ("search_index.json", "main.js", "worker.js"):
        (folder / name).unlink()


def _once(entries: Sequence[dict[str, str]]) -> list[dict[str, str]]:
    """The entries without the sections of pages' titles, which have the same words as their pages."""
    titles = {entry["location"]: entry["title"] for entry in entries}
    pages = [entry["location"].partition("#")[0] for entry in entries]
    return [x for x, page in zip(entries, pages, strict=True) if x["location"] == page or x["title"] != titles[page]]
