"""Sentences on the set-up: its deviations from what is stated."""

from collections.abc import Sequence
from functools import partial

from ident.arguments import rpy_text
from ident.judgement.codes.row import Row
from ident.judgement.setup_findings import setup_sentence
from ident.setup import SETUP as KINDS


def _unexplained(changed: bool) -> str:
    taken = "nothing else of it was changed" if changed else "the set-up was taken as stated"
    return (
        "No set-up near the one that was stated explains the recording, though something is wrong beyond noise. "
        f"Look at contacts, frames, units and the model; {taken}."
    )


def _gravity(rpy_deg: Sequence[float], stated: float, misfit: float, joint: str | None) -> str:
    rpy, option = rpy_text(rpy_deg), " ".join(f"{angle:g}" for angle in rpy_deg)
    zero = "" if joint is None else f" Another zero of joint '{joint}' would look the same."
    return (
        f"Gravity has another direction than stated: the base is turned to roll, pitch and yaw {rpy}°. With it the "
        f"model leaves {misfit:.2f} of the measurements unexplained, as stated {stated:.2f}. Write rpy_deg = {rpy} "
        f"under [base] in the columns file, or --base-rpy {option}.{zero}"
    )


SETUP = {f"setup_{kind}": Row(partial(setup_sentence, kind), doubt=False) for kind in KINDS} | {
    "gravity_direction": Row(_gravity, doubt=True),
    "setup_unexplained": Row(_unexplained, doubt=True),
}
