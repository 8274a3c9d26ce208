"""The equations as printed fail where the corrected ones hold; REPRODUCTION.md numbers these tests."""

import numpy as np
from mechanisms import GRAVITY, double_pendulum, random_phi, random_pose, random_states, random_twist

from ident import dim, se3
from ident.inertia import com_from_parameters, parameters_from_com, pseudo_inertia

RNG = np.random.default_rng(0)
TREE = double_pendulum(axis_1=(0.6, 0.8, 0), axis_2=(0, 0, 1))
Q, DQ, DDQ = (x[0] for x in random_states(RNG, TREE, 1))
PHI = random_phi(RNG, 3)


def forward(carry, gravity_sign, bracket_sign):
    """Eq. 9 with its disputed parts left open: the last body's twist and twist rate."""
    V, dV = np.zeros(6), np.concatenate([gravity_sign * GRAVITY, np.zeros(3)])
    theta, dtheta, ddtheta = TREE.body_coordinates(Q), TREE.body_velocities(DQ), TREE.body_velocities(DDQ)
    for i, body in enumerate(TREE.bodies):
        to_body = carry(dim.relative_pose(body, theta[i]))
        moved = to_body @ V
        own = body.motions @ dtheta[i]
        V = moved + own
        dV = to_body @ dV + body.motions @ ddtheta[i] + bracket_sign * se3.ad(own) @ moved
    return V, dV


def inverse_adjoint(T):
    return se3.Ad(se3.inverse(T))


def test_equation_8_the_printed_transform_moves_another_way():
    T, spatial = random_pose(RNG), random_twist(RNG, "revolute")
    moved = se3.exp(spatial, 0.7) @ T
    printed = T @ se3.exp(se3.Ad(T) @ spatial, 0.7)
    assert abs(printed - moved).max() > 0.1
    np.testing.assert_allclose(T @ se3.exp(dim.body_twist(T, spatial), 0.7), moved, atol=1e-13)


def test_equation_9_the_printed_adjoint_takes_twists_the_wrong_way():
    _, V, dV = dim.forward_recursion(TREE, Q, DQ, DDQ, GRAVITY)
    correct = forward(inverse_adjoint, -1, -1)
    np.testing.assert_allclose(correct[0], V[-1], atol=1e-13)
    np.testing.assert_allclose(correct[1], dV[-1], atol=1e-13)
    assert abs(forward(se3.Ad, -1, -1)[0] - V[-1]).max() > 0.1


def test_equation_9_the_printed_gravity_lifts():
    at_rest = dim.base_wrench_regressor(TREE, Q, 0 * Q, 0 * Q, gravity=GRAVITY) @ PHI
    mass = PHI[[0, 10, 20]].sum()
    assert np.isclose(at_rest[2], 9.81 * mass)
    _, printed = forward(inverse_adjoint, +1, -1)
    _, correct = forward(inverse_adjoint, -1, -1)
    R = TREE.poses(Q)[-1][:3, :3]
    np.testing.assert_allclose(R @ (correct - printed)[:3], -2 * GRAVITY, atol=1e-12)


def test_equation_9_the_angle_and_not_its_rate_is_in_the_exponent():
    body = TREE.bodies[1]
    np.testing.assert_allclose(body.home @ se3.exp(body.twist, Q[0]), TREE.poses(Q)[1], atol=1e-14)
    assert abs(body.home @ se3.exp(body.twist, DQ[0]) - TREE.poses(Q)[1]).max() > 0.1


def test_equation_9_the_bracket_is_with_the_joint_twist_times_its_rate():
    # Printed is ad(ξ†θ), with the angle; with it the twist rate is not the derivative of the twist.
    _, V, dV = dim.forward_recursion(TREE, Q, DQ, DDQ, np.zeros(3))
    body, carried = TREE.bodies[2], V[2] - TREE.bodies[2].twist * DQ[1]
    printed = dV[2] + se3.ad(body.twist * DQ[1]) @ carried - se3.ad(body.twist * Q[1]) @ carried
    h = 1e-6
    later = dim.forward_recursion(TREE, Q + h * DQ, DQ + h * DDQ, DDQ, np.zeros(3))[1][2]
    np.testing.assert_allclose((later - V[2]) / h, dV[2], atol=1e-4)
    assert abs((later - V[2]) / h - printed).max() > 0.1


def test_equation_10_phi_is_linear_only_about_the_frame_origin():
    mass, com, inertia = com_from_parameters(PHI[:10])
    M = dim.spatial_inertia(PHI[:10])
    np.testing.assert_allclose(M[3:, 3:], inertia - mass * se3.hat(com) @ se3.hat(com), atol=1e-12)
    # Two rigid bodies in one frame: φ adds about the origin, centre-of-mass inertias do not.
    other = PHI[10:20]
    np.testing.assert_allclose(pseudo_inertia(PHI[:10] + other), pseudo_inertia(PHI[:10]) + pseudo_inertia(other))
    together = com_from_parameters(PHI[:10] + other)[2]
    assert abs(together - inertia - com_from_parameters(other)[2]).max() > 0.1
    np.testing.assert_allclose(parameters_from_com(mass, com, inertia), PHI[:10], atol=1e-12)


def test_equations_11_13_14_wrenches_move_by_the_inverse_transpose():
    T, F, V = random_pose(RNG), RNG.normal(size=6), RNG.normal(size=6)
    power = F @ V
    assert np.isclose((se3.coAd(T) @ F) @ (se3.Ad(T) @ V), power)
    assert not np.isclose((se3.Ad(T).T @ F) @ (se3.Ad(T) @ V), power)
    Y = dim.base_wrench_regressor(TREE, Q, DQ, DDQ, gravity=GRAVITY)
    wrench, _ = dim.inverse_dynamics(TREE, PHI, Q, DQ, DDQ, gravity=GRAVITY)
    _, twists, rates = dim.forward_recursion(TREE, Q, DQ, DDQ, GRAVITY)
    poses = TREE.poses(Q)
    bodies = [dim.body_regressor(v, dv) @ p for v, dv, p in zip(twists, rates, PHI.reshape(3, 10), strict=True)]
    np.testing.assert_allclose(sum(se3.coAd(T) @ w for T, w in zip(poses, bodies, strict=True)), wrench, atol=1e-11)
    np.testing.assert_allclose(Y @ PHI, wrench, atol=1e-11)
    assert abs(sum(se3.Ad(T).T @ w for T, w in zip(poses, bodies, strict=True)) - wrench).max() > 1
