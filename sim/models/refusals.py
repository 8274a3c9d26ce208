"""Conversion of MuJoCo's errors on models into `ModelError`."""

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco

from ident.errors import ModelError


@contextmanager
def refusals(source: object) -> Iterator[None]:
    """Turns MuJoCo's errors in a block into one line that begins with their source; the block should only call MuJoCo.

    Args:
        source: The model's file, or a name for a model without one.

    Raises:
        ModelError: MuJoCo cannot read or compile the model, or lacks memory.
    """
    try:
        yield
    except (ValueError, mujoco.FatalError, mujoco.UnexpectedError) as error:
        text = " ".join(str(error).split())
        raise ModelError(text if text.startswith(str(source)) else f"{source}: {text}") from None
