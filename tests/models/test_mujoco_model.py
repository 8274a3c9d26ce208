"""Trees, gravity, drives and couplings of MuJoCo models."""

import mujoco
import numpy as np
import pytest
from random_models import inverse_dynamics

from ident.errors import ModelError
from ident.model.regressor import base_wrench_regressor, drive_names, joint_torque_regressor
from sim.models.couplings import check_torques
from sim.models.mujoco_model import gravity_in_base, mechanism_bodies, parameters_from_model, tree_from_model
from sim.models.notes import ModelNote

ARM = '<body name="arm"><joint name="elbow"/><geom size=".1"/></body>'
SITES = ARM.replace("</body>", '<site name="tip"/></body>')
HINGES = '<body name="arm"><joint name="u"/><joint name="w" axis="1 0 0"/><geom size=".1"/></body>'


def model(body, before="", after=""):
    body = f'{before}<body name="base"><geom size=".1"/>{body}</body></worldbody>{after}'
    return mujoco.MjModel.from_xml_string(f'<mujoco><compiler angle="radian"/><worldbody>{body}</mujoco>')


@pytest.mark.parametrize(("joint", "gravity"), [("", [0, -9.81, 0]), ("<joint/>", [0, 0, -9.81])])
def test_gravity_is_turned_with_a_base_at_rest(joint, gravity):
    turned = f'<body euler="90 0 0"><body name="base" euler="0 90 0">{joint}<geom size=".1"/></body></body>'
    m = mujoco.MjModel.from_xml_string(f"<mujoco><worldbody>{turned}</worldbody></mujoco>")
    np.testing.assert_allclose(gravity_in_base(m, "base"), gravity, atol=1e-12)


def test_rotors_and_viscous_friction_are_mujocos_and_coulomb_friction_has_the_sign_of_the_velocity():
    driven = HINGES.replace('name="u"', 'name="u" armature=".3" damping=".7"')
    m = model(driven.replace('name="w"', 'name="w" armature=".2" damping=".1"'))
    tree, drive = tree_from_model(m), ("rotor", "viscous", "coulomb")
    states = np.random.default_rng(0).normal(size=(3, 20, 2))
    states[1][:, 0] = 0
    forces, _ = inverse_dynamics(m, *states)
    Y = joint_torque_regressor(tree, *states, gravity=m.opt.gravity, drive=drive)
    phi = np.concatenate([parameters_from_model(m), m.dof_armature, m.dof_damping, [2, 3]])
    np.testing.assert_allclose(Y @ phi, forces + [2, 3] * np.sign(states[1]), atol=1e-12)
    assert drive_names(tree, drive) == ("Ia(u)", "Ia(w)", "Fv(u)", "Fv(w)", "Fc(u)", "Fc(w)")


LOOP = '<equality><connect name="loop" body1="arm" body2="world" anchor="0 0 0"/></equality>'
WELD = '<equality><weld name="grip" site1="tip" site2="nail"/></equality>'
SPRING = """<tendon><fixed name="spring" stiffness="2"><joint joint="u" coef="1"/><joint joint="w" coef="1"/></fixed>
</tendon>"""
ROPE = '<tendon><spatial><site site="tip"/><site site="nail"/></spatial></tendon>'
NAIL = '<site name="nail" pos="0 0 1"/>'
PULLEY = '<body name="arm"><joint/><geom name="pulley" type="cylinder" size=".1 .1"/></body>'
NAILS = '<site name="nail" pos="1 0 0"/><site name="nail2" pos="-1 0 0"/>'
BELT = '<tendon><spatial name="belt"><site site="nail"/><geom geom="pulley"/><site site="nail2"/></spatial></tendon>'
FLEX = '<flexcomp name="cloth" type="grid" count="3 3 1" spacing=".1 .1 .1" radius=".01" mass="1"/>'


@pytest.mark.parametrize(
    ("m", "name", "kind"),
    [
        (model(ARM, after=LOOP), "loop", r"equality \(connect\)"),
        (model(SITES, NAIL, WELD), "grip", r"equality \(weld\)"),
        (model(SITES, NAIL, ROPE), "tendon0", "tendon"),
        (model(PULLEY, NAILS, BELT), "belt", "tendon"),
    ],
)
def test_couplings_with_the_surroundings_are_refused_by_name_or_ignored_by_name(m, name, kind):
    message = f"do not hold the forces of {kind} '{name}', which reach outside the mechanism. .*--ignore {name} "
    for base in (None, "base"):
        with pytest.raises(ModelError, match=message):
            tree_from_model(m, base)
    assert "arm" in tree_from_model(m, ignore=(name,)).names
    with pytest.raises(ModelError, match=f"no active equality constraint, tendon or flex named nothing; it has {name}"):
        tree_from_model(m, ignore=("nothing",))


