"""Results of a study: the files that it writes, and the tables and figures of its page."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from matplotlib.figure import Figure

from experiments.document import figures, print_table, report
from experiments.document.layout import PAPER, Layout
from ident.errors import InputError
from ident.geometry.inertia import body_of_parameter


@dataclass(frozen=True, eq=False)
class Results:
    """Tables, figures and numbers by file name without suffix.

    Attributes:
        tables: Tables.
        figures: Figures and their captions.
        numbers: Contents of JSON files.
    """

    tables: Mapping[str, report.Table] = field(default_factory=dict)
    figures: Mapping[str, tuple[Figure, str]] = field(default_factory=dict)
    numbers: Mapping[str, dict[str, Any]] = field(default_factory=dict)

    def __or__(self, more: "Results") -> "Results":
        return Results(
            {**self.tables, **more.tables}, {**self.figures, **more.figures}, {**self.numbers, **more.numbers}
        )

    def chosen(self, layout: Layout) -> tuple[Layout, str]:
        """An author's choices, or none of them if one names a table, figure or parameter that does not exist.

        Returns:
            The layout, and a sentence if the choices cannot be applied, else an empty one.
        """
        of_bodies = [table for table in self.tables.values() if table.bodies]
        names = dict.fromkeys(
            str(row[0]) for t in of_bodies for row in t.rows if body_of_parameter(str(row[0]), t.bodies)
        )
        bodies = dict.fromkeys(body for table in of_bodies for body in table.bodies)
        try:
            layout.check([*self.tables, *self.figures], [*names], [*bodies])
        except InputError as error:
            return Layout(layout.columns), f"All is written, with captions and parameters as by default: {error}"
        return layout, ""

    def write(self, folder: Path, formats: Iterable[str], layout: Layout = PAPER) -> None:
        """Writes everything into a folder: figures in these formats, and tables in print by a layout."""
        formats = tuple(formats)
        for name, table in self.tables.items():
            table.write(folder, name, layout)
        for name, (figure, caption) in self.figures.items():
            figures.save(figure, folder, name, formats)
            if "pdf" in formats:
                width = float(figure.get_figwidth())
                content = print_table.figure(name, caption, width, layout)
                (folder / f"{name}.tex").write_text(content, encoding="utf-8")
        for name, numbers in self.numbers.items():
            report.write_json(folder / f"{name}.json", numbers)
