"""Reading of study files: each entry is checked, and unknown entries are errors."""

from collections.abc import Collection, Mapping
from dataclasses import replace
from importlib.resources import files
from os.path import realpath
from pathlib import Path
from typing import Any, get_type_hints

import scenes
from experiments.data import paper, study_file
from experiments.data.study_file import Scene, StudyFile, StudyModel, several
from ident.annotations import NotNegative
from ident.errors import InputError, about
from ident.files.limits import check_keys, choice, made, table, toml, value_of
from ident.files.table import short
from sim.motion.excitation import BOWING, DOUBLE_PENDULUM, Excitation

EXCITATIONS = {"double_pendulum": DOUBLE_PENDULUM, "bowing": BOWING}
"""Named motions."""

PUBLISHED = {"section_6": paper.SECTION_6, "section_7": paper.SECTION_7}
"""Named sets of the paper's numbers."""

PUBLISHED_KINDS: Mapping[str, Any] = {
    "true": Mapping[str, float],
    "error": Mapping[str, Mapping[str, float]],
    "condition_number": Mapping[str, NotNegative],
}
"""Types of the numbers of `[published]`, by parameter or model."""

RECORDED = ("samples", "seed", "noise_scale", "noise")
"""Entries of `[recording]`."""

PACKAGED = ("misaligned", "multicontact", "several_contacts")
"""Studies in this package, a file each."""


def packaged(name: str, **options: Any) -> StudyFile:
    """One of the studies in this package with other values for some of its options.

    Raises:
        InputError: It has no such option, or the value is invalid.
    """
    several = name == "multicontact" and len(str(options.get("contact", "")).split()) > 1
    file = files("experiments.studies").joinpath(f"{'several_contacts' if several else name}.toml")
    return from_entries(toml(Path(str(file)), "a study needs"), Path()).with_options(**options)


def read(path: Path) -> StudyFile:
    """Reads a study file.

    Raises:
        InputError: It is missing or malformed; the sentence names the file, the entry and what would be valid.
    """
    if not path.is_file():
        raise InputError(
            f"'{path}': a study is a TOML file that exists; {', '.join(PACKAGED)} come with this package, by name."
        )
    content = toml(path, "a study needs")
    with about(path):
        return from_entries(content, path.parent)


def from_entries(entries: Mapping[str, Any], folder: Path) -> StudyFile:
    """A study from the entries of a file; models are searched in its folder."""
    hints = get_type_hints(StudyFile, include_extras=True)
    check_keys("the study", entries, sorted({*hints, "recording"} - {*RECORDED, "trajectory_trials"}))
    for needed in ("scene", "models"):
        if not entries.get(needed):
            raise InputError(f"the study needs [{needed}].")
    scene = _scene(table("[scene]", entries["scene"]), folder)
    models = _models(table("[models]", entries["models"]), scene)
    main = choice("main", entries["main"], models) if "main" in entries else None
    trials, recording = (table(f"[{name}]", entries.get(name, {})) for name in ("trials", "recording"))
    check_keys("[trials]", trials, ("models", "trajectory"))
    check_keys("[recording]", recording, RECORDED)
    tried = table("trials.models", trials.get("models", {}))
    for name, model in tried.items():
        choice(f"trials.models.{name}", model, models)
    stated, (tables, figures) = entries.get("tables", {}), study_file.usual(models, main)
    study = StudyFile(
        scene,
        _excitation(entries.get("excitation", "double_pendulum")),
        models,
        main=main,
        trials=tried,
        trajectory_trials=choice("trials.trajectory", trials["trajectory"], tried) if "trajectory" in trials else None,
        published=_published(entries.get("published", {}), models),
        tables=study_file.shown(
            "tables",
            study_file.parameter_tables(models) if stated == {} else stated,
            study_file.TABLES,
            models,
            scene,
            tables,
        ),
        figures=study_file.shown("figures", entries.get("figures", {}), study_file.FIGURES, models, scene, figures),
        title=value_of("title", entries.get("title", "A study"), str),
        **{key: value_of(f"recording.{key}", x, hints[key]) for key, x in recording.items()},
    )
    return with_sweep(study, entries["sweep"]) if "sweep" in entries else study


