"""The study of Section VI: a tilted double pendulum, identified with axes along X and with recovered axes."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

import scenes
from experiments.cli.defaults import AZIMUTH_DEG, SCENE
from experiments.studies import paper, trials
from experiments.studies.fitting import JointTrial, Trial, fit, joint_fit, joint_fit_if_determined, measured_poses
from ident.errors import InputError
from ident.mechanism.axes import PARALLEL_SIGNIFICANCE, RecoveredAxes, angle, recover_axes
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import Tree
from ident.parameters.base_parameters import find_base_parameters, structural_base_parameters
from ident.recordings.recording import Recording
from sim.models.mechanism import mechanism
from sim.models.mujoco_model import tree_from_model
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.simulate import simulate


@dataclass(frozen=True, eq=False)
class Study:
    """What the study found.

    Attributes:
        recording: Simulated recording of the tilted scene.
        simplified: Model with its axes along X.
        full: Model with the recovered axes, on its own first independent columns.
        full_on_table: The same model on the simplified model's parameters, those of Table III.
        recovered: The recovered axes.
        axis_error: Angle between each recovered and true axis, rad (n,).
        rank_apart: Rank of the model whose axes were recovered joint by joint.
    """

    recording: Recording
    simplified: Trial
    full: Trial
    full_on_table: Trial
    recovered: RecoveredAxes
    axis_error: np.ndarray
    rank_apart: int

    @cached_property
    def joint(self) -> dict[str, JointTrial]:
        """Joint estimates of the simplified and of the full model on the simplified one's parameters."""
        pendulum = design()
        models = {"simplified": (pendulum.tree, self.simplified), "full": (self.recovered.tree, self.full_on_table)}
        return {
            name: joint_fit_if_determined(replace(pendulum, tree=tree), self.recording, model.base)
            for name, (tree, model) in models.items()
        }


def study(
    *,
    seed: int = 0,
    samples: int = paper.SAMPLES,
    tilt_deg: float = paper.TILT_DEG,
    azimuth_deg: float = AZIMUTH_DEG,
    noise_scale: float = 1.0,
) -> Study:
    """Simulates the tilted double pendulum and identifies it with the simplified and the full model.

    Args:
        seed: Seed of all noise.
        samples: Samples recorded at 100 Hz.
        tilt_deg: Angle of both joint axes from X.
        azimuth_deg: Direction of the tilt from +Y to +Z.
        noise_scale: Factor on all noise.

    Raises:
        InputError: An argument makes no sense.
        ExcitationError: The motion does not separate the base parameters.
    """
    spec = scenes.load(SCENE, tilt_deg=tilt_deg, azimuth_deg=azimuth_deg)
    recording = simulate(spec, DOUBLE_PENDULUM, samples=samples, seed=seed, noise_scale=noise_scale)
    pendulum, truth = design(), tree_from_model(spec, "base")
    recovered, simplified, full_on_table = _both_models(pendulum, recording, PARALLEL_SIGNIFICANCE)
    full = _fit(pendulum, recovered.tree, recording)
    apart = recover_axes(pendulum.tree, measured_poses(pendulum.tree, recording), significance=1).tree
    rank_apart = find_base_parameters(apart, gravity=pendulum.gravity).rank
    pairs = zip(recovered.tree.bodies, truth.bodies, strict=True)
    axis_error = np.array([angle(found.twist[3:], true.twist[3:]) for found, true in pairs if true.moves])
    return Study(recording, simplified, full, full_on_table, recovered, axis_error, rank_apart)


def design() -> Mechanism:
    """The mechanism as drawn, axes along X, with the true φ, which tilted axes do not change."""
    return mechanism(scenes.load(SCENE).compile(), "base")


def trial(pendulum: Mechanism, recording: Recording) -> trials.Outcome:
    """Errors of both models from one recording, the axes always recovered as one direction."""
    _, simplified, full = _both_models(pendulum, recording, significance=0)
    return trials.outcome(simplified, full)


def joint_trial(pendulum: Mechanism, recording: Recording) -> trials.Outcome:
    """Errors of the full model's joint estimate from one recording, the axes always recovered as one direction."""
    recovered = recover_axes(pendulum.tree, measured_poses(pendulum.tree, recording), significance=0)
    full = replace(pendulum, tree=recovered.tree)
    names = structural_base_parameters(pendulum).names
    return trials.outcome(joint_fit(full, recording, structural_base_parameters(full, kept=names)))


def _both_models(pendulum: Mechanism, recording: Recording, significance: float) -> tuple[RecoveredAxes, Trial, Trial]:
    """Recovered axes, simplified model, and full model on the simplified one's parameters."""
    simplified = _fit(pendulum, pendulum.tree, recording)
    recovered = recover_axes(pendulum.tree, measured_poses(pendulum.tree, recording), significance=significance)
    if len(recovered.groups) > 1:
        raise InputError(
            f"The recovered axes are not parallel (p = {recovered.p_values[1]:.1e}), but Table III's names need rank "
            "13, which only parallel axes have; try another seed or less noise."
        )
    return recovered, simplified, _fit(pendulum, recovered.tree, recording, simplified.base.names)


def _fit(pendulum: Mechanism, tree: Tree, recording: Recording, kept: Sequence[str] | None = None) -> Trial:
    """A model of other axes, or of the design's."""
    return fit(replace(pendulum, tree=tree), recording, kept=kept)
