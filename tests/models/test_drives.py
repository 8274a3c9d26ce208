"""Drives of joints as MJCF and URDF files state them."""

from dataclasses import replace

import mujoco
import numpy as np
import pytest
from commands import sentence_of

import sim
from ident.mechanism.drives import Actuator, Drive
from sim.models.notes import ModelNote

ARM = """
<mujoco><compiler angle="radian"/>
  <default><joint damping=".5"/>
    <default class="geared"><joint armature=".2" frictionloss=".1"/><motor gear="50"/></default>
  </default>
  <worldbody><body name="base"><joint type="free" name="root" damping="2" stiffness="3"/><geom size=".1"/>
    <body name="upper"><joint name="shoulder"/><geom size=".1"/>
      <body name="lower" childclass="geared"><joint name="elbow"/><geom size=".1"/></body>
    </body>
  </body></worldbody>
  <actuator>{}</actuator>
</mujoco>
"""
URDF = """<robot name="r"><link name="base"/>
<link name="arm"><inertial><mass value="1"/><inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="elbow" type="revolute"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
<limit lower="-1" upper="1" effort="1" velocity="1"/>{}</joint><transmission name="t">{}</transmission></robot>"""
REDUCTION = '<joint name="elbow"/><actuator name="m"><mechanicalReduction>{}</mechanicalReduction></actuator>'


def arm(actuators=""):
    return sim.mechanism(mujoco.MjModel.from_xml_string(ARM.format(actuators)))


def test_actuators_have_their_gear_and_gains_and_a_free_joint_a_drive_for_each_of_its_freedoms():
    actuators = """
    <motor name="m" class="geared" joint="elbow" forcerange="-2 3"/>
    <position name="p" joint="elbow" kp="10" kv="2" gear="5"/>
    <velocity name="v" joint="elbow" kv="3"/>
    <general joint="elbow" gaintype="fixed" gainprm="2" biastype="affine" biasprm="1 -4 -5"/>
    <damper name="d" joint="elbow" kv="1" ctrlrange="0 1"/>
    """
    with pytest.warns(ModelNote, match="The forces of d are no gain times a command"):
        drives = arm(actuators).drives
    assert tuple(drives) == arm().tree.freedoms
    assert [drive for name, drive in drives.items() if "root" in name] == [Drive(viscous=2, stiffness=3)] * 6
    read = drives["elbow"].actuators
    assert read == (
        Actuator("m", gear=50, forcerange=(-2, 3)),
        Actuator("p", gear=5, gain=10, kp=10, kv=2),
        Actuator("v", gain=3, kv=3),
        Actuator("actuator3", gain=2, kp=4, kv=5, bias=1),
        Actuator("d", gain=0),
    )
    assert [each.kind for each in read] == ["motor", "position", "velocity", "general", "general"]


@pytest.mark.skipif(not hasattr(mujoco.mjtGain, "mjGAIN_DCMOTOR"), reason="this MuJoCo has no rotors and DC motors")
def test_motors_have_rotors_friction_and_gains():
    rotor = arm('<motor name="m" joint="shoulder" gear="-10" armature=".02" damping=".003"/>').drives["shoulder"]
    assert (rotor.viscous, rotor.rotor) == (0.5, 0.0)
    assert (rotor.value("viscous"), rotor.value("rotor")) == pytest.approx((0.8, 2.0))
    motor = '<dcmotor name="m" joint="elbow" motorconst=".1 .1" resistance="2"/>'
    with pytest.warns(ModelNote, match="The forces of m are no gain times a command"):
        assert arm(motor).drives["elbow"].actuators[0].kind == "general"


def test_drives_given_in_python_are_checked():
    for drives, message in (
        ({"knee": Drive()}, "drives names 'knee', which is none of root"),
        ({"elbow": 3}, "drives needs a Drive by the name of each driven freedom"),
        ({"elbow": Drive(springref="low")}, "Joint 'elbow' needs a finite spring reference, got low."),
        ({"elbow": Drive(actuators=(Actuator("m", gear=np.inf),))}, "'m' of joint 'elbow' needs a finite gear"),
        ({"elbow": Drive(actuators=(Actuator("m", rotor=-1),))}, "needs a rotor inertia of at least 0, got -1."),
    ):
        assert message in sentence_of(replace, arm(), drives=drives)


def test_a_transmission_of_one_joint_is_an_actuator_with_its_reduction_as_gear(written):
    for transmission, actuator in (
        (REDUCTION.format(50), ("m", 50)),
        ('<joint name="elbow"/><actuator name="m"/><mechanicalReduction>-2</mechanicalReduction>', ("m", -2)),
        ('<joint name="elbow"><mechanical_reduction>3.5</mechanical_reduction></joint>', ("t", 3.5)),
        ('<joint name="elbow"/><actuator name="m"/>', ("m", 1)),
        ('<joint name="elbow"/><joint name="wrist"/>', None),
        ('<joint name="wrist"/>', None),
        ("", None),
    ):
        drives = sim.mechanism(written("r.urdf", URDF.format("", transmission))).drives
        assert drives == ({"elbow": Drive(actuators=(Actuator(*actuator),))} if actuator else {})


def test_a_urdf_file_states_damping_friction_and_reductions_as_numbers(written):
    drives = sim.mechanism(written("r.urdf", URDF.format('<dynamics damping=".3" friction=".4"/>', ""))).drives
    assert drives == {"elbow": Drive(viscous=0.3, coulomb=0.4)}
    message = sentence_of(sim.mechanism, written("r.urdf", URDF.format('<dynamics damping="-.3"/>', "")))
    assert message.endswith("Joint 'elbow' needs a damping of at least 0, got -0.3.")
    for x in ("fifty", "0", "inf"):
        message = sentence_of(sim.mechanism, written("r.urdf", URDF.format("", REDUCTION.format(x))))
        assert f"transmission 't' needs a reduction that is a finite number other than 0, got '{x}'." in message
