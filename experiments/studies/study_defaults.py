"""Default entries for tables and figures of a study file."""

from collections.abc import Mapping, Sequence
from typing import Any

from experiments.data.study_file import Model

Entries = Mapping[str, Mapping[str, Any]]

ERRORS = "RMS errors of the recovered wrench, and their ratio to the s.d. of the true, noise-free one"
EPISODES = "Contacts: shares of the samples in which each touches, and touches alone, number of episodes, peak force"
"""Captions of tables."""

DRAWN_ERRORS = "Absolute error of the recovered wrench, every other sample of each model, and its running RMS."
RESIDUALS = "Measured total wrench less the predicted one."
CONTACTS = "Measured wrenches in the base frame that the links exert on what touches them."
"""Captions of figures."""


def usual(models: Mapping[str, Model], main: str | None) -> tuple[Entries, Entries]:
    """Default entries of tables and of figures by kind: captions, and the models with parameters of their own."""
    own = labelled([name for name, model in models.items() if model.parameters is None])
    tables: Entries = {
        "parameters": {"caption": ""},
        "wrench errors": {"caption": ERRORS, "models": list(own.values())},
        "contacts": {"caption": EPISODES},
    }
    figures: Entries = {
        "wrenches": {"caption": "", "curves": {"True": "true", **own}},
        "wrench errors": {"caption": DRAWN_ERRORS, "curves": own},
        "residuals": {"caption": RESIDUALS, "curves": {"Measured − predicted": main} if main else own},
        "contacts": {"caption": CONTACTS},
    }
    return tables, figures


def labelled(models: Sequence[str]) -> dict[str, str]:
    """Models by label: their names in words, or unchanged names if the words are not unique.

    >>> labelled(["full", "a_b", "a b"])
    {'Full': 'full', 'a_b': 'a_b', 'a b': 'a b'}
    """
    words = {name: name.replace("_", " ").capitalize() for name in models}
    said = list(words.values())
    return {words[name] if said.count(words[name]) == 1 else name: name for name in models}
