"""Updated models of mechanisms with loops: bodies and drives change, and nothing else."""

import re

import numpy as np
import pytest
from looped import MODELS

import sim
from sim.models.model_update import write_model

pytestmark = pytest.mark.filterwarnings("ignore::sim.models.notes.ModelNote")


def constraints(text):
    """Sections with constraints of a file, byte for byte."""
    return re.findall(r"<(equality|tendon)>(.*?)</\1>", text, re.DOTALL)


@pytest.mark.parametrize("name", ["gripper", "tendons", "welded", "delta"])
def test_constraints_are_written_back_byte_for_byte(tmp_path, name):
    before = MODELS[name][0].replace(
        '<geom size=".02" mass="1"/>', '<inertial mass="1" pos="0 0 0" diaginertia="1 1 1"/>'
    )
    odd = "<!-- ä, as > is -->\n  <joint  name='odd' active='false' joint1=\"{0}\" polycoef=' 0  1' ></joint>"
    before = before.replace("</equality>", odd.format(MODELS[name][1][0]) + "</equality>", 1)
    (tmp_path / "arm.xml").write_text(before, encoding="utf-8")
    arm = sim.mechanism(tmp_path / "arm.xml")
    closed = arm.closed([joint for joint in arm.tree.joints if joint not in MODELS[name][1]])
    phi = 1.25 * closed.known
    write_model(tmp_path / "new.xml", arm, phi)
    after = (tmp_path / "new.xml").read_text(encoding="utf-8")
    assert constraints(after) == constraints(before) and "polycoef=' 0  1' >" in after
    assert after != before
    np.testing.assert_allclose(sim.mechanism(tmp_path / "new.xml").known, phi, rtol=1e-6, atol=1e-9)
