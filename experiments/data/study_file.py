"""A study as stated in one file: scene, excitation, noise, models with their estimators, tables and figures."""

import re
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Annotated, Any

import mujoco

import scenes
from experiments.data.fitting import ESTIMATORS
from experiments.data.paper import SAMPLES
from ident.annotations import Needs, NotNegative, one_of
from ident.errors import InputError
from ident.files.limits import check_keys, choice, made, table, value_of
from ident.files.table import short
from sim.models.notes import refusals
from sim.motion.excitation import Excitation

SEARCHED = "searched"
"""Joint axes that the trajectory estimate tilts as wrenches and angles ask for, from those that the scene draws."""

AXES = ("drawn", "recovered", "true", SEARCHED)
"""Joint axes of a model: as the scene draws them, recovered from measured poses, tilted, or searched for."""

ESTIMATED = ("recovered", SEARCHED)
"""Those that are estimated."""

ALL = ("all",)
"""Ignored contacts of a model that includes none."""

Count = Annotated[int, Needs("a whole number of at least 1", lambda x: x >= 1)]
Whole = Annotated[int, Needs("a whole number of at least 0", lambda x: x >= 0)]
Digits = Annotated[int, Needs("a whole number up to 12", lambda x: 0 <= x <= 12)]
"""Whole numbers of a study file."""


@dataclass(frozen=True)
class Scene:
    """The mechanism that moves, and its contacts.

    Attributes:
        model: Name of a scene of the package, or an MJCF file.
        base: Body whose frame is {0}; None for the world.
        tilt_deg: Angle of all hinge axes from the drawn ones; None without a tilt.
        azimuth_deg: Direction of the tilt, from +Y to +Z.
        contacts: Site of each contact's load cell, which is the prefix of its channels.
    """

    model: str | Path
    base: str | None = None
    tilt_deg: NotNegative | None = None
    azimuth_deg: float = 0.0
    contacts: Mapping[str, str] = field(default_factory=dict)

    @property
    def tilt(self) -> dict[str, float]:
        """Tilt of the axes and its direction, by the names of their options; empty for axes as drawn."""
        return {} if self.tilt_deg is None else {"tilt_deg": self.tilt_deg, "azimuth_deg": self.azimuth_deg}

    @property
    def identity(self) -> dict[str, Any]:
        """Settings that all trials of one run share."""
        contact = {"contact": " ".join(self.contacts)} if self.contacts else {}
        return {"name": self.model if isinstance(self.model, str) else self.model.name, **self.tilt, **contact}

    def spec(self, *, tilted: bool = True) -> mujoco.MjSpec:
        """The scene, with tilted or drawn axes.

        Raises:
            InputError: The tilt is invalid; or, as ModelError, MuJoCo cannot read the file.
        """
        tilt, azimuth = (self.tilt_deg or 0.0, self.azimuth_deg) if tilted else (0.0, 0.0)
        if isinstance(self.model, str):
            contact = " ".join(self.contacts) or None
            return scenes.load(self.model, tilt_deg=tilt, azimuth_deg=azimuth, contact=contact)
        with refusals(self.model):
            spec = mujoco.MjSpec.from_file(str(self.model))
        hinges = [joint.name for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_HINGE]
        return scenes.tilted(spec, hinges, tilt, azimuth)


@dataclass(frozen=True)
class StudyModel:
    """A model to identify, with its estimators.

    Attributes:
        title: Name in sentences.
        axes: One of `AXES`.
        parameters: Name of the model whose base parameters it shares; None for the first independent columns.
        ignore: Contacts whose wrenches it omits; `ALL` for all.
        estimators: Some of `fitting.ESTIMATORS`; the first gives the numbers of the summary.
    """

    title: str
    axes: Annotated[str, one_of(AXES)] = "drawn"
    parameters: str | None = None
    ignore: tuple[str, ...] = ()
    estimators: tuple[Annotated[str, one_of(ESTIMATORS)], ...] = ("ordinary",)

    def __post_init__(self) -> None:
        if not self.estimators or self.estimators[0] == "trajectory":
            raise InputError("needs estimators with ordinary or weighted first, which the summary is of.")
        for name, several in (("ignore", self.ignore), ("estimators", self.estimators)):
            if len(set(several)) < len(several):
                raise InputError(f"needs different {name}, got {', '.join(several)}.")


