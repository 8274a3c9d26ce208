"""The equations as printed fail where the corrected ones hold; docs/reproduction.md numbers these tests."""

import mujoco
import numpy as np
from mechanisms import GRAVITY, double_pendulum, random_phi, random_pose, random_states, random_twist, tilted_axis

import scenes
from experiments.data import paper
from ident import Mechanism, Motion, Wrench, find_base_parameters, total_wrench
from ident.geometry import se3
from ident.geometry.inertia import com_from_parameters, pseudo_inertia
from ident.model import dim
from sim.models.model_mechanism import mechanism

RNG = np.random.default_rng(0)
TREE = double_pendulum(axis_1=(0.6, 0.8, 0), axis_2=(0, 0, 1))
Q, DQ, DDQ = (x[0] for x in random_states(RNG, TREE, 1))
PHI = random_phi(RNG, 3)
PENDULUM, MOTION = Mechanism(TREE, GRAVITY, PHI), Motion(Q, DQ, DDQ)


def forward(carry, gravity_sign):
    """The last body's twist and twist rate by Eq. 9, with its disputed parts as arguments."""
    V, dV = np.zeros(6), np.concatenate([gravity_sign * GRAVITY, np.zeros(3)])
    theta, dtheta, ddtheta = TREE.body_coordinates(Q), TREE.body_velocities(DQ), TREE.body_velocities(DDQ)
    for i, body in enumerate(TREE.bodies):
        to_body = carry(dim.relative_pose(body, theta[i]))
        moved = to_body @ V
        own = body.motions @ dtheta[i]
        V = moved + own
        dV = to_body @ dV + body.motions @ ddtheta[i] - se3.ad(own) @ moved
    return V, dV


def inverse_adjoint(T):
    return se3.Ad(se3.inverse(T))


def test_section_2_v_is_no_unit_vector(rng):
    # A revolute joint about an axis through q has v = -ω × q, Table II's own joints v = 0.
    twist = random_twist(rng, "revolute")
    q = np.cross(twist[3:], twist[:3])
    v = -np.cross(twist[3:], q)
    T = se3.exp(np.concatenate([v, twist[3:]]), 0.7)
    np.testing.assert_allclose((T @ [*q, 1])[:3], q, atol=1e-13)
    assert abs(np.linalg.norm(v) - 1) > 0.1
    assert all(not body.twist[:3].any() for body in double_pendulum().bodies)


def test_equation_8_the_printed_transform_moves_another_way(rng):
    T, spatial = random_pose(rng), random_twist(rng, "revolute")
    moved = se3.exp(spatial, 0.7) @ T
    printed = T @ se3.exp(se3.Ad(T) @ spatial, 0.7)
    assert abs(printed - moved).max() > 0.1
    np.testing.assert_allclose(T @ se3.exp(dim.body_twist(T, spatial), 0.7), moved, atol=1e-13)


def test_equation_9_the_printed_adjoint_takes_twists_the_wrong_way():
    _, V, dV = dim.forward_recursion(PENDULUM, MOTION)
    correct = forward(inverse_adjoint, -1)
    np.testing.assert_allclose(correct[0], V[-1], atol=1e-13)
    np.testing.assert_allclose(correct[1], dV[-1], atol=1e-13)
    assert abs(forward(se3.Ad, -1)[0] - V[-1]).max() > 0.1


def test_equation_9_the_printed_gravity_lifts():
    at_rest = dim.base_wrench_regressor(PENDULUM, Motion(Q, 0 * Q, 0 * Q)) @ PHI
    mass = PHI[[0, 10, 20]].sum()
    assert np.isclose(at_rest[2], 9.81 * mass)
    _, printed = forward(inverse_adjoint, +1)
    _, correct = forward(inverse_adjoint, -1)
    R = TREE.poses(Q)[-1][:3, :3]
    np.testing.assert_allclose(R @ (correct - printed)[:3], -2 * GRAVITY, atol=1e-12)


def test_equation_9_the_angle_and_not_its_rate_is_in_the_exponent():
    body = TREE.bodies[1]
    np.testing.assert_allclose(body.home @ se3.exp(body.twist, Q[0]), TREE.poses(Q)[1], atol=1e-14)
    assert abs(body.home @ se3.exp(body.twist, DQ[0]) - TREE.poses(Q)[1]).max() > 0.1


def test_equation_9_the_bracket_is_with_the_joint_twist_times_its_rate():
    # Printed is ad(ξ†θ), with the angle; with it the twist rate is not the derivative of the twist.
    weightless = Mechanism(TREE, np.zeros(3))
    _, V, dV = dim.forward_recursion(weightless, MOTION)
    body, carried = TREE.bodies[2], V[2] - TREE.bodies[2].twist * DQ[1]
    printed = dV[2] + se3.ad(body.twist * DQ[1]) @ carried - se3.ad(body.twist * Q[1]) @ carried
    h = 1e-6
    later = dim.forward_recursion(weightless, Motion(Q + h * DQ, DQ + h * DDQ, DDQ))[1][2]
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


