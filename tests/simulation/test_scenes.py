"""The scenes: bodies, tilts, friction, noise, a humanoid that falls, and contacts against MuJoCo's own forces."""

import mujoco
import numpy as np
import pytest
from mechanisms import LENGTH_1, tilted_axis
from random_models import inverse_dynamics

import scenes
from experiments.data.simulated_study import StudyProblem
from experiments.studies.study_entries import packaged
from ident.geometry import se3
from ident.geometry.inertia import parameters_from_com, pseudo_inertia
from ident.mechanism.motion import BaseMotion
from ident.model.regressor import base_wrench_regressor
from ident.recordings.wrench import Wrench, total_wrench, transform_wrench
from sim.models.mujoco_model import gravity_in_base, parameters_from_model, state_columns, tree_from_model
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.simulate import simulate
from sim.simulation.stepped import fall

MODEL = scenes.load("double_pendulum").compile()
CONTACTS = (*scenes.CONTACTS, "pad handle")


def test_bodies_are_physical_and_geoms_weigh_nothing():
    phi = parameters_from_model(MODEL, "base")
    expected = [
        parameters_from_com(4.0, [0, 0, 0], np.diag([0.0044, 0.0044, 0.0072])),
        parameters_from_com(3.7, [0, 0, 0.2], np.diag([0.0103, 0.0103, 0.0067])),
        parameters_from_com(13.2939, [0.1, 0, 0.2], np.diag([0.41, 0.41, 0.05])),
    ]
    np.testing.assert_allclose(phi, np.concatenate(expected), atol=1e-12)
    assert (np.linalg.eigvalsh(pseudo_inertia(phi.reshape(3, 10))) > 0).all()
    assert MODEL.body_pos[3, 2] == LENGTH_1


@pytest.mark.parametrize(("tilt", "azimuth"), [(5, 120), (5, -30), (40, 0)])
def test_tilt_turns_both_axes(tilt, azimuth):
    tilted = scenes.load("double_pendulum", tilt_deg=tilt, azimuth_deg=azimuth).compile()
    np.testing.assert_allclose(tilted.jnt_axis, [tilted_axis(tilt, azimuth)] * 2, atol=1e-12)
    for name in ("body_pos", "body_mass", "sensor_noise", "jnt_range", "actuator_gainprm"):
        np.testing.assert_array_equal(getattr(tilted, name), getattr(MODEL, name))


HUMANOID = scenes.load("humanoid").compile()


def test_left_and_right_are_mirror_images():
    mirror = np.array([1, -1, 1])
    for b in range(1, HUMANOID.nbody):
        left = HUMANOID.body(b)
        right = HUMANOID.body(left.name.replace("left", "right"))
        np.testing.assert_allclose(right.mass, left.mass, rtol=1e-12)
        if left.id != right.id:
            np.testing.assert_allclose(right.pos, mirror * left.pos, atol=1e-12)
            np.testing.assert_allclose(right.ipos, mirror * left.ipos, atol=1e-12)


def test_contact_wrenches_sum_up_to_the_base_wrench():
    motion, (q, dq) = fall(HUMANOID, "pelvis", seconds=1.0), state_columns(HUMANOID, "pelvis")
    states = motion.qpos[:, q], motion.qvel[:, dq], motion.qacc[:, dq]
    base = BaseMotion.from_free_joint(motion.qpos[:, :7], motion.qvel[:, :6], motion.qacc[:, :6])
    tree, gravity = tree_from_model(HUMANOID, "pelvis"), gravity_in_base(HUMANOID, "pelvis")
    Y = base_wrench_regressor(tree, *states, gravity=gravity, base=base)
    contacts = [Wrench(wrench, body) for body, wrench in motion.contacts.items()]
    total = total_wrench(tree, states[0], None, contacts).values
    np.testing.assert_allclose(total, Y @ parameters_from_model(HUMANOID, "pelvis"), rtol=0, atol=1e-8)
    assert abs(total[:, :3]).max() > 1000 and abs(total[:, 3:]).max() > 100