@dataclass(frozen=True)
class Sweep:
    """Runs of a study with several values of one of its options, and several seeds.

    Attributes:
        option: Name of the option.
        values: Its values.
        seeds: Number of runs of each value.
        numbers: Names of the summary's numbers that the chart shows; empty for the usual ones.
    """

    option: str
    values: tuple[float | str, ...]
    seeds: Count = 1
    numbers: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Display:
    """A table or a figure, as a study file describes it.

    Attributes:
        kind: Its kind, one of `TABLES` or of `FIGURES`.
        caption: Its caption.
        groups: Groups of columns of a table of parameters: `model`, quantities to `show`, and `as`, their suffix.
        marked: Parameters that an asterisk marks.
        footnote: Text at the asterisk.
        decimals: Decimals of all numbers; None for those of the standard deviations.
        models: Models of a table of wrench errors or of tilts.
        curves: What each curve of a figure shows, by its name in the legend.
    """

    kind: str
    caption: str
    groups: tuple[Mapping[str, Any], ...] = ()
    marked: tuple[str, ...] = ()
    footnote: str = ""
    decimals: Digits | None = None
    models: tuple[str, ...] = ()
    curves: Mapping[str, str] = field(default_factory=dict)

    @property
    def fixed_decimals(self) -> int:
        """Decimals of numbers that have no standard deviation."""
        return 3 if self.decimals is None else self.decimals


@dataclass(frozen=True, eq=False)
class StudyFile:
    """Contents of a study file.

    Attributes:
        scene: The scene.
        excitation: The motion.
        models: Models by name.
        title: Title of the study.
        noise: Standard deviations of channels that differ from the scene's, in the sensors' units.
        samples: Samples of the recording.
        seed: Seed of all noise.
        noise_scale: Factor on all noise.
        main: The model whose numbers are in the summary without its name.
        trials: Models of Monte Carlo trials, by their names in tables.
        trajectory_trials: The one of these with trials of the trajectory estimate.
        published: Numbers to compare with: `true` by parameter, `error` and `condition_number` by model.
        tables: Tables by file name; likewise `figures`.
        sweep: Runs with other values of an option; None for none.
    """

    scene: Scene
    excitation: Excitation
    models: Mapping[str, StudyModel]
    title: str
    noise: Mapping[str, NotNegative] = field(default_factory=dict)
    samples: Count = SAMPLES
    seed: Whole = 0
    noise_scale: NotNegative = 1.0
    main: str | None = None
    trials: Mapping[str, str] = field(default_factory=dict)
    trajectory_trials: str | None = None
    published: Mapping[str, Any] = field(default_factory=dict)
    tables: Mapping[str, Display] = field(default_factory=dict)
    figures: Mapping[str, Display] = field(default_factory=dict)
    sweep: Sweep | None = None

    @cached_property
    def options(self) -> dict[str, Any]:
        """Options that a run can change, with their values."""
        scene = self.scene
        contact = {"contact": " ".join(scene.contacts)} if scene.contacts and isinstance(scene.model, str) else {}
        return {"seed": self.seed, "samples": self.samples, **scene.tilt, **contact, "noise_scale": self.noise_scale}

    def with_options(self, **options: Any) -> "StudyFile":
        """The study with other values for some of its `options`.

        Published numbers are those of the file's values; they are left out if another than the seed differs.

        Raises:
            InputError: It has no such option, or no such contact.
        """
        for name in options:
            if name not in self.options:
                raise InputError(f"The study has no option '{name}'; it has {', '.join(self.options)}.")
        scene: dict[str, Any] = {name: options.pop(name) for name in ("tilt_deg", "azimuth_deg") if name in options}
        if "contact" in options:
            scene["contacts"] = scenes.load_cells(options.pop("contact"))
        changed = replace(self, scene=replace(self.scene, **scene), **options)
        same = {**changed.options, "seed": self.seed} == self.options
        return changed if same else replace(changed, published={})

    def ignored(self, model: str) -> tuple[str, ...]:
        """Contacts that a model omits."""
        ignored = self.models[model].ignore
        return tuple(self.scene.contacts) if ignored == ALL else ignored

    def spec(self) -> mujoco.MjSpec:
        """The scene to simulate, with the file's noise.

        Raises:
            InputError: A channel does not exist; or as for `Scene.spec`.
        """
        spec = self.scene.spec()
        sensors = {sensor.name: sensor for sensor in spec.sensors}
        for channel, level in self.noise.items():
            if channel not in sensors:
                raise InputError(f"The scene has no sensor '{channel}' to be noisy; it has {', '.join(sensors)}.")
            sensors[channel].noise = level
        return spec

    def suffix(self, model: str) -> str:
        """Suffix of the names of a model's numbers."""
        return "" if model == self.main else f"_{model}"


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
    "tilts": ("models", "decimals"),
    "contacts": ("decimals",),
}
"""Entries of each kind of table, beside `kind` and `caption`."""

FIGURES = {"wrenches": ("curves",), "wrench errors": ("curves",), "residuals": ("curves",), "contacts": ()}
"""Entries of each kind of figure, beside `kind` and `caption`."""

WRENCHES = ("true", "measured", "ground")
"""Curves of wrenches besides those of models: the true and the measured total, and the ground's."""

ERRORS = "RMS errors of the recovered wrench, and their ratio to the s.d. of the true, noise-free one"
TILTS = "Tilts of the joint axes about axes of the base frame, and their standard deviations, each joint alone"
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
        "tilts": {"caption": TILTS, "models": [name for name, model in models.items() if model.axes in ESTIMATED]},
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
