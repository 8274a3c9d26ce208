"""The study of Section VII: a double pendulum whose links touch something, identified from all wrenches."""

from collections.abc import Collection, Mapping
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

import scenes
from experiments.cli.defaults import SCENE
from experiments.studies import paper, trials
from experiments.studies.fitting import JointTrial, Trial, fit, joint_fit, joint_fit_if_determined, without
from ident.mechanism.mechanism import Mechanism
from ident.parameters.base_parameters import structural_base_parameters
from ident.recordings.recording import Recording
from ident.recordings.wrench import Sensor, TotalWrench
from sim.models.mechanism import mechanism
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.simulate import simulate


@dataclass(frozen=True, eq=False)
class Study:
    """What the study found.

    Attributes:
        known: The mechanism, which ends at the load cells; its sites are theirs, by the contacts' names.
        recording: Simulated recording.
        measured: Total wrench from the measured ground and contact wrenches.
        true: The same from true values.
        fit: Base parameters from the total wrench, by ordinary least squares as in the paper.
        weighted: The same, weighted by the sensors' covariance.
        ignoring: The same as `fit` as if there were no contact; of several contacts, as if there were not the one that
            is named, or not `all`.
    """

    known: Mechanism
    recording: Recording
    measured: TotalWrench
    true: TotalWrench
    fit: Trial
    weighted: Trial
    ignoring: Mapping[str, Trial]

    @cached_property
    def joint(self) -> JointTrial:
        """Joint estimate from all wrenches."""
        return joint_fit_if_determined(self.known, with_cells(self.known, self.recording), self.fit.base)

    @cached_property
    def joint_ignoring(self) -> JointTrial:
        """The same as if there were no contact."""
        channels = [f"{site}_{kind}" for site in cells(self.known).values() for kind in ("force", "torque")]
        return joint_fit_if_determined(self.known, without(self.recording, channels), self.fit.base)

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
    pendulum = problem(contact)
    measured = total(pendulum, recording)
    each = {name: {name} for name in pendulum.sites} if len(pendulum.sites) > 1 else {}

    def identified(wrench: TotalWrench, covariance: np.ndarray | None = None) -> Trial:
        return fit(pendulum, recording, wrench=wrench.values, covariance=covariance)

    return Study(
        known=pendulum,
        recording=recording,
        measured=measured,
        true=total(pendulum, recording.noise_free),
        fit=identified(measured),
        weighted=identified(measured, measured.covariance if noise_scale else None),
        ignoring={
            name: identified(total(pendulum, recording, ignored))
            for name, ignored in (each | {"all": pendulum.sites}).items()
        },
    )


def problem(contact: str) -> Mechanism:
    """The mechanism of a contact scene, with the sites of its load cells under the names of their contacts."""
    pendulum = mechanism(scenes.load(SCENE, contact=contact).compile(), "base")
    return replace(pendulum, sites={name: pendulum.site(site) for name, site in scenes.load_cells(contact).items()})


def cells(pendulum: Mechanism) -> dict[str, str]:
    """For each contact the site of its load cell, which its channels are named after."""
    return scenes.load_cells(" ".join(pendulum.sites))


def total(pendulum: Mechanism, recording: Recording, ignored: Collection[str] = ()) -> TotalWrench:
    """Eq. 17 on a recording: what the ground gives less what the links pass on to all contacts that are not ignored."""
    return with_cells(pendulum, recording).total_wrench(pendulum.tree, [cells(pendulum)[name] for name in ignored])


def with_cells(pendulum: Mechanism, recording: Recording) -> Recording:
    """A recording, and where its load cells are."""
    sites = cells(pendulum).items()
    return recording.with_sensors({site: Sensor(*pendulum.sites[name], applied_to_link=False) for name, site in sites})


def trial(pendulum: Mechanism, recording: Recording) -> trials.Outcome:
    """Errors from one recording, with all contacts' wrenches."""
    return trials.outcome(fit(pendulum, recording, wrench=total(pendulum, recording).values))


def joint_trial(pendulum: Mechanism, recording: Recording) -> trials.Outcome:
    """Errors of the joint estimate from one recording, with all contacts' wrenches."""
    base = structural_base_parameters(pendulum)
    return trials.outcome(joint_fit(pendulum, with_cells(pendulum, recording), base))