@pytest.mark.parametrize("contact", CONTACTS)
def test_contacts_are_rich_and_the_total_wrench_is_the_base_wrench_of_the_same_motion_without_them(contact):
    recording = simulate(scenes.load("double_pendulum", contact=contact), DOUBLE_PENDULUM, noise_scale=0)
    problem, cells = StudyProblem.of(packaged("multicontact", contact=contact)), scenes.load_cells(contact)
    states = recording.joint_states(problem.known.tree.joints)
    expected = inverse_dynamics(MODEL, *states)[1][:, :6]
    total = problem.total(recording).values
    np.testing.assert_allclose(total, expected, rtol=0, atol=1e-13 * abs(expected).max())
    assert abs(recording.wrench("ground").values - expected).max() > 30
    if "pad" in cells:
        touching = recording["pad_normal_force"] > 0
        assert 0.25 < touching.mean() < 0.8 and np.sum(~touching[:-1] & touching[1:]) >= 4
        assert 40 < np.linalg.norm(recording[f"{cells['pad']}_force"], axis=1).max() < 400
    if "handle" in cells:
        force, torque = (recording[f"{cells['handle']}_{kind}"] for kind in ("force", "torque"))
        assert (force.std(axis=0) > 10).all() and (torque.std(axis=0) > 1).all()
        # A free moment: no single force gives this wrench, because the moment is not normal to the force.
        pitch = np.abs(np.sum(force * torque, axis=1)) / np.linalg.norm(force, axis=1)
        assert np.median(pitch) > 0.5


@pytest.mark.parametrize("contact", CONTACTS)
def test_load_cells_agree_with_mujocos_constraint_forces(contact):
    """A cell reads the link's wrench on it: its motion and weight less the wrench of a contact or a weld on it."""
    model = scenes.load("double_pendulum", contact=contact).compile()
    data, rng = mujoco.MjData(model), np.random.default_rng(0)
    tree = tree_from_model(model, "base", beyond=(), ignore=["grip"] * model.nmocap)
    data.qpos[:2] = DOUBLE_PENDULUM.trajectory(np.zeros(1))[0][0]
    mujoco.mj_kinematics(model, data)
    for velocity in [(0.3, -0.2), (-0.5, 0.4), (0.0, 1.0)]:
        data.qvel[:2] = velocity
        if model.nmocap:
            held = data.body(model.eq_obj1id[0])
            data.mocap_pos[0], data.mocap_quat[0] = held.xpos + rng.normal(scale=0.01, size=3), held.xquat
        mujoco.mj_forward(model, data)
        mujoco.mj_rnePostConstraint(model, data)
        q, dq, ddq = (x[None, :2] for x in (data.qpos, data.qvel, data.qacc))
        Y = base_wrench_regressor(tree, q, dq, ddq, gravity=gravity_in_base(model, "base"))[0]
        for site in scenes.load_cells(contact).values():
            cell = tree.names.index(site.replace("contact", "load_cell"))
            own = slice(10 * cell, 10 * cell + 10)
            inertial = Y[:, own] @ parameters_from_model(model, "base", beyond=())[own]
            # MuJoCo writes torque first, about the centre of mass of the whole tree, in the world's axes.
            external = data.cfrc_ext[model.body(tree.names[cell]).id]
            centre = se3.pose(np.eye(3), data.subtree_com[model.body("base").id] - model.body("base").pos)
            on_cell = transform_wrench(centre, np.roll(external, 3))
            measured = np.concatenate([data.sensor(f"{site}_{kind}").data for kind in ("force", "torque")])
            computed = transform_wrench(tree.poses(q)[0, cell], measured)
            np.testing.assert_allclose(computed, inertial - on_cell, rtol=0, atol=1e-10 * abs(computed).max())
            assert abs(on_cell[:3]).max() > 5


def test_several_contacts_are_different_ones_in_any_order():
    first, second = (scenes.load("double_pendulum", contact=contact) for contact in ("pad handle", "handle pad"))
    first.compile(), second.compile()
    assert first.to_xml() == second.to_xml()
    for contact, message in (("pad handle pad", "different ones, got 'pad"), ("", "No contact is named ''")):
        with pytest.raises(ValueError, match=message):
            scenes.load("double_pendulum", contact=contact)
