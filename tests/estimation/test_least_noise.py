"""Lower bounds on the noise of channels and coordinates: resolution, flat channels, coordinates at rest."""

import os
import warnings
from pathlib import Path

import numpy as np
import pytest
from coded import coded
from recorded_faults import PENDULUM, TRUTH, angles_and_wrench, faulty, wrench_of
from slow_pendulum import recorded

import ident
from experiments.studies.identification import prepare
from ident.estimation.channel_scales import LEAST, least_noise
from sim.models.notes import ModelNote

T = np.arange(1000) / 100


def test_floors_are_those_of_spread_resolution_and_kind():
    rng = np.random.default_rng(0)
    flat, coarse, fine = np.full(1000, 3.0), 0.3 * np.round(np.sin(T) / 0.3), 30 * np.sin(T) + rng.normal(size=1000)
    every = np.stack([flat, fine, coarse, flat, fine], axis=1)
    every[::7, 2] = np.nan
    floor = least_noise([every[:600], every[600:]], ("Fx", "Fy", "Fz", "joint1", "joint2"))
    of_fine = LEAST * fine.std()
    np.testing.assert_allclose(floor, [of_fine, of_fine, 0.3 / np.sqrt(12), of_fine, of_fine], rtol=1e-6)


def test_the_torque_of_a_finger_is_not_flat_beside_that_of_a_hip():
    rng = np.random.default_rng(0)
    torques = rng.normal(size=(1000, 3)) * [100.0, 0.05, 1e-5]
    floor = least_noise([torques], ("hip", "finger", "unplugged"))
    np.testing.assert_allclose(floor, LEAST * torques.std(axis=0)[[0, 1, 0]])


def test_noise_is_no_less_than_that_of_rounding():
    """For slow motions in coarse steps, the fit's residuals are far smaller than the steps."""
    steps = {"forces": 0.3, "moments": 0.03, "angles": 2 * np.pi / 4096}
    estimate = ident.identify(PENDULUM, recorded(speed=0.1, jitter=0, **steps))
    noise, floor = estimate.trajectory.fit.noises[0], np.array([0.3, 0.3, 0.3, 0.03, 0.03, 0.03]) / np.sqrt(12)
    components = [ident.estimation.equations.COMPONENTS.index(name) for name in estimate.channels]
    assert (noise.channels > 0.99 * floor[components]).all()
    assert (noise.states[0] > 0.99 * steps["angles"] / np.sqrt(12)).all()


def flat_for_a_while(channel, value=0.0):
    """A recording with a component that is constant in the fitted part, and then goes on in steps of 0.3."""
    recording = faulty(1)
    wrench = wrench_of(recording)
    wrench[:, channel] = value + 0.3 * ((np.arange(len(wrench)) > 650) & (np.arange(len(wrench)) % 9 == 0))
    return angles_and_wrench(recording.time, recording.of_joints(PENDULUM.tree.joints, "position"), wrench)


@pytest.mark.parametrize("estimator", ["trajectory", "weighted"])
@pytest.mark.parametrize("value", [0.0, 1.0])
def test_a_channel_that_is_flat_where_it_is_fitted_is_left_out(estimator, value):
    estimate = ident.identify(PENDULUM, flat_for_a_while(0, value), estimator=estimator)
    assert estimate.channels == ("Fy", "Fz", "Mx", "My", "Mz") and not estimate.prepared.stuck
    assert "Fx never change in what is fitted, nor do they by the model, and are left out." in estimate.prepared.notes
    assert np.isfinite(estimate.std_setup).all() and np.isfinite(estimate.held_out.residual).all()
    if estimator == "trajectory":
        assert (abs(estimate.psi - TRUTH) < 4 * estimate.std_setup).all()


def test_one_that_should_change_there_is_called_stuck():
    estimate = ident.identify(PENDULUM, flat_for_a_while(4))
    assert estimate.prepared.stuck == (("My", 0.0, True),)
    (finding,) = coded(estimate, "stuck_channels")
    assert finding.doubt and "My (0 in what is fitted)" in finding.text


def test_what_is_known_of_bodies_is_symmetric():
    """A plain inverse is asymmetric by more than its smallest eigenvalue if light bodies hang on joints at rest."""
    precision = ident.identify(PENDULUM, faulty(), known=True).trajectory.fit.prior.precision
    np.testing.assert_array_equal(precision, precision.T)


@pytest.mark.skipif("MULTICONTACT_DATA" not in os.environ, reason="needs the recorded data in MULTICONTACT_DATA")
def test_a_walkers_forearms_rest():
    """Forearms rest at the joints' limits, and none of their columns may be left out."""
    folder = Path(os.environ["MULTICONTACT_DATA"]) / "subject4_walking"
    log = f"{folder / 'walking1_ik.mot'}+{folder / 'walking1_grf.mot'}"
    fix = {"mtp_angle_r": (), "mtp_angle_l": ()}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", ModelNote)
        walker = prepare(folder / "subject4.osim", Path(log), columns=folder / "columns.toml", fix=fix)
    rests = [note for note in walker.notes if "rests" in note]
    assert rests == ["'pro_sup_r' rests at 2.09.", "'pro_sup_l' rests at 2.09."]


@pytest.mark.parametrize("seed", range(3))
def test_a_joint_at_rest_is_held_where_it_is(seed):
    """The angle of a joint at rest is one number, without noise."""
    estimate = ident.identify(PENDULUM, recorded(seed, speed=1.5, rests=0.7, noise=1))
    assert estimate.prepared.notes == ("'joint2' rests at 0.7.",)
    fit = estimate.trajectory.fit
    assert fit.status == "converged" and not estimate.trajectory.search.incredible
    for c in fit.coefficients:
        np.testing.assert_allclose(c[:, 1], 0.7, atol=1e-3)
    assert (abs(estimate.psi - TRUTH) < 3 * estimate.std_setup).all()
    assert (estimate.held_out.ratio[1:] < 1.05 * estimate.rivals["model"][1:] + 0.01).all()
