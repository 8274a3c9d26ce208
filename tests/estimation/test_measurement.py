from dataclasses import replace

import numpy as np
import pytest
from measurements import at, random_inputs, random_measurement
from mechanisms import JOINTS, SCREWS, moved_states, random_tree, unhat
from scipy.spatial.transform import Rotation

from ident.estimation.loads import SLIP
from ident.estimation.recorded_motion import base_motion, joint_states
from ident.geometry.se3 import Ad, coAd, inverse, pose
from ident.mechanism.body import BASE
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor
from ident.parameters.prior import conditioned
from ident.setup import PRIORS
from ident.tolerances import STRIBECK

SMALL = 1e-4  # Size of rotations whose third order is negligible.


def joint_body(tree, joint):
    """Index of the body that a joint moves."""
    return next(i for i, body in enumerate(tree.bodies) if body.joint == joint)


def stated(measurement, states, wrenches, theta):
    """Channels (N, C) at the stated set-up, from the regressors."""
    equations, tree = measurement.equations, measurement.tree
    first = 7 if measurement.moving else 0
    base = base_motion(states[..., :first]) if measurement.moving else None
    q, dq, ddq = joint_states(tree, states[..., first:])
    parameters, gravity = equations.parameters, equations.mechanism.gravity
    psi, rest = np.split(theta[: len(equations.names)], [parameters.rank])
    drives, offsets = np.split(rest, [len(equations.drives)])
    Y, Y_tau = (
        parameters.reduce(regressor(tree, q, dq, ddq, gravity=gravity, base=base)) @ psi
        for regressor in (base_wrench_regressor, joint_torque_regressor)
    )
    poses = tree.poses(q)
    for k, sensor in enumerate(measurement.contacts.values()):
        i = tree.names.index(sensor.body)
        contact = coAd(poses[:, i] @ sensor.pose) @ wrenches[:, :, 6 * k : 6 * k + 6].sum(axis=1)[..., None]
        Y = Y - contact[..., 0]
        while i != BASE:
            body = tree.bodies[i]
            columns = [f.split(".")[0] == body.joint for f in tree.freedoms] if body.joint else []
            Y_tau[:, np.flatnonzero(columns)] -= ((Ad(poses[:, i]) @ body.motions).swapaxes(1, 2) @ contact)[..., 0]
            i = body.parent
    if drives.size:
        Ia, Fv, Fc, Fs, K = np.split(drives, 5)
        sign = np.tanh(dq / SLIP)
        Y_tau = Y_tau + Ia * ddq + Fv * dq + (Fc + Fs / (1 + (dq / STRIBECK) ** 2)) * sign
        for k, freedom in enumerate(tree.freedoms):
            if freedom in tree.joints:
                at = sum(body.coordinates for body in tree.bodies[: joint_body(tree, freedom)])
                drive = equations.mechanism.drives.get(freedom)
                Y_tau[:, k] += K[k] * (q[:, at] - (drive.springref if drive else 0.0))
    wrench = Y @ coAd(inverse(measurement.frame)).T
    out = np.hstack([wrench[:, list(measurement.components)], Y_tau[:, list(equations.torques)]])
    out[:, list(equations.offsets)] += offsets
    return out


@pytest.mark.parametrize("seed", range(3))
def test_channels_at_the_stated_set_up_are_those_of_the_regressors(seed):
    rng = np.random.default_rng(seed)
    which = {0: range(6), 1: (0, 2, 4), 2: (5,)}[seed % 3]
    m = random_measurement(rng, moving=bool(seed % 2), contacts=seed % 3, components=which)
    states, wrenches, theta = random_inputs(rng, m, setup=0.0)
    expected = stated(m, states, wrenches, theta)
    np.testing.assert_allclose(m.values(states, wrenches, theta).T, expected, atol=1e-12 * abs(expected).max())
    bare = replace(m, setup=())
    own = bare.values(states, wrenches, theta[: len(bare.names)])
    np.testing.assert_allclose(own.T, expected, atol=1e-12 * abs(expected).max())


def with_plate(m):
    """The measurement with its first contact at rest in the world."""
    name, hand = next(iter(m.contacts.items()))
    return replace(m, contacts={**m.contacts, name: replace(hand, frame="world")})


@pytest.mark.parametrize("seed", range(3))
def test_a_plate_in_the_world_is_what_the_body_feels_wherever_it_is(seed):
    """The wrench is transformed to the body's frame, sample by sample, by the poses of base and body."""
    rng = np.random.default_rng(seed)
    m = random_measurement(rng, moving=bool(seed % 2), contacts=2, setup=False)
    m = replace(m, frame=None if seed > 2 else m.frame)
    states, wrenches, theta = random_inputs(rng, m)
    plate = with_plate(m)
    (hand, sensor), first = next(iter(m.contacts.items())), 7 if m.moving else 0
    base = base_motion(states[..., :first]).T if m.moving else np.eye(4)
    body = m.tree.poses(joint_states(m.tree, states[..., first:])[0])[:, m.tree.names.index(sensor.body)]
    to_body = coAd(inverse(base @ body @ sensor.pose) @ plate.contacts[hand].pose)
    felt = wrenches.copy()
    felt[:, :, :6] = np.einsum("nij,nkj->nki", to_body, wrenches[:, :, :6])
    expected = m.values(states, felt, theta)
    np.testing.assert_allclose(plate.values(states, wrenches, theta), expected, atol=1e-11 * abs(expected).max())


