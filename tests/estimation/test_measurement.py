"""Channels that a measurement predicts, and their derivatives."""

from dataclasses import replace

import numpy as np
import pytest
from closeness import close
from measurements import at, random_inputs, random_measurement
from mechanisms import JOINTS, SCREWS, moved_states, random_tree, unhat
from scipy.spatial.transform import Rotation

from ident.estimation.equations import SLIP
from ident.estimation.recorded_motion import base_motion, joint_states
from ident.geometry.se3 import Ad, coAd, inverse, pose
from ident.mechanism.body import BASE
from ident.model.regressor import base_wrench_regressor, joint_torque_regressor
from ident.parameters.prior import conditioned
from ident.setup import PRIORS
from ident.tolerances import STRIBECK

SMALL = 1e-4  # Size of rotations whose third order is negligible.


def parts_of(m, states):
    """Motion of the base or None, and q, q̇ and q̈ of the joints."""
    first = 7 if m.moving else 0
    return base_motion(states[..., :first]) if m.moving else None, *joint_states(m.tree, states[..., first:])


def stated(m, states, wrenches, theta):
    """Channels (N, C) at the stated set-up, from the regressors."""
    equations, tree, (base, q, dq, ddq) = m.equations, m.tree, parts_of(m, states)
    parameters, gravity, poses = equations.parameters, equations.mechanism.gravity, m.tree.poses(q)
    psi, rest = np.split(theta[: len(equations.names)], [parameters.rank])
    drives, offsets = np.split(rest, [len(equations.drives)])
    Y, Y_tau = (
        parameters.reduce(regressor(tree, q, dq, ddq, gravity=gravity, base=base)) @ psi
        for regressor in (base_wrench_regressor, joint_torque_regressor)
    )
    for k, sensor in enumerate(m.contacts.values()):
        i = tree.names.index(sensor.body)
        contact = coAd(poses[:, i] @ sensor.pose) @ wrenches[:, :, 6 * k : 6 * k + 6].sum(axis=1)[..., None]
        Y = Y - contact[..., 0]
        while i != BASE:
            body = tree.bodies[i]
            columns = [k for k, name in enumerate(tree.freedoms) if body.joint and name.split(".")[0] == body.joint]
            Y_tau[:, columns] -= ((Ad(poses[:, i]) @ body.motions).swapaxes(1, 2) @ contact)[..., 0]
            i = body.parent
    if drives.size:
        Ia, Fv, Fc, Fs, K = np.split(drives, 5)
        Y_tau = Y_tau + Ia * ddq + Fv * dq + (Fc + Fs / (1 + (dq / STRIBECK) ** 2)) * np.tanh(dq / SLIP)
        of_bodies = dict(zip((body.joint for body in tree.bodies), tree.body_coordinates(q), strict=True))
        for k, freedom in enumerate(tree.freedoms):
            if freedom in tree.joints:
                drive = equations.mechanism.drives.get(freedom)
                Y_tau[:, k] += K[k] * (of_bodies[freedom][:, 0] - (drive.springref if drive else 0.0))
    wrench = Y @ coAd(inverse(m.frame)).T
    out = np.hstack([wrench[:, list(m.components)], Y_tau[:, list(equations.torques)]])
    out[:, list(equations.offsets)] += offsets
    return out


@pytest.mark.parametrize(("seed", "which"), [(0, range(6)), (1, (0, 2, 4)), (2, (5,))])
def test_channels_at_the_stated_set_up_are_those_of_the_regressors(seed, which):
    rng = np.random.default_rng(seed)
    m = random_measurement(rng, moving=bool(seed % 2), contacts=seed % 3, components=which)
    states, wrenches, theta = random_inputs(rng, m, setup=0.0)
    for own in (m, replace(m, setup=())):
        values = own.values(states, wrenches, theta[: len(own.names)])
        close(values.T, stated(m, states, wrenches, theta), 1e-12)


def with_plate(m):
    """The measurement with its first contact at rest in the world."""
    name, hand = next(iter(m.contacts.items()))
    return replace(m, contacts={**m.contacts, name: replace(hand, frame="world")})