@pytest.mark.parametrize(
    ("m", "name", "what", "joints"),
    [
        (model(HINGES, after=SPRING), "spring", "tendon 'spring' of u, w", ("u", "w")),
        (model(NAIL + SITES, after=ROPE), "tendon0", "tendon 'tendon0'", ("elbow",)),
    ],
)
def test_couplings_between_bodies_are_noted_and_refused_for_the_torques_of_their_joints(m, name, what, joints):
    with pytest.warns(ModelNote, match=f"leave out {what}; .* changes joint torques, but no wrench"):
        tree = tree_from_model(m, "base")
    assert tree == tree_from_model(m, "base", ignore=(name,))
    members = mechanism_bodies(m, "base")
    check_torques(m, members, (), ())
    check_torques(m, members, (name,), joints)
    for joint in joints:
        with pytest.raises(ModelError, match=f"the forces of {what}, which act on its joints. .*--ignore {name} "):
            check_torques(m, members, (), (joint,))


def test_couplings_of_joints_matter_to_no_others_and_not_where_these_are_fixed():
    m = model(HINGES + ARM.replace("arm", "leg"), after=SPRING)
    check_torques(m, mechanism_bodies(m, "base"), (), ("elbow",))
    assert tree_from_model(m, "base", fix={"u": [], "w": [0.3]}).joints == ("elbow",)
    with pytest.warns(ModelNote, match="spring"):
        tree_from_model(m, "base", fix={"w": []})
    with pytest.warns(ModelNote, match="flex 'cloth'"):
        tree_from_model(model(FLEX))


BETWEEN = """<mujoco><option gravity="1 2 -9"/><worldbody><site name="nail" pos="0 0 2"/><body name="base">
<geom size=".2"/><site name="ground"/>
<body name="a" pos=".3 0 .1"><joint name="u" axis="0 1 0"/><geom type="box" size=".1 .2 .3" pos=".1 0 .3"/>
<site name="tip" pos=".1 .2 .3"/></body>
<body name="b" pos="-.3 0 0"><joint name="w" axis="1 0 0"/><geom type="box" size=".3 .2 .1" pos=".1 0 .3"/>
<body name="c" pos="0 0 .5"><joint name="k" type="slide" axis="0 .6 .8"/><geom size=".1"/></body></body>
</body></worldbody><sensor><force site="ground"/><torque site="ground"/></sensor>{}</mujoco>"""
INSIDE = (
    '<connect body1="a" body2="c" anchor="0 0 .2"/>',
    '<weld body1="a" body2="c"/>',
    '<joint joint1="u" joint2="k" polycoef=".3 2 0 0 0"/>',
)
OUTSIDE = ('<connect body1="a" anchor="0 0 .2"/>', '<weld site1="tip" site2="nail"/>')


@pytest.mark.parametrize("equality", INSIDE + OUTSIDE)
def test_only_couplings_with_the_surroundings_show_in_the_base_wrench(equality):
    """In MuJoCo's own constrained motion, against the sensors below the base, with all constraints met at first."""
    m = mujoco.MjModel.from_xml_string(BETWEEN.format(f"<equality>{equality}</equality>"))
    m.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONTACT
    tree, phi = tree_from_model(m, "base", ignore=("equality0",)), parameters_from_model(m, "base")
    states, readings, data = np.random.default_rng(0).normal(size=(3, 10, 3)), np.empty((10, 6)), mujoco.MjData(m)
    pulls, states[0] = np.empty((10, 3)), m.qpos0
    for k in range(10):
        data.qpos, data.qvel = states[0][k], states[1][k]
        mujoco.mj_forward(m, data)
        states[2][k], readings[k], pulls[k] = data.qacc, data.sensordata, data.qfrc_constraint
    wrench = base_wrench_regressor(tree, *states, gravity=gravity_in_base(m, "base")) @ phi
    torque = joint_torque_regressor(tree, *states, gravity=gravity_in_base(m, "base")) @ phi
    np.testing.assert_allclose(torque, pulls, atol=1e-9 * abs(pulls).max())
    assert (abs(pulls).max(axis=1) > 0.1).all()
    apart = abs(wrench - readings).max(axis=1) / abs(wrench).max(axis=1)
    assert (apart < 1e-10).all() if equality in INSIDE else (apart > 0.01).all()
