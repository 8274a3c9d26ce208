"""What users do wrong, in one sentence each; every other exception is a fault of this project."""

from collections.abc import Sequence


class InputError(ValueError):
    """Something given is not what is required: the message says what was, what arrived, and what would do."""


class ModelError(InputError):
    """A model or a mechanism is missing, malformed, lacks what is asked of it, or has what the equations do not."""


class LogError(InputError):
    """A recording or a mapping of its columns is missing, malformed, or does not fit the mechanism."""


class ExcitationError(InputError):
    """The motion does not separate some of the base parameters.

    Attributes:
        parameters: Names of those that cannot be told apart, as far as known.
    """

    def __init__(self, message: str, parameters: Sequence[str] = ()) -> None:
        super().__init__(message)
        self.parameters = tuple(parameters)
