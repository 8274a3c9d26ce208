"""Replay of a page: its size, the numbers of the JSON beside it, and agreement with MuJoCo."""

import json

import mujoco
import numpy as np
import pytest
from pages import identified, replayed

from experiments.document.replay import ellipsoid
from ident.geometry.inertia import parameters_from_com
from sim import mechanism
from sim.models.model_mechanism import shapes


@pytest.mark.usefixtures("undrawn")
def test_findings_are_where_their_data_say(tmp_path):
    out = identified(tmp_path)
    shown = replayed(out / "report.html")["findings"]
    findings = json.loads((out / "estimate.json").read_text())["findings"]
    places = {each["text"]: (each["place"], page) for each, page in zip(findings, shown, strict=True)}
    place, page = next(each for text, each in places.items() if "constant offsets of" in text)
    assert place == {"channels": ["Fz", "Mx", "My"]} and page["channels"] == ["Fz", "Mx", "My"]
    assert page["where"] == "The finding is about channels Fz, Mx, My."
    place, page = next(each for text, each in places.items() if text.startswith("The updated model"))
    assert set(place["bodies"]) == {"link1", "link2"} and page["body"] in (1, 2)
    assert page["where"] == f"The finding is about bodies {', '.join(place['bodies'])}."
    assert all(page["where"] == "" for place, page in places.values() if not place)


def test_ellipsoids_are_those_of_uniform_bodies():
    a, b, c = 0.3, 0.2, 0.1
    R = np.linalg.qr(np.random.default_rng(0).normal(size=(3, 3)))[0]
    inertia = R @ np.diag([b**2 + c**2, a**2 + c**2, a**2 + b**2]) @ R.T * 2.0 / 5
    *semi_axes, centre = ellipsoid(parameters_from_com(2.0, np.array([0.1, 0.2, 0.3]), inertia))
    np.testing.assert_allclose(sorted(np.linalg.norm(semi_axes, axis=1)), [c, b, a], rtol=1e-4)
    np.testing.assert_allclose(centre, [0.1, 0.2, 0.3], rtol=1e-4)
    np.testing.assert_allclose(abs(np.array(semi_axes[-1]) @ R[:, 0]), a, rtol=1e-4)
    assert ellipsoid(np.zeros(10)) is None


GEOMS = """
<mujoco><worldbody><geom type="plane" size="1 1 1"/><body name="base" pos="0 0 1"><geom size=".1" mass="1"/>
<body name="arm" pos="0 0 .5" euler="0 40 0"><joint name="hinge" axis="0 1 0"/>
<geom name="box" type="box" size=".1 .2 .3" pos="0 0 .3" euler="10 20 30"/>
<geom name="capsule" type="capsule" size=".05 .3"/><geom name="cylinder" type="cylinder" size=".1 .2"/>
<geom name="hidden" size="9" group="3" mass="0"/></body></body>
<body name="post"><geom name="post" type="box" size=".1 .1 .1" pos="2 0 0"/></body></worldbody></mujoco>
"""


def test_shapes_have_the_volumes_of_their_geoms_and_are_where_mujoco_has_them():
    model = mujoco.MjModel.from_xml_string(GEOMS)
    arm = mechanism(model, "base")
    solids = shapes(arm)
    assert [each.body for each in solids] == [0, 1, 1, 1, -1]
    exact = {1: 8 * 0.1 * 0.2 * 0.3, 2: np.pi * 0.05**2 * (0.6 + 0.05 * 4 / 3), 3: np.pi * 0.1**2 * 0.4, 4: 0.008}
    for k, volume in exact.items():
        corners = solids[k].vertices[solids[k].faces]
        inside = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
        assert inside == pytest.approx(volume, rel=1e-9 if k in (1, 4) else 0.15) and inside <= volume * (1 + 1e-9)
    data = mujoco.MjData(model)
    data.qpos[0] = 0.7
    mujoco.mj_kinematics(model, data)
    T = arm.pose @ arm.tree.poses(np.array([0.7]))[1]
    centre = T[:3, :3] @ solids[1].vertices.mean(axis=0) + T[:3, 3]
    np.testing.assert_allclose(centre, data.geom("box").xpos, atol=1e-12)
    np.testing.assert_allclose(solids[4].vertices.mean(axis=0) + arm.pose[:3, 3], [2, 0, 0], atol=1e-12)
