"""A study as one file states it: scene, excitation, noise, models with their estimators, tables and figures."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import mujoco

import scenes
from ident.errors import InputError
from sim.models.refusals import refusals
from sim.motion.excitation import Excitation

AXES = ("drawn", "recovered", "true")
"""Joint axes of a model: as the scene draws them, as measured poses tell them, or as they were tilted."""


ALL = ("all",)
"""Contacts that are ignored where none is known."""


@dataclass(frozen=True)
class Scene:
    """Who moves, and what is touched.

    Attributes:
        model: Name of a scene of the package, or an MJCF file.
        base: Body whose frame is {0}, None for the world's.
        tilt_deg: Angle of all hinge axes from where they are drawn; None where no tilt is studied.
        azimuth_deg: Direction of the tilt, from +Y to +Z.
        contacts: For each contact the site of its load cell, with which the names of its channels begin.
    """

    model: str | Path
    base: str | None = None
    tilt_deg: float | None = None
    azimuth_deg: float = 0.0
    contacts: Mapping[str, str] = field(default_factory=dict)

    @property
    def identity(self) -> dict[str, Any]:
        """What trials must have in common."""
        tilt = {} if self.tilt_deg is None else {"tilt_deg": self.tilt_deg, "azimuth_deg": self.azimuth_deg}
        contact = {"contact": " ".join(self.contacts)} if self.contacts else {}
        return {"name": self.model if isinstance(self.model, str) else self.model.name, **tilt, **contact}

    def spec(self, *, tilted: bool = True) -> mujoco.MjSpec:
        """The scene, its axes tilted or as they are drawn.

        Raises:
            InputError: The tilt makes no sense; likewise ModelError, MuJoCo cannot read the file.
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
class Model:
    """What is identified, and how.

    Attributes:
        title: What it is called in sentences.
        axes: One of `AXES`.
        parameters: Name of the model whose base parameters it has; None for the first independent columns.
        ignored: Contacts whose wrenches it does not know; `ALL` whichever there are.
        estimators: Of `fitting.ESTIMATORS`, the first for the numbers of the summary.
    """

    title: str
    axes: str = "drawn"
    parameters: str | None = None
    ignored: tuple[str, ...] = ()
    estimators: tuple[str, ...] = ("ordinary",)


@dataclass(frozen=True, eq=False)
class StudyFile:
    """All that a file states.

    Attributes:
        title: What is studied.
        scene: The scene.
        excitation: The motion.
        noise: Standard deviations of channels other than the scene states, in the sensors' units.
        samples: Samples of the recording.
        seed: Seed of all noise.
        noise_scale: Factor on all noise.
        models: Models by their names.
        main: The one whose numbers stand in the summary without its name.
        trials: Models of which many trials are made, by what the tables call them.
        joint_trials: The one of these whose joint estimate is tried too.
        published: Numbers to compare with: `true` by parameter, `error` and `condition_number` by model.
        tables: Entries of tables by the names of their files; likewise `figures`.
    """

    title: str
    scene: Scene
    excitation: Excitation
    models: Mapping[str, Model]
    noise: Mapping[str, float] = field(default_factory=dict)
    samples: int = 1000
    seed: int = 0
    noise_scale: float = 1.0
    main: str | None = None
    trials: Mapping[str, str] = field(default_factory=dict)
    joint_trials: str | None = None
    published: Mapping[str, Any] = field(default_factory=dict)
    tables: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    figures: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)

    @cached_property
    def options(self) -> dict[str, Any]:
        """What can be chosen anew for a run, with its value."""
        scene = self.scene
        tilt = {} if scene.tilt_deg is None else {"tilt_deg": scene.tilt_deg, "azimuth_deg": scene.azimuth_deg}
        contact = {"contact": " ".join(scene.contacts)} if scene.contacts and isinstance(scene.model, str) else {}
        return {"seed": self.seed, "samples": self.samples, **tilt, **contact, "noise_scale": self.noise_scale}

    def with_options(self, **options: Any) -> "StudyFile":
        """The study with other values for some of its `options`.

        Raises:
            InputError: It has no such option, or no such contact.
        """
        for name in options:
            if name not in self.options:
                raise InputError(f"The study has no option '{name}'; it has {', '.join(self.options)}.")
        scene: dict[str, Any] = {name: options.pop(name) for name in ("tilt_deg", "azimuth_deg") if name in options}
        if "contact" in options:
            scene["contacts"] = scenes.load_cells(options.pop("contact"))
        return replace(self, scene=replace(self.scene, **scene), **options)

    def ignored(self, model: str) -> tuple[str, ...]:
        """Contacts that a model knows nothing of."""
        ignored = self.models[model].ignored
        return tuple(self.scene.contacts) if ignored == ALL else ignored

    def spec(self) -> mujoco.MjSpec:
        """The scene that is simulated, with the noise that the file states.

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
        """What the names of a model's numbers end with."""
        return "" if model == self.main else f"_{model}"
