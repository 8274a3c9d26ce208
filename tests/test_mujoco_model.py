import mujoco
import numpy as np
import pytest

from sim.mujoco_model import gravity_in_base, parameters_from_model, tree_from_model


def model(body, before=""):
    return mujoco.MjModel.from_xml_string(
        f'<mujoco><compiler angle="radian"/><worldbody>{before}<body name="base">'
        f'<geom size=".1"/>{body}</body></worldbody></mujoco>'
    )


def test_only_the_bodies_on_the_base_belong_to_the_tree():
    arm = '<body name="arm"><joint name="elbow"/><geom size=".1"/></body>'
    other = '<body name="pad"><joint type="slide"/><geom size=".1"/></body>'
    m = model(arm, other)
    assert tree_from_model(m).names == ("base", "arm")
    assert tree_from_model(m).joints == ("elbow",)
    assert parameters_from_model(m).shape == (20,)


def test_gravity_is_turned_with_the_base():
    m = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body name="base" euler="90 0 0"><geom size=".1"/></body></worldbody></mujoco>'
    )
    np.testing.assert_allclose(gravity_in_base(m), [0, -9.81, 0], atol=1e-12)


@pytest.mark.parametrize(
    ("body", "base", "message"),
    [
        ("", "foot", "no body named 'foot'; its bodies are base"),
        ('<body name="arm"><geom size=".1"/></body>', "arm", "'arm' must be fixed to the world"),
        ('<body name="arm"><joint name="wrist" type="ball"/><geom size=".1"/></body>', "base", "'wrist', of type ball"),
        (
            '<body name="arm"><joint name="u"/><joint name="w" axis="1 0 0"/><geom size=".1"/></body>',
            "base",
            "'arm' needs at most one joint, hinge or slide; it has 2",
        ),
    ],
)
def test_models_that_the_tree_cannot_hold_are_refused(body, base, message):
    with pytest.raises(ValueError, match=message):
        tree_from_model(model(body), base)
