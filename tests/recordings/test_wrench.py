import numpy as np
import pytest
from mechanisms import GRAVITY, random_phi, random_pose, random_states, random_tree

from ident.geometry import se3
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.motion import Motion
from ident.model import dim
from ident.recordings.wrench import Wrench, total_wrench, transform_wrench


@pytest.fixture(params=range(4))
def rng(request):
    return np.random.default_rng(request.param)


def test_transport_conserves_power_and_composes(rng):
    a, b, F, V = random_pose(rng), random_pose(rng), rng.normal(size=6), rng.normal(size=6)
    assert np.isclose(transform_wrench(a, F) @ (se3.Ad(a) @ V), F @ V)
    np.testing.assert_allclose(transform_wrench(a @ b, F), transform_wrench(a, transform_wrench(b, F)), atol=1e-11)


def by_link(body, wrench, pose, covariance=None):
    """A contact, from the link's wrench."""
    return Wrench(wrench, str(body), pose, applied_to_link=False, covariance=covariance)


def random_contacts(rng, tree, samples):
    """Contacts on random bodies, and the links' wrenches on them."""
    bodies = rng.choice(tree.names, size=rng.integers(1, 5))
    wrenches = rng.normal(size=(len(bodies), samples, 6))
    poses = [random_pose(rng) for _ in bodies]
    return list(bodies), wrenches, poses


def test_equation_15_walked_down_the_tree_gives_equation_17(rng):
    tree = random_tree(rng)
    phi = random_phi(rng, len(tree.inertial))
    motion, mechanism = Motion(*random_states(rng, tree, 4)), Mechanism(tree, GRAVITY, phi)
    bodies, wrenches, poses = random_contacts(rng, tree, 4)
    ground = np.zeros((4, 6))
    for k in range(4):
        # Eq. 15: each link passes on its children's wrenches, its own motion's, and its contact's.
        T, V, dV = dim.forward_recursion(mechanism, motion[k])
        force = [np.zeros(6) for _ in tree.bodies]
        for i, phi_i in zip(tree.inertial, phi.reshape(-1, 10), strict=True):
            force[i] = dim.body_regressor(V[i], dV[i]) @ phi_i
        for body, wrench, pose in zip(bodies, wrenches, poses, strict=True):
            force[tree.names.index(body)] += se3.coAd(pose) @ wrench[k]
        for i in reversed(range(len(tree.bodies))):
            carried = se3.coAd(T[i]) @ force[i]
            if tree.bodies[i].parent < 0:
                ground[k] += carried
            else:
                force[tree.bodies[i].parent] = force[tree.bodies[i].parent] + carried
    contacts = list(map(by_link, bodies, wrenches, poses))
    Y, q = np.array([dim.base_wrench_regressor(mechanism, sample) for sample in motion]), motion.q
    total = total_wrench(tree, q, Wrench(ground), contacts)
    np.testing.assert_allclose(total.values, Y @ phi, atol=1e-11 * abs(ground).max())
    assert total.covariance is None
    # The ground, measured in another frame, with opposite sign, and without two of its components.
    plate = random_pose(rng)
    there = transform_wrench(se3.inverse(plate), -ground)
    elsewhere = total_wrench(tree, q, Wrench(there, pose=plate, applied_to_link=False), contacts)
    np.testing.assert_array_equal(elsewhere.frame, plate)
    np.testing.assert_allclose(elsewhere.in_base, Y @ phi, atol=1e-10 * abs(ground).max())
    there[:, [1, 5]] = np.nan
    partial = total_wrench(tree, q, Wrench(there, pose=plate, applied_to_link=False), contacts).values
    assert np.isnan(partial[:, [1, 5]]).all()
    np.testing.assert_array_equal(partial[:, [0, 2, 3, 4]], elsewhere.values[:, [0, 2, 3, 4]])


def test_a_wrench_applied_to_the_link_has_the_other_sign(rng):
    tree = random_tree(rng)
    q = random_states(rng, tree, 3)[0]
    contacts = random_contacts(rng, tree, 3)
    to_link = [Wrench(-w, str(b), p) for b, w, p in zip(*contacts, strict=True)]
    ground = Wrench(rng.normal(size=(3, 6)))
    totals = (total_wrench(tree, q, ground, given) for given in (list(map(by_link, *contacts)), to_link))
    np.testing.assert_array_equal(*(total.values for total in totals))


@pytest.mark.parametrize("known", [True, False])
def test_without_a_ground_wrench_the_contacts_are_all_there_is(rng, known):
    tree = random_tree(rng)
    q = random_states(rng, tree, 3)[0]
    bodies, wrenches, poses = random_contacts(rng, tree, 3)
    contacts = [
        by_link(*contact, np.eye(6) if known else None) for contact in zip(bodies, wrenches, poses, strict=True)
    ]
    total = total_wrench(tree, q, None, contacts)
    exact_zero = total_wrench(tree, q, Wrench(np.zeros((3, 6)), covariance=np.zeros((6, 6))), contacts)
    np.testing.assert_array_equal(total.values, exact_zero.values)
    if known:
        np.testing.assert_array_equal(total.covariance, exact_zero.covariance)
    else:
        assert total.covariance is None


def test_what_rests_in_the_world_reaches_the_base_without_any_posture(rng):
    """The same wrenches in the bodies' frames, whose poses differ from sample to sample, and their covariances."""
    tree = random_tree(rng)
    q, base = random_states(rng, tree, 3)[0], np.array([random_pose(rng) for _ in range(3)])
    bodies, wrenches, poses = random_contacts(rng, tree, 3)
    C = np.diag(rng.uniform(1, 2, 6))
    for at in (base, None):
        world = [
            Wrench(w, str(body), pose, covariance=C, frame="world")
            for body, w, pose in zip(bodies, wrenches, poses, strict=True)
        ]
        in_base = [pose if at is None else se3.inverse(at) @ pose for pose in poses]
        there = [tree.poses(q)[:, tree.names.index(str(body))] for body in bodies]
        felt = [
            Wrench(w, str(body), se3.inverse(T) @ pose, covariance=C)
            for body, w, T, pose in zip(bodies, wrenches, there, in_base, strict=True)
        ]
        ground = Wrench(rng.normal(size=(3, 6)), pose=random_pose(rng), covariance=C)
        own, expected = (total_wrench(tree, q, ground, contacts, base=at) for contacts in (world, felt))
        np.testing.assert_allclose(own.values, expected.values, atol=1e-11 * abs(expected.values).max())
        np.testing.assert_allclose(own.covariance, expected.covariance, rtol=1e-9, atol=1e-9)
