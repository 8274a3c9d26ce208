"""Errors of input, with a sentence for the user; every other exception is a bug of this project."""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager


class InputError(ValueError):
    """Invalid input: the message says what is required, what was given, and what would do."""


class ModelError(InputError):
    """A model or mechanism is missing, malformed or incomplete, or has features that the equations do not support."""


class LogError(InputError):
    """A recording or a mapping of its columns is missing, malformed, or does not fit the mechanism."""


class ExcitationError(InputError):
    """The motion does not separate some of the base parameters.

    Attributes:
        parameters: Names of the parameters that cannot be separated, as far as known.
    """

    def __init__(self, message: str, parameters: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.parameters = tuple(parameters)


@contextmanager
def about(what: object) -> Iterator[None]:
    """Begins the messages of input errors in a block with what they are about, such as the path of a file."""
    try:
        yield
    except InputError as error:
        error.args = (f"{what}: {error}",)
        raise error from None


def not_installed(what: str, package: str, extra: str) -> str:
    """Clause that `what` needs a package, and how its extra is installed from the repository."""
    command = f'pip install -c constraints.txt -e ".[{extra}]"'
    return f"{what} needs the package '{package}', which the extra '{extra}' brings: {command}"
