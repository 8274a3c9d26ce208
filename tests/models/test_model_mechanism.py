"""Names, fixed joints, sites, ranges and plausible units of a model, besides its tree."""

import mujoco
import numpy as np
import pytest
from commands import refusal, sentence_of

import sim
from experiments import identify
from ident.geometry.se3 import pose
from ident.recordings.recording import Recording
from sim.models.model_mechanism import mechanism
from sim.models.notes import ModelNote

INERTIAL = '<inertial mass="{}" pos=".05 .02 .1" fullinertia=".02 .03 .015 .001 0 .002"/>'
HAND = f"""<mujoco><worldbody><body name="base">{INERTIAL.format(3)}
<body name="arm" pos="0 0 .3"><joint name="shoulder" axis="0 1 0"/>{INERTIAL.format(2)}
<body name="left" pos=".3 0 0"><joint name="finger1" type="slide" axis="0 1 0"/>{INERTIAL.format(0.3)}</body>
<body name="right" pos=".3 0 0"><joint name="finger2" type="slide" axis="0 -1 0"/>{INERTIAL.format(0.4)}</body>
</body></body></worldbody><equality><joint joint1="finger2" joint2="finger1"/></equality></mujoco>"""
"""An arm with two fingers, coupled like mimic joints of URDF."""


@pytest.mark.usefixtures("here")
def test_what_to_type_is_said(written, tmp_path, capsys):
    model, x = written("hand.xml", HAND), np.arange(300) / 100
    wrench = dict.fromkeys(("ground_force", "ground_torque"), np.tile(x, (3, 1)).T)
    Recording(x, {"shoulder_position": np.sin(x), **wrench}).save(tmp_path / "log.csv")
    arguments = [str(model), str(tmp_path / "log.csv"), "--base", "base", "--out", str(tmp_path / "out")]
    message = refusal(identify.main, arguments, capsys)
    assert "Where it does not move, --fix finger1 [VALUE] leaves it out" in message.replace("the joint", "it")
    assert "Note: By the constraints equality0 of finger1, finger2, joints without a column follow" in message
    message = refusal(identify.main, [*arguments, "--fix", "finger1", "open"], capsys)
    assert "--fix takes a joint and where it stands, got finger1 open." in message
    for values in ([0.0, 1.0], [np.nan]):
        message = sentence_of(mechanism, mujoco.MjSpec.from_string(ARM), fix={"lift": values})
        assert message == f"Joint 'lift' is fixed at 1 coordinates below 1e+08, got {values}."


UNNAMED = """<mujoco><worldbody><body><geom size=".1"/><site/>
<body name="body1" pos="0 0 .3"><joint name="joint1" axis="1 0 0"/><geom size=".1"/>
<body pos="0 0 .3"><joint axis="0 1 0"/><geom size=".1"/></body></body></body></worldbody></mujoco>"""
"""The first body and the second joint have no names, and their default names are taken by others."""


def test_joints_without_names_have_names_of_their_own():
    arm = mechanism(mujoco.MjSpec.from_string(UNNAMED), "body1_")
    assert arm.joints == ("joint1", "joint1_") and arm.bodies == ("body1_", "body1", "body3")
    assert arm.sites.keys() == {"site0"}


ARM = """<mujoco><compiler angle="radian"/><worldbody><site name="wall"/><body name="base"><geom size=".1"/>
<body name="plinth" pos="0 0 .1" euler="0 0 .3"><geom size=".1"/><site name="low" pos="0 .2 0"/>
<body name="upper" pos="0 0 .2" euler=".4 0 0"><joint name="lift" axis="0 1 0" range="-1 2"/><geom size=".1"/>
<body name="tool" pos=".3 0 0" euler="0 .2 0"><geom size=".1"/><site name="tip" pos="0 0 .1" euler="0 0 .5"/>
<body name="ball"><joint name="wrist" type="ball" range="0 1"/><geom size=".1"/>
<body name="slider"><joint name="rail" type="slide"/><geom size=".1"/></body></body></body></body></body></body>
<body name="goal" mocap="true"><site name="goal"/></body></worldbody></mujoco>"""


@pytest.mark.parametrize("base", [None, "base", "plinth"])
@pytest.mark.parametrize("fix", [None, {"lift": [0.4]}])
def test_sites_are_where_mujoco_has_them(base, fix):
    model, spec = mujoco.MjModel.from_xml_string(ARM), mujoco.MjSpec.from_string(ARM)
    data = mujoco.MjData(model)
    data.qpos[:] = [0.4 if fix else 0.7, 0.5, 0.5, 0.5, 0.5, 0.1]
    mujoco.mj_kinematics(model, data)
    home = pose(data.body(base or "world").xmat.reshape(3, 3), data.body(base or "world").xpos)
    arm = mechanism(spec, base, fix=fix)
    assert {"low", "tip"} == arm.sites.keys()
    poses = home @ arm.tree.poses(data.qpos[len(fix or ()) :])
    for name in arm.sites:
        body, place = arm.site(name)
        T = poses[arm.tree.names.index(body)] @ place
        np.testing.assert_allclose(T[:3, 3], data.site(name).xpos, atol=1e-12)
        np.testing.assert_allclose(T[:3, :3].ravel(), data.site(name).xmat, atol=1e-12)
    with pytest.raises(ValueError, match="no site named 'gone'; its sites are "):
        arm.site("gone")


def test_a_model_without_mass_is_a_mechanism_without_a_prior():
    ghost = mechanism(mujoco.MjSpec.from_string('<mujoco><worldbody><body name="ghost"/></worldbody></mujoco>'))
    assert ghost.tree.names == ("ghost",) and ghost.prior is None
    with pytest.raises(ValueError, match="A mechanism needs mass; ghost have none"):
        _ = ghost.weight


PLAIN_ARM = """<mujoco><worldbody><body name="upper"><joint name="lift" axis="0 1 0"/>
  <inertial mass="{m}" pos="{c} 0 0" diaginertia="{i} {k} {k}"/>
  <body name="fore" pos="{length} 0 0"><joint name="bend" axis="0 1 0"/>
  <inertial mass="{m}" pos="{c} 0 0" diaginertia="{i} {k} {k}"/></body></body></worldbody></mujoco>"""


def arm(*, mass=1.0, length=1.0, inertia=1.0):
    """An arm of two links of 2 kg and 300 mm, with factors on its units."""
    numbers = {"m": 2 * mass, "c": 0.15 * length, "length": 0.3 * length, "i": 0.002 * inertia, "k": 0.016 * inertia}
    return sim.mechanism(mujoco.MjSpec.from_string(PLAIN_ARM.format(**numbers)))


@pytest.mark.parametrize(
    ("factors", "noted"),
    [
        ({"length": 1e3}, "'fore' from its parent at 300 m: its lengths may be in mm"),
        ({"inertia": 1e4}, "upper .*, fore .*: their inertias may be in kg cm²"),
        ({"inertia": 1e7}, "upper .*, fore .*: their inertias may be in g cm²"),
        ({"inertia": 1e9}, "upper .*, fore .*: their inertias may be in g mm²"),
        ({"mass": 1e3}, "upper .*, fore .*: their masses may be in g"),
        ({"mass": 1e3, "inertia": 1e3}, "upper .*, fore .*: their masses may be in g"),
        ({"mass": 1e3, "inertia": 1e9}, "or in g mm² with masses in g"),
    ],
)
def test_a_unit_that_no_material_allows_is_noted_with_the_body(factors, noted):
    with pytest.warns(ModelNote, match=noted) as notes:
        arm(**factors)
    assert [each.filename for each in notes] == [__file__]
