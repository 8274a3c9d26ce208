"""Notes to the user on models that can nevertheless be used."""

import warnings


class ModelNote(UserWarning):
    """A remark on a model; commands print it as a line of its own, once."""


def note(text: str) -> None:
    """Warns the user about a model."""
    warnings.warn(text, ModelNote, stacklevel=4)
