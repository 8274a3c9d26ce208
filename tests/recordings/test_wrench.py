import numpy as np
import pytest
from mechanisms import GRAVITY, random_phi, random_pose, random_states, random_tree

from ident import Mechanism, Motion, Wrench, total_wrench
from ident.geometry import se3
from ident.model import dim
from ident.recordings.wrench import transform_wrench


@pytest.fixture(params=range(4))
def rng(request):
    return np.random.default_rng(request.param)


@pytest.fixture
def tree(rng):
    return random_tree(rng)


@pytest.fixture
def contacts(rng, tree):
    """Random bodies, the wrenches (3, 6) of their links on what touches them, and poses of the sensors."""
    bodies = rng.choice(tree.names, size=rng.integers(1, 5)).tolist()
    return [(body, rng.normal(size=(3, 6)), random_pose(rng)) for body in bodies]


def by_link(contacts, **given):
    return [Wrench(wrench, body, pose, applied_to_link=False, **given) for body, wrench, pose in contacts]


def test_transport_conserves_power_and_composes(rng):
    a, b, F, V = random_pose(rng), random_pose(rng), rng.normal(size=6), rng.normal(size=6)
    assert np.isclose(transform_wrench(a, F) @ (se3.Ad(a) @ V), F @ V)
    np.testing.assert_allclose(transform_wrench(a @ b, F), transform_wrench(a, transform_wrench(b, F)), atol=1e-11)


def test_equation_15_walked_down_the_tree_gives_equation_17(rng, tree, contacts):
    phi = random_phi(rng, len(tree.inertial))
    motion, mechanism = Motion(*random_states(rng, tree, 3)), Mechanism(tree, GRAVITY, phi)
    ground = np.zeros((3, 6))
    for k in range(3):
        # Eq. 15: each link passes on its children's wrenches, its own motion's, and its contact's.
        T, V, dV = dim.forward_recursion(mechanism, motion[k])
        force = np.zeros((len(tree.bodies), 6))
        for i, phi_i in zip(tree.inertial, phi.reshape(-1, 10), strict=True):
            force[i] = dim.body_regressor(V[i], dV[i]) @ phi_i
        for body, wrench, pose in contacts:
            force[tree.names.index(body)] += se3.coAd(pose) @ wrench[k]
        for i in reversed(range(len(tree.bodies))):
            parent = tree.bodies[i].parent
            (ground[k] if parent < 0 else force[parent])[:] += se3.coAd(T[i]) @ force[i]
    expected = np.array([dim.base_wrench_regressor(mechanism, sample) for sample in motion]) @ phi
    close = {"rtol": 1e-7, "atol": 1e-10 * abs(ground).max()}
    total = total_wrench(tree, motion.q, Wrench(ground), by_link(contacts))
    np.testing.assert_allclose(total.values, expected, **close)
    assert total.covariance is None
    # The ground, measured in another frame, with opposite sign, and without two of its components.
    plate = random_pose(rng)
    there = transform_wrench(se3.inverse(plate), -ground)
    measured, partial = (
        Wrench(x, pose=plate, applied_to_link=False) for x in (there, there * [1, np.nan, 1, 1, 1, np.nan])
    )
    elsewhere, missing = (total_wrench(tree, motion.q, each, by_link(contacts)) for each in (measured, partial))
    np.testing.assert_array_equal(elsewhere.frame, plate)
    np.testing.assert_allclose(elsewhere.in_base, expected, **close)
    np.testing.assert_array_equal(missing.values, elsewhere.values * [1, np.nan, 1, 1, 1, np.nan])


def test_a_wrench_applied_to_the_link_has_the_other_sign_and_no_ground_is_one_of_zero(rng, tree, contacts):
    q, zero = random_states(rng, tree, 3)[0], Wrench(np.zeros((3, 6)), covariance=np.zeros((6, 6)))
    own, certain = by_link(contacts, covariance=np.eye(6)), by_link(contacts)
    to_link = [Wrench(-wrench, body, pose, covariance=np.eye(6)) for body, wrench, pose in contacts]
    expected = total_wrench(tree, q, zero, own)
    for total in (total_wrench(tree, q, None, own), total_wrench(tree, q, zero, to_link)):
        np.testing.assert_array_equal(total.values, expected.values)
        np.testing.assert_array_equal(total.covariance, expected.covariance)
    assert total_wrench(tree, q, None, certain).covariance is None


def test_what_rests_in_the_world_reaches_the_base_without_any_posture(rng, tree, contacts):
    """The same wrenches in the bodies' frames, whose poses differ from sample to sample, and their covariances."""
    q, C = random_states(rng, tree, 3)[0], np.diag(rng.uniform(1, 2, 6))
    ground = Wrench(rng.normal(size=(3, 6)), pose=random_pose(rng), covariance=C)
    for at in (np.array([random_pose(rng) for _ in range(3)]), None):
        world = by_link(contacts, covariance=C, frame="world")
        felt = []
        for body, wrench, pose in contacts:
            in_base = pose if at is None else se3.inverse(at) @ pose
            felt.append((body, wrench, se3.inverse(tree.poses(q)[:, tree.names.index(body)]) @ in_base))
        felt = by_link(felt, covariance=C)
        own, expected = (total_wrench(tree, q, ground, given, base=at) for given in (world, felt))
        np.testing.assert_allclose(own.values, expected.values, atol=1e-11 * abs(expected.values).max())
        np.testing.assert_allclose(own.covariance, expected.covariance, rtol=1e-9, atol=1e-9)
