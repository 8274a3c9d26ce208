"""Conversion of MuJoCo's errors on models into `ModelError`, and no log of its warnings."""

from collections.abc import Iterator
from contextlib import contextmanager

import mujoco

from ident.errors import ModelError


@contextmanager
def without_log() -> Iterator[None]:
    """Drops MuJoCo's warnings in a block, which it would append to a file MUJOCO_LOG.TXT in the working folder."""
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda text: None)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


@contextmanager
def refusals(source: object) -> Iterator[None]:
    """Turns MuJoCo's errors in a block into one line that begins with their source; the block should only call MuJoCo.

    Args:
        source: The model's file, or a name for a model without one.

    Raises:
        ModelError: MuJoCo cannot read or compile the model, or lacks memory.
    """
    try:
        with without_log():
            yield
    except (ValueError, mujoco.FatalError, mujoco.UnexpectedError) as error:
        text = " ".join(str(error).split())
        raise ModelError(text if text.startswith(str(source)) else f"{source}: {text}") from None
