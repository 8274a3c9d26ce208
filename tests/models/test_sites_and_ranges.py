"""Properties of a mechanism in a model besides its tree."""

import mujoco
import numpy as np
import pytest

from sim.models import mujoco_model
from sim.models.model_mechanism import mechanism

ARM = """<mujoco><compiler angle="radian"/><worldbody><site name="wall"/><body name="base"><geom size=".1"/>
<body name="plinth" pos="0 0 .1" euler="0 0 .3"><geom size=".1"/><site name="low" pos="0 .2 0"/>
<body name="upper" pos="0 0 .2" euler=".4 0 0"><joint name="lift" axis="0 1 0" range="-1 2"/><geom size=".1"/>
<body name="tool" pos=".3 0 0" euler="0 .2 0"><geom size=".1"/><site name="tip" pos="0 0 .1" euler="0 0 .5"/>
<body name="ball"><joint name="wrist" type="ball" range="0 1"/><geom size=".1"/>
<body name="slider"><joint name="rail" type="slide"/><geom size=".1"/></body></body></body></body></body></body>
</worldbody></mujoco>"""


@pytest.fixture
def path(tmp_path):
    path = tmp_path / "arm.xml"
    path.write_text(ARM, encoding="utf-8")
    return path


@pytest.mark.parametrize("base", [None, "base", "plinth"])
@pytest.mark.parametrize("fix", [None, {"lift": [0.4]}])
def test_sites_stay_in_place_where_welds_are_merged(path, base, fix):
    kept, merged = (mechanism(path, base, merge_welds=merge, fix=fix) for merge in (False, True))
    assert len(merged.bodies) < len(kept.bodies) and kept.sites.keys() == merged.sites.keys()
    q = np.array([*([] if fix else [0.3]), 0.5, 0.5, 0.5, 0.5, 0.1])
    for name in kept.sites:
        places = [m.tree.poses(q)[m.tree.names.index(m.site(name)[0])] @ m.site(name)[1] for m in (kept, merged)]
        np.testing.assert_allclose(*places, atol=1e-12)


def test_a_site_is_where_mujoco_has_it(path):
    arm, model = mechanism(path, "base"), mujoco_model.compiled(path)
    data = mujoco.MjData(model)
    data.qpos[:] = [0.7, 0.5, 0.5, 0.5, 0.5, 0.1]
    mujoco.mj_kinematics(model, data)
    body, pose = arm.site("tip")
    computed = arm.tree.poses(data.qpos)[arm.tree.names.index(body)] @ pose
    np.testing.assert_allclose(computed[:3, 3], data.site("tip").xpos, atol=1e-12)
    np.testing.assert_allclose(computed[:3, :3].ravel(), data.site("tip").xmat, atol=1e-12)
    with pytest.raises(ValueError, match="no site named 'wall'; its sites are low, tip"):
        arm.site("wall")


def test_a_model_without_mass_is_a_mechanism_without_a_prior():
    ghost = mechanism(mujoco.MjSpec.from_string('<mujoco><worldbody><body name="ghost"/></worldbody></mujoco>'))
    assert ghost.tree.names == ("ghost",) and ghost.prior is None
    with pytest.raises(ValueError, match="A mechanism needs mass; ghost have none"):
        _ = ghost.weight