def with_sweep(study: StudyFile, entry: Any) -> StudyFile:
    """The study with runs over the values of one of its options, which fit as that does."""
    sweep = made(study_file.Sweep, "sweep", entry)
    hints = {"contact": str}
    for kind in (Scene, StudyFile):
        hints |= get_type_hints(kind, include_extras=True)
    hint: Any = hints[choice("sweep.option", sweep.option, [name for name in study.options if name != "seed"])]
    values = value_of("sweep.values", list(sweep.values), tuple[hint, ...])
    if not values or len(set(values)) < len(values):
        raise InputError(f"sweep.values needs one value or more, all different, got {short(list(values))}.")
    return replace(study, sweep=replace(sweep, values=values))


def _scene(entry: Mapping[str, Any], folder: Path) -> Scene:
    name = value_of("scene.model", entry.get("model"), str)
    own = name.lower().endswith(".xml")
    if not own:
        choice("scene.model, unless it is an MJCF file (.xml),", name, scenes.NAMES)
    elif not (folder / name).is_file():
        raise InputError(f"scene.model '{name}' does not exist.")
    stated = {
        "base": None if own else scenes.BASES[name],
        **entry,
        "contacts": _contacts(entry.get("contacts", []), own),
    }
    scene = made(Scene, "scene", stated)
    return replace(scene, model=Path(realpath(folder / name))) if own else scene


def _contacts(value: Any, own: bool) -> Mapping[str, str]:
    """Sites of load cells by contact: a table in a user's own file, else a list of the package's contacts."""
    if own and isinstance(value, dict):
        return dict(value_of("scene.contacts", value, Mapping[str, str]))
    if own and value != []:
        raise InputError("scene.contacts of a model of your own needs a table of sites by the contacts' names.")
    names = several("scene.contacts", value, scenes.CONTACTS)
    return scenes.load_cells(" ".join(names)) if names else {}


def _excitation(value: Any) -> Any:
    if isinstance(value, str):
        return EXCITATIONS[choice("excitation", value, EXCITATIONS)]
    return made(Excitation, "excitation", value)


def _models(entries: Mapping[str, Any], scene: Scene) -> dict[str, StudyModel]:
    models: dict[str, StudyModel] = {}
    for name, value in entries.items():
        where = f"models.{name}"
        if name.casefold() in study_file.WRENCHES:
            taken = ", ".join(study_file.WRENCHES)
            raise InputError(f"{where} needs another name: curves of wrenches call {taken} what is no model.")
        entry = {"title": f"{name.replace('_', ' ')} model", **table(where, value)}
        whole = entry.get("ignore") == "all"
        model = made(StudyModel, where, entry | ({"ignore": [*study_file.ALL]} if whole else {}))
        if model.parameters is not None:
            # Only earlier models, so that there are no cycles.
            choice(f"{where}.parameters", model.parameters, models)
        for contact in () if whole else model.ignore:
            if contact == "all":
                raise InputError(
                    f'{where}.ignore needs "all" as a text, not in a list, to leave out all contacts; single ones are '
                    f"{', '.join(scene.contacts) or 'none'}."
                )
            choice(f"{where}.ignore", contact, scene.contacts)
        models[name] = model
    return models


def _published(value: Any, models: Collection[str]) -> Mapping[str, Any]:
    if isinstance(value, str):
        return PUBLISHED[choice("published", value, PUBLISHED)]
    entry = table("[published]", value)
    check_keys("[published]", entry, [*PUBLISHED_KINDS])
    for key, kind in PUBLISHED_KINDS.items():
        for name in value_of(f"published.{key}", entry.get(key, {}), kind):
            if key != "true":
                choice(f"published.{key}", name, models)
    return entry
