"""Intervals of bodies: against closed forms, how often they have the truth, and what has none."""

from dataclasses import replace

import numpy as np
import pytest
from bodies import measured, weighed
from mechanisms import GRAVITY, random_phi, random_tree
from scipy.optimize import minimize

from ident.display.bodies import QUANTITIES
from ident.geometry.inertia import parameter_names, parameters_from_com, with_centers
from ident.mechanism.body import Body
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import BASE, Tree
from ident.parameters.base_parameters import BaseParameters, find_base_parameters
from ident.parameters.body_bounds import BodyPrior, Rotors
from ident.parameters.consistency import consistent_parameters
from ident.parameters.prior import KNOWN, guessed
from ident.parameters.structure import Sensors
from ident.payload.identified_payload import GUESSED

EVERY = BaseParameters(parameter_names(1), tuple(range(10)), (), np.zeros((10, 0)), (1.0, 0.0))
"""All ten parameters of one body as base parameters."""

TORQUES = Sensors(base_wrench=False, joint_torques=True)
ROD = parameters_from_com(0.675, [0, 0, -0.434], np.diag([0.003, 0.003, 0.0005]))
HINGE = np.array([0.0, 0, 0, 0, 1, 0])


def pendulum(prior=ROD):
    """A rod on a hinge, with the base parameters of its torque: `m rx`, `m rz` and `Iyy`."""
    arm = Mechanism(Tree((Body("rod", BASE, np.eye(4), HINGE, "hinge"),)), GRAVITY, prior)
    return arm, find_base_parameters(arm, sensors=TORQUES)


def estimated(psi, std, base, arm, **given):
    return consistent_parameters(psi, np.diag(np.square(std)), base, guessed(arm), bodies=arm.bodies, **given)


def test_bounds_of_a_pendulum_are_those_of_its_cone():
    """The mass has a lower limit alone, `(m rz)²/Iyy` at its least within 3.84 of the estimate."""
    arm, base = pendulum()
    assert base.names == ("m1rx1", "m1rz1", "Iyy1")
    psi, std = np.array([0, -0.1012, 0.0182]), np.array([1e-3, 3e-3, 6e-4])
    full = estimated(psi, std, base, arm)
    least = minimize(
        lambda x: (psi[1] + x[0] * std[1]) ** 2 / (psi[2] + x[1] * std[2]),
        [0, 0],
        constraints={"type": "ineq", "fun": lambda x: 3.84 - x @ x},
    ).fun
    lower, upper = full.intervals[0, 0]
    assert lower == pytest.approx(least, rel=5e-3) and upper == np.inf
    np.testing.assert_allclose(full.intervals[0, 5], psi[2] + np.array([-1.96, 1.96]) * std[2], rtol=2e-3)
    mass, height = full.rows[0], full.rows[QUANTITIES.index("centre y")]
    assert mass.words == f"not determined (more than {lower:.3g})" and mass.share == 0
    assert height.words == "not determined" and not np.isfinite(height.upper)


@pytest.mark.slow
def test_intervals_of_a_body_have_the_truth_in_95_of_100_cases(noise=0.03):
    inside = 0
    for seed in range(100):
        rng = np.random.default_rng(seed)
        truth, root = random_phi(rng, 1), rng.normal(size=(10, 10))
        C = noise**2 * (root @ root.T + 0.1 * np.eye(10)) * np.outer(abs(truth), abs(truth))
        full = consistent_parameters(measured(rng, truth, C), C, EVERY, random_phi(rng, 1), width=1.0)
        limits, own = full.intervals[0], with_centers(truth)[0]
        inside += (limits[:, 0] <= own) & (own <= limits[:, 1])
    assert 0.93 <= np.sum(inside) / 1000 <= 0.97 and np.min(inside) >= 88


def test_a_guess_of_the_same_mass_and_centre_leaves_an_inertia_where_data_have_it():
    """A measuring tape, guessed to be a ball of thrice its moments; a width from its mass would keep the ball."""
    std = np.repeat([1.5e-4, 1e-5, 2e-5], [1, 3, 6])
    tape, ball = (
        parameters_from_com(0.136, np.array([0, 0, 0.027]), np.diag(x)) for x in ([3.5e-5, 5.7e-5, 3.1e-5], 3 * [9e-5])
    )
    z = []
    for seed in range(10):
        psi = tape + std * np.random.default_rng(seed).normal(size=10)
        full = consistent_parameters(psi, np.diag(std**2), EVERY, ball, width=GUESSED)
        z.append((full.phi - tape) / std)
    assert np.sqrt(np.mean(np.square(z), axis=0)).max() < 1.6
    kept = consistent_parameters(psi, np.diag(std**2), EVERY, ball)
    assert np.abs((kept.phi - tape) / std).max() > 2


def test_intervals_of_links_have_the_truth_in_95_of_100_cases_or_more():
    """Links of which base parameters are known alone, whose intervals are those of the set."""
    inside = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        tree, count = random_tree(rng, 3 + seed % 3, ("revolute",), chain=True), 3 + seed % 3
        base, truth = find_base_parameters(tree), random_phi(rng, count)
        C = weighed(tree, base, truth, rng, 0.02)
        full = consistent_parameters(measured(rng, base.regroup(truth), C), C, base, random_phi(rng, count))
        limits, own = full.intervals, with_centers(truth)
        inside.append(((limits[..., 0] <= own) & (own <= limits[..., 1])).mean())
    assert np.mean(inside) >= 0.95


def test_what_a_prior_states_binds_the_bodies():
    """A rod of the model's mass whose centre is at a third of the model's."""
    arm, base = pendulum()
    arm = replace(arm, prior_known={"rod": {"mass": 0}})
    psi, none = np.array([0, -0.10125, 0.0181875]), Rotors.none(3)
    full = estimated(psi, [1e-3, 3e-3, 6e-4], base, arm)
    for _ in range(3):
        known = BodyPrior.of(arm, base, KNOWN, none, used=True, at=full.phi)
        full = estimated(psi, [1e-3, 3e-3, 6e-4], base, arm, known=known)
    assert full.attainable and full.phi[0] == pytest.approx(0.675, rel=1e-4)
    assert full.values[0, 3] == pytest.approx(-0.15, abs=5e-4) and full.rows[0].words == "0.675 (as stated)"
    lower, upper = full.intervals[0, 3]
    assert -0.165 < lower < -0.155 and -0.145 < upper < -0.135 and full.rows[3].determined
