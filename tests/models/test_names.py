"""Bodies and joints without names, through all code that names them."""

import pytest

from experiments import excite
from ident.recordings.recording import Recording

UNNAMED = """<mujoco><worldbody><geom type="plane" size="2 2 .1" pos="0 0 -1"/>
<body><geom size=".1"/><site/>
<body name="body1" pos="0 0 .3"><joint name="joint1" axis="1 0 0" range="-100 100"/><geom size=".1"/>
<body pos="0 0 .3"><joint axis="0 1 0" range="-100 100"/><geom size=".1" pos="0 0 .5"/></body></body></body></worldbody>
<actuator><position joint="joint1" kp="500" kv="50"/></actuator>
<sensor><jointpos joint="joint1"/></sensor></mujoco>"""
"""The first body and the second joint have no names, and their default names are taken by others."""


@pytest.fixture
def path(tmp_path):
    out = tmp_path / "unnamed.xml"
    out.write_text(UNNAMED, encoding="utf-8")
    return out


def test_joints_without_names_are_excited(path, tmp_path):
    arguments = [str(path), "--base", "body1_", "--seconds", "4", "--starts", "1", "--iterations", "2"]
    assert excite.main([*arguments, "--collisions", "ignore", "--formats", "png", "--out", str(tmp_path)]) == 0
    channels = Recording.load(next(tmp_path.rglob("trajectory.npz"))).measured
    assert {"joint1_position", "joint1__position"} <= set(channels)