@pytest.mark.parametrize("seed", range(2))
def test_a_plate_in_the_world_is_what_the_body_feels_wherever_it_is(seed):
    """The wrench is transformed to the body's frame, sample by sample, by the poses of base and body."""
    rng = np.random.default_rng(seed)
    m = random_measurement(rng, moving=bool(seed % 2), contacts=2, setup=False)
    states, wrenches, theta = random_inputs(rng, m)
    plate, (base, q, *_) = with_plate(m), parts_of(m, states)
    (hand, sensor), *_ = m.contacts.items()
    body = m.tree.poses(q)[:, m.tree.names.index(sensor.body)]
    to_body = coAd(inverse((base.T if m.moving else np.eye(4)) @ body @ sensor.pose) @ plate.contacts[hand].pose)
    felt = wrenches.copy()
    felt[:, :, :6] = np.einsum("nij,nkj->nki", to_body, wrenches[:, :, :6])
    close(plate.values(states, wrenches, theta), m.values(states, felt, theta), 1e-11)


COMMANDED = {"wrench": False, "contacts": 0, "commanded": True}


@pytest.mark.parametrize(
    "given",
    [
        {"torques": False},
        {"torques": False, "moving": True, "tracked": 1},
        {"tracked": 2},
        COMMANDED,
        COMMANDED | {"wrench": True},
    ],
)
def test_derivatives_are_central_differences(given):
    """With respect to states and all kinds of parameters, including the set-up's."""
    rng, h, kinds = np.random.default_rng(2), 1e-6, (*SCREWS, "revolute", *([] if "commanded" in given else ["ball"]))
    m = random_measurement(rng, 3, kinds, **given)
    m = with_plate(m) if "tracked" in given else m
    states, wrenches, theta = random_inputs(rng, m, samples=2)
    values, by_states, by_theta = m.derivatives(states, wrenches, theta, np.arange(len(theta)))
    some = rng.permutation(len(theta))[:5]
    close(m.derivatives(states, wrenches, theta, some)[2], by_theta[:, some], 1e-12)
    close(values, m.values(states, wrenches, theta), 1e-12)

    def assert_slope(own, x, dx):
        up, down = (m.values(*(a + s * b for a, b in zip(x, dx, strict=True))) for s in (1, -1))
        np.testing.assert_allclose(own, (up - down) / (2 * h), rtol=1e-5, atol=1e-7 * abs(values).max())

    for d, j in np.ndindex(3, m.coordinates):
        step = np.zeros_like(states)
        step[d, :, j] = h
        assert_slope(by_states[:, d, j], (states, wrenches, theta), (step, 0, 0))
    for k, step in enumerate(h * np.eye(len(theta))):
        assert_slope(by_theta[:, k], (states, wrenches, theta), (0, 0, step))
    of_clocks = {*m.shifts} | (set() if m.equations.servos is not None else {*m.zeros.values()})
    assert not by_theta[:, sorted(of_clocks)].any()


def test_every_kind_of_set_up_parameter_is_among_those_differentiated():
    m = random_measurement(np.random.default_rng(0), 3, ("revolute",), tracked=1)
    commanded = random_measurement(np.random.default_rng(0), 3, ("revolute",), **COMMANDED)
    alone = random_measurement(np.random.default_rng(0), 3, ("revolute",), contacts=0)
    assert {each.kind for each in (*m.setup, *commanded.setup, *alone.setup)} == set(PRIORS)
    assert {each.kind for each in m.setup} == set(PRIORS) - {"lag", "scale", "torque_delay"}


def test_displaced_joints_act_on_bodies_that_the_prior_makes_likeliest():
    """As all of φ by its conditional mean, and no channel shows it at the joints of the model."""
    rng = np.random.default_rng(0)
    m = random_measurement(rng, 3, (*SCREWS, "revolute"), contacts=0)
    states, wrenches, theta = random_inputs(rng, m)
    rank, own = m.equations.parameters.rank, list(m.equations.parameters.kept)
    phi, _ = conditioned(m.equations.mechanism, m.equations.parameters, theta[:rank], np.zeros((rank, rank)))
    likeliest = m.beside(theta)
    likeliest[own] += theta[:rank]
    close(likeliest, phi, 1e-4)
    theta[list(m.setup_at)] = 0
    values, other = m.values(states, wrenches, theta), replace(m)
    other.__dict__["_unseen"] = tuple(0 * each for each in m._unseen)
    close(other.values(states, wrenches, theta), values, 1e-9)


