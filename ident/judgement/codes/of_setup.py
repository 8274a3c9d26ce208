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
        f"No set-up near the stated one explains the recording, whose residuals are more than noise; {taken}. Check "
        "contacts, frames, units and the model."
    )


def _gravity(rpy_deg: Sequence[float], stated: float, misfit: float, joint: str | None, moving: bool) -> str:
    rpy, option = rpy_text(rpy_deg), " ".join(f"{angle:g}" for angle in rpy_deg)
    of = "axes of the base's poses are" if moving else "base is"
    zero = "" if joint is None else f" Another zero of joint '{joint}' would look the same."
    return (
        f"Gravity has another direction than stated: the {of} turned to roll, pitch and yaw {rpy}°. With it the model "
        f"leaves {misfit:.2f} of the measurements unexplained, as stated {stated:.2f}. Write rpy_deg = {rpy} under "
        f"[base] in the columns file, or --base-rpy {option}.{zero}"
    )


def _late(of: str, delay: float, std: float, stated: float, misfit: float) -> str:
    how = "late behind" if delay > 0 else "early before"
    cure = f"Write delay = {abs(delay):.2g} under [setup] in the columns file, so that the estimate includes it"
    if of == "torques":
        cure = f"Log them in a file of their own, with constant = {-delay:.2g} for its times in the columns file"
    return (
        f"The {of} {'looks' if of == 'wrench' else 'look'} {1e3 * abs(delay):.0f} ± {1e3 * std:.0f} ms {how} the joint "
        f"angles. With that the model leaves {misfit:.2f} of the measurements unexplained, without it {stated:.2f}. "
        f"{cure}."
    )


SETUP = {f"setup_{kind}": Row(partial(setup_sentence, kind), doubt=False) for kind in KINDS} | {
    "gravity_direction": Row(_gravity, doubt=True),
    "channels_late": Row(_late, doubt=True),
    "setup_unexplained": Row(_unexplained, doubt=True),
}
