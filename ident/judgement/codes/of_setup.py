"""Sentences on the set-up: its deviations from what is stated."""

from functools import partial

from ident.judgement.codes.row import Row
from ident.judgement.setup_findings import setup_sentence
from ident.setup import SETUP as KINDS


def _unexplained(changed: bool) -> str:
    taken = "nothing else of it was changed" if changed else "the set-up was taken as stated"
    return (
        f"No set-up near the stated one explains the recording, whose residuals are more than noise; {taken}. Check "
        "contacts, frames, units and the model."
    )


SETUP = {f"setup_{kind}": Row(partial(setup_sentence, kind), doubt=False) for kind in KINDS} | {
    "setup_unexplained": Row(_unexplained, doubt=True)
}
