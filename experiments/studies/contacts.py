"""The study of Section VII: a double pendulum whose links touch something, identified from all wrenches."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass

import numpy as np

import scenes
from experiments.studies import paper, trials
from experiments.studies.fitting import Trial, fit
from ident.mechanism.tree import Tree
from ident.recordings.recording import Recording
from ident.recordings.wrench import Sensor, TotalWrench
from sim.models.mujoco_model import gravity_in_base, parameters_from_model, site_on_tree, tree_from_model
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.simulate import simulate

SCENE = "double_pendulum"


@dataclass(frozen=True, eq=False)
class Problem:
    """What is known beforehand, and the truth to compare with.

    Attributes:
        tree: The mechanism; it ends at the load cells.
        phi_true: Its stacked φ (30,).
        gravity: Acceleration of gravity in the base frame, m/s² (3,).
        sites: Site of each contact's load cell, which its channels are named after.
        sensors: Where these sit, by their sites.
    """

    tree: Tree
    phi_true: np.ndarray
    gravity: np.ndarray
    sites: Mapping[str, str]
    sensors: Mapping[str, Sensor]


@dataclass(frozen=True, eq=False)
class Study:
    """What the study found.

    Attributes:
        known: What was known beforehand.
        recording: Simulated recording.
        measured: Total wrench from the measured ground and contact wrenches.
        true: The same from true values.
        fit: Base parameters from the total wrench, by ordinary least squares as in the paper.
        weighted: The same, weighted by the sensors' covariance.
        ignoring: The same as `fit` as if there were no contact; of several contacts, as if there were not the one that
            is named, or not `all`.
    """

    known: Problem
    recording: Recording
    measured: TotalWrench
    true: TotalWrench
    fit: Trial
    weighted: Trial
    ignoring: Mapping[str, Trial]

    @property
    def several(self) -> bool:
        """Whether there are several contacts."""
        return len(self.known.sites) > 1

    @property
    def touching(self) -> dict[str, np.ndarray]:
        """When each contact touches (N,); one without a sensor for its normal force is held and never let go."""
        true = self.recording.true
        held = np.ones(len(self.recording.time))
        return {name: true.get(f"{name}_normal_force", held) > 0 for name in self.known.sites}


def study(*, seed: int = 0, samples: int = paper.SAMPLES, contact: str = "pad", noise_scale: float = 1.0) -> Study:
    """Simulates the double pendulum in contact and identifies it from ground and contact wrenches.

    Args:
        seed: Seed of all noise.
        samples: Samples recorded at 100 Hz.
        contact: One of `scenes.CONTACTS`, or several with spaces between.
        noise_scale: Factor on all noise.

    Raises:
        InputError: An argument makes no sense.
        ExcitationError: The motion does not separate the base parameters.
    """
    spec = scenes.load(SCENE, contact=contact)
    recording = simulate(spec, DOUBLE_PENDULUM, samples=samples, seed=seed, noise_scale=noise_scale)
    known = problem(contact)
    measured = total(known, recording)
    each = {name: {name} for name in known.sites} if len(known.sites) > 1 else {}

    def identified(wrench: TotalWrench, covariance: np.ndarray | None = None) -> Trial:
        return fit(known.tree, recording, known.phi_true, known.gravity, wrench=wrench.values, covariance=covariance)

    return Study(
        known=known,
        recording=recording,
        measured=measured,
        true=total(known, recording.noise_free),
        fit=identified(measured),
        weighted=identified(measured, measured.covariance if noise_scale else None),
        ignoring={
            name: identified(total(known, recording, ignored))
            for name, ignored in (each | {"all": known.sites}).items()
        },
    )


def problem(contact: str) -> Problem:
    """The mechanism of a contact scene and where its load cells sit."""
    model, sites = scenes.load(SCENE, contact=contact).compile(), scenes.load_cells(contact)
    return Problem(
        tree_from_model(model, "base"),
        parameters_from_model(model, "base"),
        gravity_in_base(model, "base"),
        sites,
        {site: Sensor(*site_on_tree(model, site, "base"), applied_to_link=False) for site in sites.values()},
    )


def total(known: Problem, recording: Recording, ignored: Collection[str] = ()) -> TotalWrench:
    """Eq. 17 on a recording: what the ground gives less what the links pass on to all contacts that are not ignored."""
    return recording.with_sensors(known.sensors).total_wrench(known.tree, [known.sites[name] for name in ignored])


def trial(known: Problem, recording: Recording) -> trials.Outcome:
    """Errors from one recording, with all contacts' wrenches."""
    wrench = total(known, recording).values
    return trials.outcome(fit(known.tree, recording, known.phi_true, known.gravity, wrench=wrench))