def changed(m, states, wrenches, theta, **values):
    """Channels (N, C) with the given set-up parameters, and the stated ones."""
    theta = theta.copy()
    theta[len(m.equations.names) :] = 0
    before = m.values(states, wrenches, theta).T
    for name, value in values.items():
        theta[at(m, name)] = value
    return m.values(states, wrenches, theta).T, before


def without_offsets(rng, bodies, kinds, **given):
    m = random_measurement(rng, bodies, kinds, **given)
    m = replace(m, equations=m.equations.with_offsets(()))
    return m, *random_inputs(rng, m)


@pytest.mark.parametrize("seed", range(2))
def test_origin_and_rotation_place_the_sensors_frame_in_the_one_stated(seed):
    """For the ground's sensor and for a contact's, whose average over neighbours moves, but not the noise beside it."""
    rng = np.random.default_rng(seed)
    m, states, wrenches, theta = without_offsets(rng, 4, JOINTS, torques=False, moving=bool(seed % 2))
    origin, turn = rng.normal(size=3), SMALL * rng.normal(size=3)
    T, still = pose(Rotation.from_rotvec(turn).as_matrix(), origin), wrenches * np.array([1, 0])[:, None]

    def placed(of):
        own = {f"origin_{axis}({of})": x for axis, x in zip("xyz", origin, strict=True)}
        return own | {f"rotation_{axis}({of})": x for axis, x in zip("xyz", turn, strict=True)}

    own, before = changed(m, states, still, theta, **placed("ground"))
    close(own, before @ coAd(inverse(T)).T, 1e-9)
    moved = replace(m, contacts={"hand0": replace(m.contacts["hand0"], pose=m.contacts["hand0"].pose @ T)})
    own, before = changed(m, states, wrenches, theta, **placed("hand0"))
    close(own - before, changed(moved, states, still, theta)[1] - changed(m, states, still, theta)[1], 1e-9)


@pytest.mark.parametrize("seed", range(2))
def test_gains_gravity_and_axes_are_those_of_another_laboratory(seed):
    rng = np.random.default_rng(seed)
    m, states, wrenches, theta = without_offsets(rng, 3, SCREWS, moving=bool(seed % 2), contacts=0)
    mechanism = m.equations.mechanism
    gains = 0.1 * rng.normal(size=len(m.equations.channels))
    named = {f"gain({name})": x for name, x in zip(m.equations.channels, gains, strict=True)}
    own, before = changed(m, states, wrenches, theta, **named)
    np.testing.assert_allclose(own, before * (1 + gains), rtol=1e-12)

    def assert_as_in(other, **parameters):
        """Compares with the same inertial parameters in another mechanism."""
        own, before = changed(m, states, wrenches, theta, **parameters)
        new = replace(m, equations=replace(m.equations, mechanism=other))
        difference = changed(new, states, wrenches, theta)[1] - before
        assert difference.any()
        close(own - before, difference, 1e-6)

    tilt = {s.axis: SMALL * rng.normal() for s in m.setup if s.kind == "gravity"}
    turn = Rotation.from_rotvec([tilt.get(axis, 0.0) for axis in range(3)]).as_matrix()
    tilted = replace(mechanism, gravity=turn @ mechanism.gravity)
    assert_as_in(tilted, **{f"gravity_{'xyz'[a]}": x for a, x in tilt.items()})
    for s in (s for s in m.setup if s.kind == "axis"):
        turn = Rotation.from_rotvec(SMALL * np.eye(3)[s.axis]).as_matrix()
        bodies = tuple(_turned(body, turn) if body.joint == s.of else body for body in m.tree.bodies)
        assert_as_in(replace(mechanism, tree=replace(m.tree, bodies=bodies)), **{s.name: SMALL})


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
