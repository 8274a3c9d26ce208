"""A study as stated in one file: scene, excitation, noise, models with their estimators, tables and figures."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco

import scenes
from ident.errors import InputError
from sim.models.notes import refusals
from sim.motion.excitation import Excitation

SEARCHED = "searched"
"""Joint axes that the trajectory estimate tilts as wrenches and angles ask for, from those that the scene draws."""

AXES = ("drawn", "recovered", "true", SEARCHED)
"""Joint axes of a model: as the scene draws them, recovered from measured poses, tilted, or searched for."""


ALL = ("all",)
"""Ignored contacts of a model that includes none."""


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
    tilt_deg: float | None = None
    azimuth_deg: float = 0.0
    contacts: Mapping[str, str] = field(default_factory=dict)

    @property
    def identity(self) -> dict[str, Any]:
        """Settings that all trials of one run share."""
        tilt = {} if self.tilt_deg is None else {"tilt_deg": self.tilt_deg, "azimuth_deg": self.azimuth_deg}
        contact = {"contact": " ".join(self.contacts)} if self.contacts else {}
        return {"name": self.model if isinstance(self.model, str) else self.model.name, **tilt, **contact}

    def spec(self, *, tilted: bool = True) -> mujoco.MjSpec:
        """The scene, with tilted or drawn axes.

        Raises:
            InputError: The tilt is invalid; or, as ModelError, MuJoCo cannot read the file.
        """
        tilt, azimuth = (self.tilt_deg or 0.0, self.azimuth_deg) if tilted else (0.0, 0.0)
        if isinstance(self.model, str):
            contact = " ".join(self.contacts) or None
            return scenes.load(self.model, tilt_deg=tilt, azimuth_deg=azimuth, contact=contact)
        spec = _from_file(self.model)
        hinges = [joint.name for joint in spec.joints if joint.type == mujoco.mjtJoint.mjJNT_HINGE]
        return scenes.tilted(spec, hinges, tilt, azimuth)


def _from_file(path: Path) -> mujoco.MjSpec:
    with refusals(path):
        return mujoco.MjSpec.from_file(str(path))


@dataclass(frozen=True)
class StudyModel:
    """A model to identify, with its estimators.

    Attributes:
        title: Name in sentences.
        axes: One of `AXES`.
        parameters: Name of the model whose base parameters it shares; None for the first independent columns.
        ignored: Contacts whose wrenches it omits; `ALL` for all.
        estimators: Some of `fitting.ESTIMATORS`; the first gives the numbers of the summary.
    """

    title: str
    axes: str = "drawn"
    parameters: str | None = None
    ignored: tuple[str, ...] = ()
    estimators: tuple[str, ...] = ("ordinary",)


@dataclass(frozen=True, eq=False)
class StudyFile:
    """Contents of a study file.

    Attributes:
        title: Title of the study.
        scene: The scene.
        excitation: The motion.
        noise: Standard deviations of channels that differ from the scene's, in the sensors' units.
        samples: Samples of the recording.
        seed: Seed of all noise.
        noise_scale: Factor on all noise.
        models: Models by name.
        main: The model whose numbers are in the summary without its name.
        trials: Models of Monte Carlo trials, by their names in tables.
        trajectory_trials: The one of these with trials of the trajectory estimate.
        published: Numbers to compare with: `true` by parameter, `error` and `condition_number` by model.
        tables: Entries of tables by file name; likewise `figures`.
    """

    title: str
    scene: Scene
    excitation: Excitation
    models: Mapping[str, StudyModel]
    noise: Mapping[str, float] = field(default_factory=dict)
    samples: int = 1000
    seed: int = 0
    noise_scale: float = 1.0
    main: str | None = None
    trials: Mapping[str, str] = field(default_factory=dict)
    trajectory_trials: str | None = None
    published: Mapping[str, Any] = field(default_factory=dict)
    tables: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    figures: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @cached_property
    def options(self) -> dict[str, Any]:
        """Options that a run can change, with their values."""
        scene = self.scene
        tilt = {} if scene.tilt_deg is None else {"tilt_deg": scene.tilt_deg, "azimuth_deg": scene.azimuth_deg}
        contact = {"contact": " ".join(scene.contacts)} if scene.contacts and isinstance(scene.model, str) else {}
        return {"seed": self.seed, "samples": self.samples, **tilt, **contact, "noise_scale": self.noise_scale}

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
        ignored = self.models[model].ignored
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
