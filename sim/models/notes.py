"""What a user should know of a model that can be used all the same."""

import warnings


class ModelNote(UserWarning):
    """A remark on a model; commands print it as a line of its own, once."""


def note(text: str) -> None:
    """Tells the user about a model."""
    warnings.warn(text, ModelNote, stacklevel=4)
