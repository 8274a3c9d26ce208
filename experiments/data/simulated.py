"""A simulated study: its mechanism, its recording, and the models of its file identified from that recording."""

from collections.abc import Callable, Collection
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from experiments.data.fitting import (
    TrajectoryTrial,
    Trial,
    fit,
    measured_poses,
    trajectory_fit,
    trajectory_fit_if_determined,
)
from experiments.data.study_file import SEARCHED, StudyFile
from ident.errors import InputError, ModelError
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.recovered_axes import PARALLEL_SIGNIFICANCE, RecoveredAxes, angle, recover_axes
from ident.mechanism.tree import Tree
from ident.parameters.base_parameters import BaseParameters, find_base_parameters, structural_base_parameters
from ident.recordings.recording import Recording
from ident.recordings.wrench import Sensor, TotalWrench
from sim.models.mechanism import mechanism
from sim.models.mujoco_model import tree_from_model


@dataclass(frozen=True, eq=False)
class StudyProblem:
    """A study's mechanism before any recording.

    Attributes:
        file: The study file.
        known: The mechanism with untilted axes, up to the load cells, and the true φ, which a tilt does not change; its
            sites are those of the load cells, by contact name.
        true: The tree with tilted axes.
    """

    file: StudyFile
    known: Mechanism
    true: Tree

    @classmethod
    def of(cls, file: StudyFile) -> "StudyProblem":
        """The problem of a study.

        Raises:
            ModelError: The scene cannot be read, or lacks the site of a load cell.
        """
        base = file.scene.base
        drawn = mechanism(file.scene.spec(tilted=False).compile(), base)
        for contact, site in file.scene.contacts.items():
            if site not in drawn.sites:
                choices = ", ".join(drawn.sites) or "none"
                raise ModelError(f"Contact '{contact}' needs its load cell's site '{site}'; the sites are {choices}.")
        sites = {contact: drawn.site(site) for contact, site in file.scene.contacts.items()}
        return cls(file, replace(drawn, sites=sites), tree_from_model(file.scene.spec(), base))

    def with_cells(self, recording: Recording, ignored: Collection[str] = ()) -> Recording:
        """The recording with its load cells as sensors, and without the channels of ignored contacts."""
        cells = self.file.scene.contacts.items()
        channels = [f"{site}_{kind}" for name, site in cells if name in ignored for kind in ("force", "torque")]
        sensors = {
            site: Sensor(*self.known.sites[name], applied_to_link=False) for name, site in cells if name not in ignored
        }
        return recording.without(channels).with_sensors(sensors)

    def total(self, recording: Recording, ignored: Collection[str] = (), tree: Tree | None = None) -> TotalWrench:
        """Total wrench (Eq. 17): the ground's less those of the links on all contacts that are not ignored.

        Args:
            recording: Measured joint angles and wrenches.
            ignored: Contacts to leave out.
            tree: Tree that moves the contacts' wrenches to the base, by default with the true axes.
        """
        return self.with_cells(recording, ignored).total_wrench(tree or self.true)


