"""A simulated study: its mechanism, its recording, the models of its file identified from that, and key numbers."""

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from experiments.data.fitting import Fitted, Trial, fit, measured_poses, searched_axes, trajectory_estimate
from experiments.data.study_file import SEARCHED, StudyFile
from ident.errors import ExcitationError, InputError, ModelError
from ident.estimation.setup_parameters import across
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.recovered_axes import RecoveredAxes, angle, recover_axes
from ident.mechanism.tree import Tree
from ident.parameters.base_parameters import BaseParameters, find_base_parameters, structural_base_parameters
from ident.recordings.recording import Recording
from ident.recordings.wrench import Sensor, TotalWrench
from ident.tolerances import ROUNDING, SIGNIFICANT
from sim.models.model_mechanism import mechanism
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
    significance: float = SIGNIFICANT
    _made: dict[tuple[str, str], Fitted] = field(default_factory=dict)
    _trajectories: dict[str, Trial] = field(default_factory=dict)

    @property
    def file(self) -> StudyFile:
        """The study file."""
        return self.problem.file

    @property
    def known(self) -> Mechanism:
        """The untilted mechanism, as for `StudyProblem`."""
        return self.problem.known

    def fit(self, model: str, estimator: str | None = None) -> Fitted:
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
        return self._made[model, estimator]

    def total(self, model: str) -> TotalWrench:
        """Total wrench from the measured wrenches that a model includes, moved to the base along its own axes."""
        return self.problem.total(self.recording, self.file.ignored(model), self.mechanism(model).tree)

    def trajectory(self, model: str) -> Trial:
        """A model's trajectory estimate; NaN if undetermined, as few samples may be with angles alone."""
        if model not in self._trajectories:
            try:
                self._trajectories[model] = self.determined_trajectory(model)
            except (ExcitationError, np.linalg.LinAlgError):
                base = self.base(model)
                unknown = np.full(base.rank, np.nan)
                self._trajectories[model] = Trial(base, unknown, unknown, base.regroup(self.known.known))
        return self._trajectories[model]

    def determined_trajectory(self, model: str) -> Trial:
        """The same, but raises an error if undetermined.

        Raises:
            ExcitationError: The motion does not separate the base parameters.
        """
        recording = self.problem.with_cells(self.recording, self.file.ignored(model))
        searched, base = self.file.models[model].axes == SEARCHED, self.base(model)
        estimate = trajectory_estimate(self.mechanism(model), recording, base, searched=searched)
        return Trial(base, estimate.psi, estimate.std_setup, base.regroup(self.known.known))

    def base(self, model: str) -> BaseParameters:
        """A model's regrouping."""
        return structural_base_parameters(self.mechanism(model), kept=self._kept(model))

    def mechanism(self, model: str) -> Mechanism:
        """A model's mechanism, with its axes."""
        if (estimated := self.estimated_axes(model)) is not None:
            return replace(self.known, tree=estimated.tree)
        return replace(self.known, tree=self.problem.true) if self.file.models[model].axes == "true" else self.known

    def estimated_axes(self, model: str) -> RecoveredAxes | None:
        """Axes that are recovered or searched for; None for those that are stated, or of which no tilt is found."""
        axes = self.file.models[model].axes
        return self.recovered if axes == "recovered" else self.searched if axes == SEARCHED else None

    def _kept(self, model: str) -> tuple[str, ...] | None:
        """Names of base parameters that a model shares with another one; None if it shares none."""
        described = self.file.models[model]
        if described.parameters is None:
            return None
        if (axes := self.estimated_axes(model)) is not None and len(axes.groups) > 1:
            raise InputError(
                f"The {described.axes} axes are not parallel (p = {np.nanmin(axes.p_values):.1e}), but those of "
                f"'{model}' need to be for the parameters of '{described.parameters}'; try another seed, less noise or "
                "more samples."
            )
        return self.base(described.parameters).names

    @cached_property
    def recovered(self) -> RecoveredAxes:
        """The axes recovered from the measured poses."""
        poses = measured_poses(self.known.tree, self.recording)
        return recover_axes(self.known.tree, poses, significance=self.significance)

    @cached_property
    def searched(self) -> RecoveredAxes | None:
        """The axes that are found in angles and wrenches; None without a tilt."""
        return searched_axes(self.known, self.problem.with_cells(self.recording), self.significance)

    @property
    def recovers(self) -> bool:
        """True if some model has recovered axes."""
        return any(model.axes == "recovered" for model in self.file.models.values())

    def axis_error(self, axes: RecoveredAxes) -> np.ndarray:
        """Angle between each recovered and true axis, rad (n,)."""
        pairs = zip(axes.tree.bodies, self.problem.true.bodies, strict=True)
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


