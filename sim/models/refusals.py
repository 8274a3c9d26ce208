"""What MuJoCo says of models that it refuses, as our errors."""

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco

from ident.errors import ModelError


@contextmanager
def refusals(source: object) -> Iterator[None]:
    """Turns MuJoCo's errors in a block, which should do nothing else, into one line that begins with their source.

    Args:
        source: The model's file, or what to call a model without one.

    Raises:
        ModelError: MuJoCo cannot read or compile the model, or has not the memory that it needs.
    """
    try:
        yield
    except (ValueError, mujoco.FatalError, mujoco.UnexpectedError) as error:
        text = " ".join(str(error).split())
        raise ModelError(text if text.startswith(str(source)) else f"{source}: {text}") from None
