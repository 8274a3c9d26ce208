"""Several recordings: noise, knots, friction and offsets of their own."""

from dataclasses import replace

import driven_arm
import numpy as np
import pytest
import swinging
from coded import coded
from driven_arm import JOINTS
from recorded_faults import PENDULUM, faulty, shortened
from swinging import NOISE

import ident
from ident.estimation.preparation import Part, prepared
from ident.trajectory.trajectory_estimate import trajectory_estimate

KNOWN = {"mass": 0.2, "center": 0.05, "inertia": 0.3}


@pytest.mark.parametrize(("samples", "used"), [(60, True), (600, False)])
def test_a_model_is_a_prior_of_recordings_too_short_to_determine_the_bodies(samples, used):
    log = prepared(PENDULUM, shortened(faulty(0), samples), cutoff=10.0)
    estimate = trajectory_estimate([Part(log, slice(0, len(log.samples)))], log.equations, search=False, fallback=KNOWN)
    assert estimate.known == used
    if used:
        without, with_prior = np.log(estimate.errors["prior"]).mean(axis=1)
        assert with_prior < without - 0.2


def test_friction_and_offsets_that_differ_are_each_logs_own():
    """Of two logs with more and with less, the mean predicts a third one to its noise."""
    friction, logs = np.array(driven_arm.TRUE["frictionloss"]), []
    for seed, share, offset in ((0, 0.6, -0.15), (1, 1.4, 0.15)):
        log, (_, _, rate, _) = driven_arm.log(7.0, seed=seed), driven_arm.motion(np.random.default_rng(seed), 7.0)
        more = (share - 1) * friction * np.tanh(rate / 0.003) + offset
        torques = {f"{j}_torque": log.measured[f"{j}_torque"] + x for j, x in zip(JOINTS, more.T, strict=True)}
        logs.append(replace(log, measured={**log.measured, **torques}))
    estimate = ident.identify(driven_arm.mechanism(), logs, held_out=driven_arm.log(7.0, seed=2))
    first, other, mean = (estimate.trajectory.parameters_of(k) for k in (0, 1, None))
    coulomb, offsets = ([estimate.fit.names.index(f"{kind}({joint})") for joint in JOINTS] for kind in ("Fc", "offset"))
    np.testing.assert_allclose(first[coulomb], 0.6 * friction, rtol=0.03)
    np.testing.assert_allclose(other[coulomb], 1.4 * friction, rtol=0.03)
    np.testing.assert_allclose(other[offsets] - first[offsets], 0.3, atol=0.01)
    np.testing.assert_allclose(mean[: len(first)], (first + other) / 2, atol=1e-12)
    (finding,) = coded(estimate, "own_in_logs")
    assert set(finding.values["values"]) >= {f"Fc({joint})" for joint in JOINTS}
    assert (estimate.held_out.ratio < 0.03).all()


def test_every_recording_has_noise_of_its_own():
    """Of two recordings of one motion, the second has eight times as much noise in the wrench."""
    rng = np.random.default_rng(0)
    quiet, loud = swinging.streams(rng), swinging.streams(rng)
    for name in ("ground_force", "ground_torque"):
        time, values = loud[name]
        loud[name] = time, values + np.sqrt(8**2 - 1) * NOISE[name] * rng.normal(size=values.shape)
    logs = [ident.Recording.from_streams(each) for each in (quiet, loud)]
    fit = ident.identify(swinging.pendulum(), logs, holdout=0).trajectory.fit
    std = np.repeat([NOISE["ground_force"], NOISE["ground_torque"]], 3)
    for own, times in zip((*(x.channels for x in fit.noises), fit.channel_noise), (1, 8, np.sqrt(32.5)), strict=True):
        np.testing.assert_allclose(own, times * std, rtol=0.1)


@pytest.mark.slow
@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_knots_are_as_dense_as_each_recording_needs(order):
    """A motion four times as fast needs knots about four times as dense."""
    logs = [driven_arm.log(4.0, pace=pace) for pace in (1.0, 4.0)]
    steps = ident.identify(driven_arm.mechanism(), [logs[k] for k in order]).trajectory.steps
    slow, fast = (steps[k] for k in np.argsort(order))
    assert 2.5 * fast < slow