CHANNELS = ("Fx", "Fy", "Fz", "τx", "τy", "τz")
"""The wrench's components in the paper's names."""


def summary(study: SimulatedStudy) -> dict[str, Any]:
    """Key numbers for scripts; those of a model end with its name."""
    file, numbers = study.file, dict[str, Any]()
    for name in file.models:
        fit, suffix = study.fit(name), file.suffix(name)
        numbers |= {
            f"condition_number{suffix}": fit.estimate.condition_number,
            f"rank{suffix}": fit.base.rank,
            f"rows{suffix}": fit.estimate.rows,
            f"epsilon{suffix}": fit.estimate.epsilon,
            f"largest_error{suffix}": float(np.abs(fit.error).max()),
        }
        if file.models[name].axes == SEARCHED and study.searched:
            errors = axis_errors(study, study.searched)
            numbers |= {f"{key}{suffix or '_searched'}": x for key, x in errors.items()}
    published = file.published.get("condition_number", {})
    numbers |= {f"paper_condition_number{file.suffix(name)}": number for name, number in published.items()}
    for entry in file.tables.values():
        if entry.kind in BY_ROW:
            numbers[entry.kind.replace(" ", "_")] = BY_ROW[entry.kind](study, entry.models)
    numbers |= axes(study) if study.recovers else {}
    numbers |= touches(study) if study.touching else {}
    recording = study.recording
    return numbers | {"tracking_error_rad": recording.provenance["tracking_error_rad"], "noise": dict(recording.noise)}


def axis_errors(study: SimulatedStudy, axes: RecoveredAxes) -> dict[str, float]:
    """Largest error of estimated axes and largest standard deviation, deg."""
    largest = {"axis_error_deg": study.axis_error(axes).max(), "axis_std_deg": max(axis.std for axis in axes.axes)}
    return {name: float(np.degrees(x)) for name, x in largest.items()}


def axes(study: SimulatedStudy) -> dict[str, float]:
    """Key numbers of the recovered axes."""
    recovered, tree = study.recovered, study.known.tree
    first = tree.moving[0]
    drawn = tree.poses(np.zeros(len(tree.moving)))[first, :3, :3] @ tree.bodies[first].twist[3:]
    alone = [axis.vector for axis in recovered.separate]
    return {
        "tilt_recovered_deg": float(np.degrees(angle(recovered.axes[0].vector, drawn))),
        **axis_errors(study, recovered),
        "axis_difference_alone_deg": float(np.degrees(max([0.0, *(angle(alone[0], other) for other in alone[1:])]))),
        "rank_axes_apart": study.rank_apart,
        "axes_parallel_p_value": float(np.nanmin(recovered.p_values)) if len(alone) > 1 else 1.0,
    }


def trajectory_summary(study: SimulatedStudy) -> dict[str, float | None]:
    """Key numbers of the trajectory estimates, which take longer than all others."""
    numbers: dict[str, float | None] = {}
    for name, model in study.file.models.items():
        if "trajectory" in model.estimators:
            fitted, suffix = study.trajectory(name), study.file.suffix(name)
            numbers |= {f"largest_error{suffix}": fitted.largest_error, f"rms_z{suffix}": fitted.rms_z}
    return numbers