@pytest.mark.parametrize("seed", range(3))
def test_derivatives_are_central_differences(seed):
    """With respect to states and all kinds of parameters, including the set-up's."""
    rng = np.random.default_rng(seed)
    kinds = (*SCREWS, "revolute", "ball")
    m = random_measurement(rng, 3, kinds, moving=bool(seed % 2), torques=seed > 1, contacts=1, tracked=seed % 3)
    m = with_plate(replace(m, frame=None if seed > 3 else m.frame)) if seed % 3 else m
    check_derivatives(m, rng)


def test_displaced_joints_act_on_bodies_that_the_prior_makes_likeliest():
    """As all of φ by its conditional mean, and no channel shows it at the joints of the model."""
    rng = np.random.default_rng(0)
    m = random_measurement(rng, 3, (*SCREWS, "revolute"), contacts=0)
    states, wrenches, theta = random_inputs(rng, m)
    rank, own = m.equations.parameters.rank, list(m.equations.parameters.kept)
    phi, _ = conditioned(m.equations.mechanism, m.equations.parameters, theta[:rank], np.zeros((rank, rank)))
    likeliest = m.beside(theta)
    likeliest[own] += theta[:rank]
    np.testing.assert_allclose(likeliest, phi, atol=1e-4 * abs(phi).max())
    theta[list(m.setup_at)] = 0
    values, other = m.values(states, wrenches, theta), replace(m)
    other.__dict__["_unseen"] = tuple(0 * each for each in m._unseen)
    np.testing.assert_allclose(other.values(states, wrenches, theta), values, atol=1e-9 * abs(values).max())


@pytest.mark.parametrize("seed", range(3))
def test_derivatives_of_commands_are_central_differences(seed):
    rng = np.random.default_rng(seed)
    check_derivatives(
        random_measurement(rng, 3, (*SCREWS, "revolute"), wrench=seed > 1, contacts=0, commanded=True), rng
    )


def check_derivatives(m, rng):
    states, wrenches, theta = random_inputs(rng, m, samples=2)
    values, by_states, by_theta = m.derivatives(states, wrenches, theta, np.arange(len(theta)))
    some = rng.permutation(len(theta))[:5]
    of_some = m.derivatives(states, wrenches, theta, some)[2]
    np.testing.assert_allclose(of_some, by_theta[:, some], rtol=0, atol=1e-13 * abs(by_theta).max())
    np.testing.assert_allclose(values, m.values(states, wrenches, theta), atol=1e-12 * abs(values).max())
    scale, h = abs(values).max(), 1e-6

    def close(own, up, down):
        np.testing.assert_allclose(own, (up - down) / (2 * h), rtol=1e-5, atol=1e-7 * scale)

    for d, j in np.ndindex(3, m.coordinates):
        up, down = states.copy(), states.copy()
        up[d, :, j] += h
        down[d, :, j] -= h
        close(by_states[:, d, j], m.values(up, wrenches, theta), m.values(down, wrenches, theta))
    for k in range(len(theta)):
        step = h * np.eye(len(theta))[k]
        up, down = m.values(states, wrenches, theta + step), m.values(states, wrenches, theta - step)
        close(by_theta[:, k], up, down)
        encoders = set() if m.equations.servos is not None else set(m.zeros.values())
        assert not (k in {*m.shifts, *encoders} and by_theta[:, k].any())


def test_every_kind_of_set_up_parameter_is_among_those_differentiated():
    m = random_measurement(np.random.default_rng(0), 3, ("revolute",), tracked=1)
    commanded = random_measurement(np.random.default_rng(0), 3, ("revolute",), wrench=False, contacts=0, commanded=True)
    assert {each.kind for each in (*m.setup, *commanded.setup)} == set(PRIORS)
    assert {each.kind for each in m.setup} == set(PRIORS) - {"lag", "scale"}


def changed(m, states, wrenches, theta, **values):
    """Channels (N, C) with the given set-up parameters, and the stated ones."""
    theta = theta.copy()
    theta[len(m.equations.names) :] = 0
    before = m.values(states, wrenches, theta).T
    for name, value in values.items():
        theta[at(m, name)] = value
    return m.values(states, wrenches, theta).T, before


def vector(kind, of, value):
    """Set-up parameters of three axes."""
    return {f"{kind}_{axis}({of})" if of else f"{kind}_{axis}": x for axis, x in zip("xyz", value, strict=True)}


