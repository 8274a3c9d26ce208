"""Plates in the world in the trajectory estimate, on a floating base and beside a ground."""

from dataclasses import replace

import numpy as np
import pytest
import walker

import ident
import scenes
import sim
from ident.estimation.preparation import Part, prepared
from ident.judgement.finding import setup_findings
from ident.recordings.wrench import transform_wrench
from ident.setup import PRIORS
from ident.trajectory.trajectory_estimate import trajectory_estimate
from sim.motion.excitation import DOUBLE_PENDULUM

pytestmark = pytest.mark.slow

EXACT = dict.fromkeys(PRIORS, 0.0)


def on_plates(late=0, gains=(1,) * 6):
    """A person on a plate and a rail, both delayed by so many samples, with gains on the plate's channels."""
    rng = np.random.default_rng(0)
    person, (time, q, *_) = walker.mechanism(walker.SMALL), walker.motion()
    total, share = walker.truth(walker.SMALL)[0], 0.2 + 0.1 * np.sin(3 * walker.motion()[0])
    measured = {
        f"{joint}_position": q[late:, k] + 0.002 * rng.normal(size=len(q) - late)
        for k, joint in enumerate(person.tree.joints)
    }
    for name, taken, gain in (("plate", 1 - share, gains), ("rail", share, 1)):
        values = gain * (taken[:, None] * total) + rng.normal(size=total.shape) * [1, 1, 1, 0.3, 0.3, 0.3]
        values = values[: len(values) - late]
        measured |= {f"{name}_force": values[:, :3], f"{name}_torque": values[:, 3:]}
    sensors = {name: ident.Sensor(body, frame="world") for name, body in (("plate", "pelvis"), ("rail", "arm"))}
    return prepared(person, ident.Recording(time[late:], measured, sensors=sensors), cutoff=8.0)


def test_plates_that_are_late_are_found_where_nothing_holds_the_base():
    """The pelvis's coordinates are joints; a plate and a rail, both 30 ms late, add up to the total wrench."""
    ready = on_plates(late=3)
    result = trajectory_estimate(
        [Part(ready, slice(0, 300))], ready.equations, setup=EXACT | {"delay": 0.05}, knots=0.12
    )
    (finding,) = setup_findings(result)
    assert finding.text.startswith("The wrench 'plate + rail' is ") and abs(finding.value - 0.03) < 3 * finding.std
    assert finding.std < 0.002
    rank = ready.equations.parameters.rank
    error = result.fit.theta[:rank] - ready.equations.parameters.regroup(walker.mechanism(walker.SMALL).known)
    z = error / np.sqrt(np.diag(result.fit.covariance)[:rank])
    assert 0.5 < np.sqrt(np.mean(z**2)) < 1.5


def test_a_rail_in_the_world_tells_what_a_cell_on_the_link_does():
    """One noisy recording of the pendulum, with the hand's wrench in each of the two frames."""
    spec = scenes.load("double_pendulum", contact="handle")
    pendulum, recording = sim.mechanism(spec, base="base"), sim.simulate(spec, DOUBLE_PENDULUM)
    cell = ident.Sensor(*pendulum.site("contact"), applied_to_link=False)
    states = {name: x for name, x in recording.measured.items() if name.endswith(("_position", "_force", "_torque"))}
    states = {name: x for name, x in states.items() if not name.startswith(("link", "end"))}
    fixed = replace(recording, measured=states, true={}, sensors={"contact": cell})
    q = recording.noise_free.of_joints(pendulum.tree.joints, "position")
    link = pendulum.tree.poses(q)[:, pendulum.tree.names.index(cell.body)]
    values = transform_wrench(link @ cell.pose, fixed.wrench("contact").values)
    resting = replace(
        fixed,
        measured={**fixed.measured, "contact_force": values[:, :3], "contact_torque": values[:, 3:]},
        sensors={"contact": replace(cell, pose=np.eye(4), frame="world")},
    )
    fits = []
    for each in (fixed, resting):
        ready = prepared(pendulum, each, cutoff=8.0)
        fits.append(trajectory_estimate([Part(ready, slice(0, 500))], ready.equations, setup=EXACT, knots=0.1).fit)
    std = np.sqrt(np.diag(fits[0].covariance))
    assert np.abs((fits[1].theta - fits[0].theta) / std).max() < 0.5
    truth = ready.equations.parameters.regroup(pendulum.known)
    for fit in fits:
        z = (fit.theta - truth) / np.sqrt(np.diag(fit.covariance))
        assert np.sqrt(np.mean(z**2)) < 1.6
