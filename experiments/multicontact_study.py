"""The study of Section VII: a double pendulum whose last link touches something, identified from both wrenches."""

from dataclasses import dataclass

import numpy as np

import scenes
from experiments import trials
from experiments.fitting import Fit, fit
from ident.tree import Tree
from ident.wrench import Contact, TotalWrench, total_wrench
from sim.excitation import DOUBLE_PENDULUM
from sim.mujoco_model import gravity_in_base, parameters_from_model, site_on_tree, tree_from_model
from sim.recording import Recording
from sim.simulate import SAMPLES, simulate

SCENE = "double_pendulum"
SENSOR = "contact"
"""Site of the load cell, and name of its channels."""


@dataclass(frozen=True, eq=False)
class Problem:
    """What is known beforehand, and the truth to compare with.

    Attributes:
        tree: The mechanism; it ends at the load cell.
        phi_true: Its stacked φ (30,).
        gravity: Acceleration of gravity in the base frame, m/s² (3,).
        body: Link that carries the load cell.
        pose: Pose of the load cell's frame in that link's (4, 4).
    """

    tree: Tree
    phi_true: np.ndarray
    gravity: np.ndarray
    body: str
    pose: np.ndarray


@dataclass(frozen=True, eq=False)
class Study:
    """What the study found.

    Attributes:
        recording: Simulated recording.
        measured: Total wrench from the measured ground and contact wrenches.
        true: The same from true values.
        fit: Base parameters from the total wrench, by ordinary least squares as in the paper.
        weighted: The same, weighted by the sensors' covariance.
        ignoring: Base parameters from the ground wrench alone, as if there were no contact.
    """

    recording: Recording
    measured: TotalWrench
    true: TotalWrench
    fit: Fit
    weighted: Fit
    ignoring: Fit


def study(*, seed: int = 0, samples: int = SAMPLES, contact: str = "pad", noise_scale: float = 1.0) -> Study:
    """Simulates the double pendulum in contact and identifies it from ground and contact wrench.

    Args:
        seed: Seed of all noise.
        samples: Samples recorded at 100 Hz.
        contact: One of `scenes.CONTACTS`.
        noise_scale: Factor on all noise.

    Raises:
        ValueError: An argument makes no sense, or the motion does not separate the base parameters.
    """
    spec = scenes.load(SCENE, contact=contact)
    recording = simulate(spec, DOUBLE_PENDULUM, samples=samples, seed=seed, noise_scale=noise_scale)
    known = problem(contact)
    measured = total(known, recording)

    def with_contact(covariance: np.ndarray | None) -> Fit:
        return fit(known.tree, recording, known.phi_true, known.gravity, wrench=measured.wrench, covariance=covariance)

    return Study(
        recording=recording,
        measured=measured,
        true=total(known, recording.noise_free),
        fit=with_contact(None),
        weighted=with_contact(measured.covariance if noise_scale else None),
        ignoring=fit(known.tree, recording, known.phi_true, known.gravity),
    )


def problem(contact: str) -> Problem:
    """The mechanism of a contact scene and where its load cell sits."""
    model = scenes.load(SCENE, contact=contact).compile()
    body, pose = site_on_tree(model, SENSOR, "base")
    return Problem(
        tree_from_model(model, "base"), parameters_from_model(model, "base"), gravity_in_base(model, "base"), body, pose
    )


def total(known: Problem, recording: Recording) -> TotalWrench:
    """Eq. 17 on a recording: what the ground gives less what the link passes on."""
    q, _, _ = recording.joint_states(known.tree.joints)
    cell = Contact(
        known.body, recording.wrench(SENSOR), known.pose, recording.wrench_covariance(SENSOR), recording.time
    )
    return total_wrench(
        known.tree,
        q,
        recording.wrench("ground"),
        [cell],
        ground_covariance=recording.wrench_covariance("ground"),
        time=recording.time,
    )


def trial(known: Problem, recording: Recording) -> trials.Outcome:
    """Errors from one recording, with the contact's wrench."""
    wrench = total(known, recording).wrench
    return trials.outcome(fit(known.tree, recording, known.phi_true, known.gravity, wrench=wrench))