@pytest.mark.parametrize("seed", range(2))
def test_origin_and_rotation_place_the_sensors_frame_in_the_one_stated(seed):
    """For the ground's sensor and for a contact's, whose average over neighbours moves, but not the noise beside it."""
    rng = np.random.default_rng(seed)
    m = random_measurement(rng, 4, JOINTS, torques=False, moving=bool(seed % 2))
    m = replace(m, equations=m.equations.with_offsets(()))
    states, wrenches, theta = random_inputs(rng, m)
    origin, turn = rng.normal(size=3), SMALL * rng.normal(size=3)
    T = pose(Rotation.from_rotvec(turn).as_matrix(), origin)
    still = wrenches * np.array([1, 0])[:, None]
    own, before = changed(
        m, states, still, theta, **vector("origin", "ground", origin), **vector("rotation", "ground", turn)
    )
    expected = before @ coAd(inverse(T)).T
    np.testing.assert_allclose(own, expected, atol=1e-9 * abs(expected).max())
    moved = replace(m, contacts={"hand0": replace(m.contacts["hand0"], pose=m.contacts["hand0"].pose @ T)})
    own, before = changed(
        m, states, wrenches, theta, **vector("origin", "hand0", origin), **vector("rotation", "hand0", turn)
    )
    expected = changed(moved, states, still, theta)[1] - changed(m, states, still, theta)[1]
    np.testing.assert_allclose(own - before, expected, atol=1e-9 * abs(expected).max())


@pytest.mark.parametrize("seed", range(2))
def test_gains_gravity_and_axes_are_those_of_another_laboratory(seed):
    rng = np.random.default_rng(seed)
    m = random_measurement(rng, 3, SCREWS, moving=bool(seed % 2), contacts=0)
    m = replace(m, equations=m.equations.with_offsets(()))
    states, wrenches, theta = random_inputs(rng, m)
    mechanism = m.equations.mechanism
    gains = 0.1 * rng.normal(size=len(m.equations.channels))
    named = {f"gain({name})": x for name, x in zip(m.equations.channels, gains, strict=True)}
    own, before = changed(m, states, wrenches, theta, **named)
    np.testing.assert_allclose(own, before * (1 + gains), rtol=1e-12)

    def with_mechanism(other):
        """The same inertial parameters in another mechanism."""
        new = replace(m, equations=replace(m.equations, mechanism=other))
        return changed(new, states, wrenches, theta)[1]

    tilt = {s.axis: SMALL * rng.normal() for s in m.setup if s.kind == "gravity"}
    turn = Rotation.from_rotvec([tilt.get(axis, 0.0) for axis in range(3)]).as_matrix()
    own, before = changed(m, states, wrenches, theta, **{f"gravity_{'xyz'[a]}": x for a, x in tilt.items()})
    expected = with_mechanism(replace(mechanism, gravity=turn @ mechanism.gravity))
    np.testing.assert_allclose(own - before, expected - before, atol=1e-6 * abs(expected - before).max())
    for s in (s for s in m.setup if s.kind == "axis"):
        own, before = changed(m, states, wrenches, theta, **{s.name: SMALL})
        turn = Rotation.from_rotvec(SMALL * np.eye(3)[s.axis]).as_matrix()
        bodies = [_turned(body, turn) if body.joint == s.of else body for body in m.tree.bodies]
        tree = replace(m.tree, bodies=tuple(bodies))
        expected = with_mechanism(replace(mechanism, tree=tree))
        assert abs(expected - before).max() > 0
        np.testing.assert_allclose(own - before, expected - before, atol=1e-6 * abs(expected - before).max())


def _turned(body, turn):
    """A body whose joint axis is turned about its point next to the body's origin, with the same pitch."""
    v, w = body.twist[:3], body.twist[3:]
    pitch, point = v @ w, np.cross(w, v)
    return replace(body, twist=np.concatenate([np.cross(point, turn @ w) + pitch * (turn @ w), turn @ w]))


@pytest.mark.parametrize("seed", range(3))
def test_rates_of_coordinates_are_those_of_their_rotations_and_poses(seed):
    rng, h = np.random.default_rng(seed), 1e-4
    tree = random_tree(rng, 3, ("ball", "revolute", "free"))
    x = rng.uniform(-1, 1, size=(3, 7 + sum(body.coordinates for body in tree.bodies)))
    x[0, 3] += 2

    def at_time(t):
        return np.array([x[0] + x[1] * t + x[2] * t**2 / 2, x[1] + x[2] * t, x[2]])

    states = joint_states(tree, x[:, 7:])
    for t in (-h, h):
        q, dq = moved_states(tree, *states, t)
        own = joint_states(tree, at_time(t)[:, 7:])
        np.testing.assert_allclose(tree.poses(q), tree.poses(own[0]), atol=1e-9)
        np.testing.assert_allclose(dq, own[1], atol=1e-5)
    motion, (before, after) = base_motion(x[:, :7]), (base_motion(at_time(t)[:, :7]) for t in (-h, h))
    np.testing.assert_allclose(motion.V, unhat(inverse(motion.T) @ (after.T - before.T) / (2 * h)), atol=1e-6)
    np.testing.assert_allclose(motion.dV, (after.V - before.V) / (2 * h), atol=1e-6)