def test_equations_11_13_14_wrenches_move_by_the_inverse_transpose(rng):
    T, F, V = random_pose(rng), rng.normal(size=6), rng.normal(size=6)
    power = F @ V
    assert np.isclose((se3.coAd(T) @ F) @ (se3.Ad(T) @ V), power)
    assert not np.isclose((se3.Ad(T).T @ F) @ (se3.Ad(T) @ V), power)
    wrench, _ = dim.inverse_dynamics(PENDULUM, MOTION)
    _, twists, rates = dim.forward_recursion(PENDULUM, MOTION)
    poses = TREE.poses(Q)
    bodies = [dim.body_regressor(v, dv) @ p for v, dv, p in zip(twists, rates, PHI.reshape(3, 10), strict=True)]
    np.testing.assert_allclose(sum(se3.coAd(T) @ w for T, w in zip(poses, bodies, strict=True)), wrench, atol=1e-11)
    assert abs(sum(se3.Ad(T).T @ w for T, w in zip(poses, bodies, strict=True)) - wrench).max() > 1


def test_equation_16_the_last_adjoint_is_that_of_the_links_own_joint(rng):
    # The wrench through joint i is moved to the base by g_{i-1,i}; the printed chain goes on to link i + 1.
    moved = zip(TREE.bodies, TREE.body_coordinates(Q), strict=True)
    base, first, second = (dim.relative_pose(body, q) for body, q in moved)
    wrench = rng.normal(size=6)
    to_base = se3.coAd(base) @ se3.coAd(first)
    np.testing.assert_allclose(to_base @ wrench, se3.coAd(TREE.poses(Q)[1]) @ wrench, atol=1e-12)
    assert abs(to_base @ se3.coAd(second) @ wrench - to_base @ wrench).max() > 0.1


def test_section_7_a_wrench_exerted_on_the_link_has_the_other_sign(rng):
    # MuJoCo exerts a wrench on link 2, in world axes at its centre of mass, and reads what the ground exerts.
    model = scenes.load("double_pendulum").compile()
    data = mujoco.MjData(model)
    data.qpos, data.qvel, on_link = Q, DQ, rng.normal(size=6)
    data.body("link2").xfrc_applied = on_link
    mujoco.mj_forward(model, data)
    ground = np.concatenate([data.sensor(f"ground_{kind}").data for kind in ("force", "torque")])
    arm = mechanism(model, "base")
    Y = dim.base_wrench_regressor(arm, Motion(data.qpos, data.qvel, data.qacc))
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = data.body("link2").xmat.reshape(3, 3).T, model.body("link2").ipos
    moved = se3.coAd(arm.tree.poses(Q)[2] @ pose) @ on_link
    expected = Y @ arm.known
    np.testing.assert_allclose(ground + moved, expected, atol=1e-9)
    assert abs(ground - moved - expected).max() > 0.1


def test_equation_17_the_sum_is_over_contacts_and_not_over_links(rng):
    # One contact, on the last of three bodies: the printed g_{0,i} with i = 1 … N_c is another body's.
    contact, poses = rng.normal(size=6), TREE.poses(Q)
    ground = dim.base_wrench_regressor(PENDULUM, MOTION) @ PHI + se3.coAd(poses[2]) @ contact
    measured = total_wrench(TREE, Q[None], Wrench(ground[None]), [Wrench(-contact[None], TREE.names[2])]).values[0]
    np.testing.assert_allclose(measured, ground - se3.coAd(poses[2]) @ contact, atol=1e-11)
    for other in poses[:2]:
        assert abs(measured - (ground - se3.coAd(other) @ contact)).max() > 0.1


def test_tables_2_to_4_number_bodies_from_one_and_equations_from_zero():
    # Tables III and IV: m_3 is the body with l_1 in its home pose, the second link, called 2 in Section VII.
    tree, base = double_pendulum(), find_base_parameters(double_pendulum())
    assert tree.bodies[2].home[2, 3] == 0.425 and not tree.bodies[1].home[:3, 3].any()
    assert base.expressions()[base.names.index("m2rz2")] == "m2rz2 + 0.425 m3"


def test_tables_3_and_4_mark_other_parameters_as_regrouped():
    # These six are marked; with axes along X five of them are regrouped, with parallel tilted axes all thirteen.
    marked = {"m1", "m1rx1", "m1ry1", "m2rz2", "Ixx2", "Ixz2"}

    def regrouped(base):
        return {name for name, words in zip(base.names, base.expressions(), strict=True) if name != words}

    along_x, axis = find_base_parameters(double_pendulum()), tilted_axis(5, 120)
    assert regrouped(along_x) == marked - {"m1ry1"}
    tilted = find_base_parameters(double_pendulum(axis, axis), kept=along_x.names)
    assert regrouped(tilted) == {*along_x.names} == {*paper.TABLE_3}
