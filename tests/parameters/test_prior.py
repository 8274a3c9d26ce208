"""Priors on bodies, stated and from tables of people: against random bodies, and by hand."""

from dataclasses import replace

import driven_arm
import numpy as np
import pytest
from scipy.linalg import block_diag

import scenes
import sim
from ident import InputError, Mechanism, Tree
from ident.geometry import se3
from ident.geometry.inertia import com_from_parameters, parameter_transform, parameters_from_com
from ident.mechanism.body import BASE, Body, Follower
from ident.parameters import prior as priors
from ident.parameters.base_parameters import find_base_parameters, structural_base_parameters
from ident.parameters.person_prior import SEXES, TABLES, Person, Placed, segments, with_person
from ident.parameters.prior import (
    KNOWN,
    OPEN,
    UNKNOWN,
    body_covariance,
    known_covariance,
    known_covariances,
)

CENTRAL = np.array([[0.06, 0.01, -0.005], [0.01, 0.05, 0.002], [-0.005, 0.002, 0.03]])


@pytest.mark.parametrize(
    ("phi", "known"),
    [
        (parameters_from_com(3.0, [0.1, -0.05, 0.3], CENTRAL), KNOWN),
        (parameters_from_com(3.0, np.zeros(3), CENTRAL), {"mass": 0.4, "center": 0.02, "inertia": 0.1}),
        (parameters_from_com(0.5, np.zeros(3), np.zeros((3, 3))), KNOWN),
    ],
    ids=["far from its frame", "around its frame", "a point"],
)
def test_bodies_that_are_drawn_deviate_as_is_known(phi, known):
    rng, count = np.random.default_rng(0), 20_000
    mass, center, inertia = com_from_parameters(phi)
    values, axes = np.linalg.eigh(inertia)
    root = (axes * np.sqrt(np.maximum(values, 0))) @ axes.T
    m = mass * (1 + known["mass"] * rng.normal(size=count))
    c = center + known["center"] * rng.normal(size=(count, 3))
    # (G + Gᵀ) / 2 has variance 1 on the diagonal and 1/2 off it.
    G = rng.normal(size=(count, 3, 3))
    tensor = inertia + known["inertia"] * root @ ((G + G.swapaxes(1, 2)) / 2) @ root
    squares = np.sum(c**2, axis=1)[:, None, None] * np.eye(3) - c[:, :, None] * c[:, None, :]
    tensor += m[:, None, None] * squares
    off = np.column_stack([m, m[:, None] * c, tensor[:, [0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]]) - phi
    products = off[:, :, None] * off[:, None, :]
    error = products.std(axis=0) / np.sqrt(count)
    assert (abs(products.mean(axis=0) - body_covariance(phi, known)) <= 5 * error + 1e-12).all()


def test_all_parameters_follow_from_an_estimate_of_base_parameters():
    arm, rng = sim.mechanism(scenes.load("humanoid"), base="pelvis"), np.random.default_rng(0)
    base = structural_base_parameters(arm)
    S, prior = block_diag(*known_covariances(arm)), base.regroup(arm.known)
    B = base.regroup(np.eye(len(S))).T
    before = known_covariance(arm, base)
    np.testing.assert_allclose(B @ S @ B.T, before, atol=1e-6 * np.diag(before).max())
    # Observed base parameters, and the estimate with their prior.
    noise = np.diag(rng.uniform(0.1, 2, size=len(prior)) * np.diag(before))
    measured = prior + rng.normal(size=len(prior)) * np.sqrt(np.diag(before + noise))
    phi, std = priors.conditioned(arm, base, measured, noise, included=False)
    direct = S @ B.T @ np.linalg.inv(before + noise)
    np.testing.assert_allclose(phi, arm.known + direct @ (measured - prior), rtol=1e-5, atol=1e-8)
    np.testing.assert_allclose(std, np.sqrt(np.diag(S - direct @ B @ S)), rtol=1e-4, atol=1e-9)


def test_the_variances_that_bayes_rule_leaves():
    """Nothing is identified by noise, and no more than the rank by perfect data."""
    arm = sim.mechanism(scenes.load("double_pendulum"), base="base")
    base, S = find_base_parameters(arm), block_diag(*known_covariances(arm))
    L = np.random.default_rng(0).normal(size=(base.rank, base.rank))
    covariance, B = 1e-3 * L @ L.T, base.regroup(np.eye(len(S))).T
    after = np.linalg.inv(np.linalg.inv(S) + B.T @ np.linalg.inv(covariance) @ B)
    expected = (1 - np.diag(np.linalg.solve(S, after))).reshape(-1, 10).sum(axis=1)
    both = np.linalg.inv(np.linalg.inv(covariance) + np.linalg.inv(B @ S @ B.T))
    for given, included in ((covariance, False), (both, True)):
        identified = priors.parameters_identified(arm, base, given, included=included)
        np.testing.assert_allclose(identified, expected, atol=1e-4)
    assert priors.parameters_identified(arm, base, 1e12 * np.eye(base.rank)).max() < 1e-6
    perfect = priors.parameters_identified(arm, base, 1e-12 * np.eye(base.rank))
    assert perfect.sum() == pytest.approx(base.rank, abs=0.01) and perfect.max() <= 10


def test_drives_are_known_as_the_model_states_them_and_others_not_at_all():
    """As columns of their own, and as parts of base parameters."""
    arm, names = driven_arm.mechanism(), ("Ia(turn)", "Fv(lift)", "K(bend)")
    np.testing.assert_allclose(priors.drive_precision(arm, names, {"lift"}), [0.2**-2, 0, 0])
    base, own = find_base_parameters(arm), np.random.default_rng(0).normal(size=20)
    before = known_covariance(arm, base)
    total, own = np.trace(before), own[: base.rank]
    for name, variance in (("Ia(turn)", 0.2**2 * own @ own), ("K(bend)", UNKNOWN**2 * total)):
        added = known_covariance(arm, base, absorbed={name: own}) - before
        np.testing.assert_allclose(added, variance * np.outer(own, own) / (own @ own), rtol=1e-5, atol=1e-9 * variance)
    at_rest = known_covariance(arm, base, absorbed={"Ia(turn)": 0 * own})
    np.testing.assert_array_equal(at_rest, before)


GRAVITY, HINGE = np.array([0, -9.81, 0]), np.eye(6)[5]


def at(x, y):
    return se3.pose(np.eye(3), np.array([x, y, 0]))


def leg():
    """Pelvis, thigh of 0.4 m, shank of 0.42 m whose frame is 0.1 m below the knee, patella and foot."""
    below_knee = np.array([0.1, 0, 0, 0, 0, 1.0])
    bodies = (
        Body("pelvis", BASE, at(0, 1), HINGE, "tilt"),
        Body("thigh_r", 0, at(0.1, -0.1), HINGE, "hip"),
        Body("slide", 1, at(0, -0.4), np.eye(6)[0], "", True, Follower("knee", (0.0, 0.02))),
        Body("shank_r", 2, at(0, -0.1), below_knee, "knee"),
        Body("patella", 1, at(0.05, -0.38), HINGE, "", False, Follower("knee", (0.0, 0.5))),
        Body("foot_r", 3, at(0, -0.32), HINGE, "ankle"),
    )
    prior = np.zeros((5, 10))
    prior[:, 0] = 10, 8, 4, 0.1, 1
    prior[-1, 1:4] = 0.1, -0.05, 0
    return Mechanism(Tree(bodies), GRAVITY, prior.ravel())


def test_a_hand_is_as_long_as_its_owners_height_says_toward_the_models_own_centre():
    bodies = (Body("forearm", BASE, np.eye(4), HINGE, "elbow"), Body("hand", 0, at(0, -0.3), HINGE, "wrist"))
    prior = np.zeros((2, 10))
    prior[:, 0], prior[1, 1:4] = (1.0, 0.5), (0.03, -0.04, 0)
    arm = with_person(Mechanism(Tree(bodies), GRAVITY, prior.ravel()), Person("deleva", 70, 1.9, "male"))
    length = 0.0862 / 1.741 * 1.9
    np.testing.assert_allclose(arm.prior[11:14] / arm.prior[10], 0.79 * length * np.array([0.6, -0.8, 0]), rtol=1e-12)


def test_a_body_that_no_model_states_may_lie_as_far_off_as_it_is_large():
    """Between joints 0.4 m apart a ball of that diameter is the guess."""
    bodies = (Body("open", BASE, np.eye(4), HINGE, "a"), Body("arm", 0, at(0.24, 0.32), HINGE, "b"))
    prior = np.zeros((2, 10))
    prior[1] = parameters_from_com(2.0, [0.1, 0, 0], 0.01 * np.eye(3))
    opened = known_covariances(Mechanism(Tree(bodies), GRAVITY, prior.ravel()))[0]
    mean_square = 0.3 * 0.4**2 + 2 * 0.2**2
    assert opened[0, 0] == pytest.approx(2**2 * (OPEN**2 + 1))
    assert opened[3, 3] == pytest.approx(2**2 * (OPEN**2 + 1) * mean_square)


OF_TRUNK = {
    "winter": ("head_and_trunk",),
    "deleva": ("head", "upper_trunk", "middle_trunk", "lower_trunk"),
    "dumas": ("head", "torso", "pelvis"),
}
OF_LIMBS = ("upper_arm", "forearm", "hand", "thigh", "shank", "foot")


@pytest.mark.parametrize("table", TABLES)
def test_segments_make_up_a_person_and_are_much_alike_for_both_sexes(table):
    women, men = (segments(table, sex) for sex in SEXES)
    for person in (women, men):
        mass = {name: segment.mass for name, segment in person.items()}
        whole = sum(mass[name] for name in OF_TRUNK[table]) + 2 * sum(mass[name] for name in OF_LIMBS)
        assert whole == pytest.approx(1, abs=0.003)
    for name, hers in women.items():
        his = men[name]
        for one, other in ((hers, his), (his, hers)):
            assert max(one.mass / other.mass, one.center / other.center, one.across / other.across) < 1.45
            assert one.along < 1.45 * other.along and one.along < np.sqrt(2) * one.across


def test_winters_radii_about_the_centre_are_those_about_the_proximal_end():
    """His table has both; those of the whole leg differ by 0.007."""
    about_proximal = {"head_and_trunk": 0.830, "hat": 0.798, "upper_arm": 0.542, "forearm": 0.526, "hand": 0.587}
    about_proximal |= {"forearm_and_hand": 0.827, "arm": 0.645, "thigh": 0.540, "shank": 0.528, "foot": 0.690}
    about_proximal |= {"leg": 0.560, "shank_and_foot": 0.735}
    own = {name: np.hypot(each.center, each.across) for name, each in segments("winter", "male").items()}
    assert own == pytest.approx(about_proximal, abs=0.008)


DUMAS = Person("dumas", 80, 1.8, "male")


def test_what_cannot_be_known_is_asked_for():
    for placed, message in (
        ({"foot_r": Placed("foot")}, "'foot_r' goes from ankle to metatarsal heads; say where in its frame, in m, as"),
        ({"nose": Placed("foot")}, "got nose = 'foot'"),
        ({"foot_r": Placed("nose")}, "thigh, shank, foot; got foot_r = 'nose'"),
        ({}, "No body is named as a segment"),
    ):
        with pytest.raises(InputError, match=message):
            with_person(leg(), DUMAS, placed)


def test_a_segment_does_not_depend_on_the_axes_of_its_body():
    arm, turn = leg(), se3.exp(np.array([0, 0, 0, 0.6, 0.64, 0.48]), 0.7)
    back, bodies = se3.inverse(turn), list(arm.tree.bodies)
    for k in (arm.tree.names.index(name) for name in ("thigh_r", "shank_r")):
        bodies = [replace(each, home=back @ each.home) if each.parent == k else each for each in bodies]
        bodies[k] = replace(bodies[k], home=bodies[k].home @ turn, twist=se3.Ad(back) @ bodies[k].twist)
    arms = arm, replace(arm, tree=Tree(tuple(bodies)))
    usual, turned = (with_person(each, DUMAS, {"thigh_r": Placed("thigh")}).prior for each in arms)
    np.testing.assert_allclose(turned[10:20], parameter_transform(back) @ usual[10:20], atol=1e-12)
    np.testing.assert_allclose(usual[10:14], 0.123 * 80 * np.array([1, 0, 0.429 * -0.4, 0]), atol=1e-4)


def test_what_is_known_of_base_parameters_has_these_widths():
    arm = with_person(leg(), Person("deleva", 70, 1.75, "male"), {"thigh_r": Placed("thigh")})
    base = structural_base_parameters(arm)
    mine = known_covariance(arm, base, KNOWN)
    without = known_covariance(Mechanism(arm.tree, GRAVITY, arm.prior), base, KNOWN)
    thigh = arm.prior[10:20]
    change = body_covariance(thigh, arm.prior_known["thigh_r"]) - body_covariance(thigh)
    B = base.regroup(np.eye(50)).T[:, 10:20]
    np.testing.assert_allclose(mine - without, B @ change @ B.T, atol=1e-6)
