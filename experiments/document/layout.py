"""Layout of tables and figures in print: columns of the page, captions, and the parameters that are shown."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from ident.errors import InputError
from ident.geometry.inertia import body_of_parameter

WIDTHS = {1: (4.77, 4.77), 2: (3.486, 7.139)}
"""Width in inches of a column and of the text, on pages with one column (LaTeX's article) and with two (IEEEtran's, 252
and 516 pt, at 72.27 pt per inch)."""

HEIGHTS = {1: 6.7, 2: 8.6}
"""Largest height of figures on those pages, inches, with room for a caption."""


@dataclass(frozen=True)
class Layout:
    """A journal's page and an author's choices.

    Attributes:
        columns: Columns of the page.
        captions: Captions that replace the program's, by file name.
        parameters: Symbols of the parameters, or names of bodies, that tables and figures show; empty for all.
        brackets: True for standard deviations in brackets behind their estimates, `2.519(31)`.
    """

    columns: int = 2
    captions: Mapping[str, str] = field(default_factory=dict)
    parameters: tuple[str, ...] = ()
    brackets: bool = False

    def shows(self, parameter: str, bodies: Sequence[str]) -> bool:
        """True if a parameter is shown; bodies are numbered from 1."""
        return not self.parameters or bool({parameter, body_of_parameter(parameter, bodies)} & {*self.parameters})

    def check(self, files: Sequence[str], parameters: Sequence[str], bodies: Sequence[str]) -> None:
        """Checks that captions belong to written files, and that parameters exist.

        Raises:
            InputError: One does not; the sentence lists the choices.
        """
        for name in self.captions:
            if name not in files:
                raise InputError(f"--caption needs one of {', '.join(files)}, got '{name}'.")
        for name in self.parameters:
            if name not in (*parameters, *bodies):
                if not parameters:
                    raise InputError(
                        f"--parameters chooses parameters of bodies, but there are none here, got '{name}'."
                    )
                choices = f"parameters {', '.join(parameters)} or bodies {', '.join(bodies)}"
                raise InputError(f"--parameters needs {choices}, got '{name}'.")


PAPER = Layout()
"""The paper's own: two columns, everything shown."""
