"""A study as stated in one file: scene, excitation, noise, models with their estimators, tables and figures."""

from collections.abc import Mapping
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
from sim.models.notes import refusals
from sim.motion.excitation import Excitation

SEARCHED = "searched"
"""Joint axes that the trajectory estimate tilts as wrenches and angles ask for, from those that the scene draws."""

AXES = ("drawn", "recovered", "true", SEARCHED)
"""Joint axes of a model: as the scene draws them, recovered from measured poses, tilted, or searched for."""

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
        kind: Its kind, one of `study_displays.TABLES` or of `FIGURES`.
        caption: Its caption.
        groups: Groups of columns of a table of parameters: `model`, quantities to `show`, and `as`, their suffix.
        marked: Parameters that an asterisk marks.
        footnote: Text at the asterisk.
        decimals: Decimals of all numbers; None for those of the standard deviations.
        models: Models of a table of wrench errors.
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