def wrench_errors(study: SimulatedStudy, models: Sequence[str]) -> dict[str, dict[str, float | None]]:
    """RMS errors of the recovered wrenches by channel, and their ratio to the channel's standard deviation."""
    std = study.true.values.std(axis=0)
    rms = {model: np.sqrt((wrench_error(study, model) ** 2).mean(axis=0)) for model in models}
    errors: dict[str, dict[str, float | None]] = {}
    for k, channel in enumerate(CHANNELS):
        errors[channel] = {"true_std": float(std[k])}
        errors[channel] |= {f"rms_{model}": float(x[k]) for model, x in rms.items()}
        ratios = {f"ratio_{model}": float(x[k] / std[k]) if std[k] > ROUNDING else None for model, x in rms.items()}
        errors[channel] |= ratios
    return errors


def wrench_error(study: SimulatedStudy, model: str) -> np.ndarray:
    """Recovered less true, noise-free total wrench (N, 6)."""
    return study.fit(model).predicted - study.true.values


def tilts(study: SimulatedStudy, models: Sequence[str]) -> dict[str, dict[str, float | None]]:
    """Tilts of each joint's axis about axes of the base frame, deg: true, and of models as estimated of it alone.

    Those that a search leaves as drawn are empty.
    """
    tree, out = study.known.tree, dict[str, dict[str, float | None]]()
    home = tree.poses(np.zeros(len(tree.moving)))[:, :3, :3]
    estimated = {model: axes.separate for model in models if (axes := study.estimated_axes(model))}
    for j, i in enumerate(tree.moving):
        drawn, true = (home[i] @ each.bodies[i].twist[3:] for each in (tree, study.problem.true))
        for k in across(drawn):
            row = out[f"{tree.bodies[i].joint} about {'xyz'[k]}"] = {"true_deg": _tilt(drawn, true)[k]}
            for model, axis in ((model, axes[j]) for model, axes in estimated.items()):
                std = float(np.degrees(np.linalg.norm(np.cross(drawn, axis.influence)[:, k])))
                shown = (_tilt(drawn, axis.vector)[k], std) if std > ROUNDING else (None, None)
                row[f"tilt_{model}_deg"], row[f"std_{model}_deg"] = shown
    return out


def _tilt(drawn: np.ndarray, axis: np.ndarray) -> list[float]:
    """Rotation vector of the smallest turn from one direction to another, deg."""
    turn: list[float] = (np.degrees(np.cross(drawn, axis)) / np.sinc(angle(drawn, axis) / np.pi)).tolist()
    return turn


BY_ROW: Mapping[str, Callable[[SimulatedStudy, Sequence[str]], dict[str, dict[str, float | None]]]] = {
    "wrench errors": wrench_errors,
    "tilts": tilts,
}
"""Numbers of kinds of tables by row and column."""


def touches(study: SimulatedStudy) -> dict[str, float]:
    """Fraction and episodes of each contact and its peak force; fractions in which all and none touch."""
    number = np.sum(list(study.touching.values()), axis=0)
    numbers: dict[str, float] = {}
    for name, touching in study.touching.items():
        site = study.file.scene.contacts[name]
        numbers |= {
            f"{site}_fraction": float(touching.mean()),
            f"{site}_fraction_alone": float(np.mean(touching & (number == 1))),
            f"{site}_episodes": int(touching[0] + np.sum(~touching[:-1] & touching[1:])),
            f"{site}_peak_force_N": float(np.linalg.norm(study.recording.true[f"{site}_force"], axis=1).max()),
        }
    return numbers | {
        "contact_peak_force_N": max(x for key, x in numbers.items() if key.endswith("_peak_force_N")),
        "fraction_all_touch": float(np.mean(number == len(study.touching))),
        "fraction_none_touches": float(np.mean(number == 0)),
    }
