"""Tables and figures of a study file: their kinds, what they show by default, and checks of their entries."""

import re
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from experiments.data.study_file import Display, Scene, StudyModel
from ident.errors import InputError
from ident.files.schema import check_keys, choice, made, table, value_of
from ident.files.table import short

Entries = Mapping[str, Mapping[str, Any]]
"""Entries by kind or file name."""

QUANTITIES = (
    *("true", "true_scene", "true_paper", "estimated", "error", "std_wrench_noise", "paper_error", "regrouping"),
    *("estimated_weighted", "error_weighted", "std_weighted"),
    *("trajectory_estimated", "trajectory_error", "trajectory_std"),
)
"""Quantities of a model that a column of a parameter table can show."""

TABLES = {
    "parameters": ("groups", "marked", "footnote", "decimals"),
    "wrench errors": ("models", "decimals"),
    "contacts": ("decimals",),
}
"""Entries of each kind of table, beside `kind` and `caption`."""

FIGURES = {"wrenches": ("curves",), "wrench errors": ("curves",), "residuals": ("curves",), "contacts": ()}
"""Entries of each kind of figure, beside `kind` and `caption`."""

WRENCHES = ("true", "measured", "ground")
"""Curves of wrenches besides those of models: the true and the measured total, and the ground's."""

ERRORS = "RMS errors of the recovered wrench, and their ratio to the s.d. of the true, noise-free one"
EPISODES = "Contacts: shares of the samples in which each touches, and touches alone, number of episodes, peak force"
"""Captions of tables."""

DRAWN_ERRORS = "Absolute error of the recovered wrench, every other sample of each model, and its running RMS."
RESIDUALS = "Measured total wrench less the predicted one."
CONTACTS = "Measured wrenches in the base frame that the links exert on what touches them."
"""Captions of figures."""


def usual(models: Mapping[str, StudyModel], main: str | None) -> tuple[Entries, Entries]:
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


def parameter_tables(models: Mapping[str, StudyModel]) -> dict[str, dict[str, Any]]:
    """Entries of tables of all parameters, for a file without tables: one for each set of base parameters.

    A model is in the table of the one whose parameters it shares. Tables are called `table_parameters` if there is one,
    else they have the model's name too, or a number where names differ in punctuation only.
    """
    own = {name: _owner(name, models) for name in models}
    owners = list(dict.fromkeys(own.values()))
    names = [re.sub(r"[^A-Za-z0-9]+", "_", name).strip("_") for name in owners]
    ends = names if len({name.casefold() for name in names}) == len(names) and all(names) else range(1, len(names) + 1)
    tables = {}
    for end, owner in zip(ends, owners, strict=True):
        members = [name for name in models if own[name] == owner]
        tables[f"table_parameters_{end}" if len(owners) > 1 else "table_parameters"] = {
            "caption": f"Base parameters ({', '.join(models[name].title for name in members)})",
            "groups": [{"model": name, "show": _usual_quantities(models[name])} for name in members],
        }
    return tables


def _owner(name: str, models: Mapping[str, StudyModel]) -> str:
    """Model whose base parameters one has: itself, or the one whose parameters it shares."""
    shared = models[name].parameters
    return name if shared is None else _owner(shared, models)


def _usual_quantities(model: StudyModel) -> list[str]:
    """Quantities of a model that a table shows by default."""
    weighted = "weighted" in model.estimators[1:]
    return [
        *("true", "true_paper", "estimated", "error", "std_wrench_noise", "paper_error"),
        *(("estimated_weighted", "std_weighted") if weighted else ()),
        *(("trajectory_estimated", "trajectory_std") if "trajectory" in model.estimators else ()),
    ]


def estimator_of(quantity: str) -> str:
    """Estimator that a quantity belongs to: `trajectory`, `weighted`, or empty for the model's first."""
    return "trajectory" if quantity.startswith("trajectory_") else "weighted" if quantity.endswith("_weighted") else ""


def labelled(models: Sequence[str]) -> dict[str, str]:
    """Models by label: their names in words, or unchanged names if the words are not unique.

    >>> labelled(["full", "a_b", "a b"])
    {'Full': 'full', 'a_b': 'a_b', 'a b': 'a b'}
    """
    words = {name: name.replace("_", " ").capitalize() for name in models}
    labels = list(words.values())
    return {words[name] if labels.count(words[name]) == 1 else name: name for name in models}


def shown(
    what: str,
    entries: Mapping[str, Any],
    kinds: Mapping[str, Sequence[str]],
    models: Mapping[str, StudyModel],
    scene: Scene,
    defaults: Entries,
) -> dict[str, Display]:
    """Tables or figures by file name.

    Args:
        what: `tables` or `figures`.
        entries: The entries of these.
        kinds: Entries of each kind, beside `kind` and `caption`.
        models: The study's models.
        scene: Its scene.
        defaults: Entries that stand for missing ones, by kind.
    """
    displays = {}
    for name, value in table(f"[{what}]", entries).items():
        where, entry = f"{what}.{name}", table(f"{what}.{name}", value)
        if not name.replace("_", "").isalnum() or not name.startswith(what.removesuffix("s")):
            raise InputError(f"{where}: names of files here begin with {what[:-1]}_, letters and digits follow.")
        kind = choice(f"{where}.kind", entry.get("kind", next(iter(kinds))), kinds)
        check_keys(where, entry, ("kind", "caption", *kinds[kind]))
        display = made(Display, where, {**defaults[kind], **entry, "kind": kind})
        if kind == "contacts" and not scene.contacts:
            raise InputError(f"{where} shows contacts, but [scene] has none.")
        # The first entry of a kind is its content, and must not be empty.
        if (content := next(iter(kinds[kind]), "decimals")) != "decimals" and not getattr(display, content):
            raise InputError(f"{where} needs {content}.")
        for group in display.groups:
            _check_group(where, group, models)
        several(f"{where}.models", list(display.models), models)
        for label, curve in display.curves.items():
            choice(f"{where}.curves.{label}", curve, (*models, *(WRENCHES if kind == "wrenches" else ())))
        displays[name] = display
    return displays


def several(where: str, value: Any, choices: Collection[str]) -> tuple[str, ...]:
    """The list as a tuple, if all are different and among the choices.

    Raises:
        InputError: They are not.
    """
    if not isinstance(value, list) or len({str(x) for x in value}) < len(value):
        raise InputError(f"{where} needs a list of different ones of {', '.join(choices)}, got {short(value)}.")
    return tuple(choice(where, each, choices) for each in value)


def _check_group(where: str, group: Mapping[str, Any], models: Mapping[str, StudyModel]) -> None:
    check_keys(f"{where}.groups", group, ("model", "as", "show"))
    model = models[choice(f"{where}.groups.model", group.get("model"), models)]
    value_of(f"{where}.groups.as", group.get("as", ""), str)
    for quantity in several(f"{where}.groups.show", group.get("show", []), QUANTITIES):
        if (needed := estimator_of(quantity)) and needed not in model.estimators:
            raise InputError(f"{where} shows {quantity}, but {group['model']} has no estimator '{needed}'.")