@dataclass(frozen=True, eq=False)
class SimulatedStudy:
    """Results of a study; each model's estimates are computed on first use.

    Attributes:
        problem: The problem.
        recording: The recording.
        significance: Significance level at which parallel axes are rejected, as for `recover_axes`.
    """

    problem: StudyProblem
    recording: Recording
    significance: float = PARALLEL_SIGNIFICANCE
    _made: dict[tuple[str, str], Trial | TrajectoryTrial] = field(default_factory=dict)

    @property
    def file(self) -> StudyFile:
        """The study file."""
        return self.problem.file

    @property
    def known(self) -> Mechanism:
        """The untilted mechanism, as for `StudyProblem`."""
        return self.problem.known

    def fit(self, model: str, estimator: str | None = None) -> Trial:
        """A model's base parameters by least squares, `ordinary` or `weighted`; by default the model's first estimator.

        Raises:
            ExcitationError: The motion does not separate the base parameters.
            InputError: Recovered axes are not parallel, but the other model's parameters require it.
        """
        estimator = estimator or self.file.models[model].estimators[0]
        if (model, estimator) not in self._made:
            wrench = self.total(model)
            weighted = estimator == "weighted" and self.file.noise_scale > 0
            self._made[model, estimator] = fit(
                self.mechanism(model),
                self.recording,
                wrench=wrench.values,
                covariance=wrench.covariance if weighted else None,
                kept=self._kept(model),
            )
        made = self._made[model, estimator]
        assert isinstance(made, Trial)
        return made

    def total(self, model: str) -> TotalWrench:
        """Total wrench from the measured wrenches that a model includes, moved to the base along its own axes."""
        return self.problem.total(self.recording, self.file.ignored(model), self.mechanism(model).tree)

    def trajectory(self, model: str) -> TrajectoryTrial:
        """A model's trajectory estimate; NaN if angles and wrenches do not determine it."""
        if (model, "trajectory") not in self._made:
            self._made[model, "trajectory"] = self._along(model, self.fit(model).base, trajectory_fit_if_determined)
        made = self._made[model, "trajectory"]
        assert isinstance(made, TrajectoryTrial)
        return made

    def determined_trajectory(self, model: str) -> TrajectoryTrial:
        """The same, but raises an error if undetermined.

        Raises:
            ExcitationError: The motion does not separate the base parameters.
        """
        return self._along(model, self.base(model), trajectory_fit)

    def _along(self, model: str, base: BaseParameters, fitted: Callable[..., TrajectoryTrial]) -> TrajectoryTrial:
        recording = self.problem.with_cells(self.recording, self.file.ignored(model))
        searched = self.file.models[model].axes == SEARCHED
        return fitted(self.mechanism(model), recording, base, searched=searched)

    def base(self, model: str) -> BaseParameters:
        """A model's regrouping."""
        return structural_base_parameters(self.mechanism(model), kept=self._kept(model))

    def mechanism(self, model: str) -> Mechanism:
        """A model's mechanism, with its axes."""
        axes = self.file.models[model].axes
        trees = {
            "drawn": lambda: self.known.tree,
            SEARCHED: lambda: self.known.tree,
            "recovered": lambda: self.recovered.tree,
            "true": lambda: self.problem.true,
        }
        return replace(self.known, tree=trees[axes]())

    def _kept(self, model: str) -> tuple[str, ...] | None:
        """Names of base parameters that a model shares with another one; None if it shares none."""
        described = self.file.models[model]
        if described.parameters is None:
            return None
        if described.axes == "recovered" and len(self.recovered.groups) > 1:
            raise InputError(
                f"The recovered axes are not parallel (p = {np.nanmin(self.recovered.p_values):.1e}), but those of "
                f"'{model}' need to be for the parameters of '{described.parameters}'; try another seed or less noise."
            )
        return self.base(described.parameters).names

    @cached_property
    def recovered(self) -> RecoveredAxes:
        """The axes recovered from the measured poses."""
        poses = measured_poses(self.known.tree, self.recording)
        return recover_axes(self.known.tree, poses, significance=self.significance)

    @property
    def recovers(self) -> bool:
        """True if some model has recovered axes."""
        return any(model.axes == "recovered" for model in self.file.models.values())

    @cached_property
    def axis_error(self) -> np.ndarray:
        """Angle between each recovered and true axis, rad (n,)."""
        pairs = zip(self.recovered.tree.bodies, self.problem.true.bodies, strict=True)
        return np.array([angle(estimated.twist[3:], true.twist[3:]) for estimated, true in pairs if true.moves])

    @cached_property
    def rank_apart(self) -> int:
        """Rank of the model whose axes are recovered joint by joint."""
        poses = measured_poses(self.known.tree, self.recording)
        apart = recover_axes(self.known.tree, poses, significance=1).tree
        return find_base_parameters(apart, gravity=self.known.gravity).rank

    @cached_property
    def measured(self) -> TotalWrench:
        """Total wrench from the measured ground and contact wrenches, moved along the true axes."""
        return self.problem.total(self.recording)

    @cached_property
    def true(self) -> TotalWrench:
        """The same from noise-free values."""
        return self.problem.total(self.recording.noise_free)

    @property
    def several(self) -> bool:
        """True if there are several contacts."""
        return len(self.file.scene.contacts) > 1

    @property
    def touching(self) -> dict[str, np.ndarray]:
        """Samples in which each contact touches (N,); one without a sensor of its normal force always does."""
        true = self.recording.true
        held = np.ones(len(self.recording.time))
        return {name: true.get(f"{name}_normal_force", held) > 0 for name in self.file.scene.contacts}
