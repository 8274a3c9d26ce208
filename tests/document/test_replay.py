"""Replays of a page and of Rerun's viewer: the bodies, forces, channels and findings of an estimate."""

import sys

import mujoco
import numpy as np
import pytest
from commands import entries_of, refusal
from pages import identified, options, replayed
from scipy.spatial.transform import Rotation

import scenes
from experiments import identify
from experiments.document.replay import Replay, ellipsoid, write_rerun
from ident import Motion, Recording
from ident.geometry.inertia import parameters_from_com
from sim import mechanism
from sim.models.model_mechanism import shapes


@pytest.mark.usefixtures("undrawn")
def test_findings_are_where_their_data_say(tmp_path):
    out = identified(tmp_path)
    shown, findings = replayed(out / "report.html")["findings"], entries_of(out / "estimate.json")["findings"]
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
    arm, data = mechanism(model, "base"), mujoco.MjData(model)
    solids = shapes(arm)
    assert [each.body for each in solids] == [0, 1, 1, 1, -1]
    exact = {1: 8 * 0.1 * 0.2 * 0.3, 2: np.pi * 0.05**2 * (0.6 + 0.05 * 4 / 3), 3: np.pi * 0.1**2 * 0.4, 4: 0.008}
    for k, volume in exact.items():
        corners = solids[k].vertices[solids[k].faces]
        inside = np.einsum("ij,ij->i", corners[:, 0], np.cross(corners[:, 1], corners[:, 2])).sum() / 6
        assert inside == pytest.approx(volume, rel=1e-9 if k in (1, 4) else 0.15) and inside <= volume * (1 + 1e-9)
    data.qpos[0] = 0.7
    mujoco.mj_kinematics(model, data)
    T = arm.pose @ arm.tree.poses(np.array([0.7]))[1]
    centre = T[:3, :3] @ solids[1].vertices.mean(axis=0) + T[:3, 3]
    np.testing.assert_allclose(centre, data.geom("box").xpos, atol=1e-12)
    np.testing.assert_allclose(solids[4].vertices.mean(axis=0) + arm.pose[:3, 3], [2, 0, 0], atol=1e-12)


TIME = np.arange(30) / 10
FORCE = np.array([0.0, 30.0, -200.0])


def replay():
    """A pendulum that swings under a constant force, whose second channel is predicted for its first half."""
    arm = mechanism(scenes.load("double_pendulum"), "base")
    force = np.tile(FORCE, (len(TIME), 1))
    recording = Recording(TIME, {"ground_force": force, "ground_torque": 0 * force})
    motion, drawn = Motion(np.outer(TIME, [0.2, 0.1]), *np.zeros((2, len(TIME), 2))), np.arange(0, len(TIME), 2)
    measured = np.stack([np.sin(TIME), np.cos(TIME)], axis=1)[drawn]
    predicted = np.where(np.arange(len(drawn))[:, None] < [len(drawn), 7], measured + 1, np.nan)
    channels = [("Fz", "N"), ("elbow / left", "N m")]
    return Replay(arm, recording, motion, channels, drawn, {"measured": measured, "predicted": predicted})


def contents(path):
    """Columns of an `.rrd` file by entity and component, times in s as `time`; one row of those without times."""
    chunk = pytest.importorskip("rerun.chunk", reason="rerun-sdk is in the extra 'rerun'")
    columns = {}
    for each in chunk.RrdReader(path).stream().to_chunks():
        batch = each.to_record_batch()
        names = [name for name in batch.schema.names if name != "rerun.controls.RowId"]
        rows = {name: batch.column(name).to_pylist() for name in names if name != "time"}
        if "time" in names:
            rows["time"] = batch.column("time").to_numpy(zero_copy_only=False).astype(float) / 1e9
        columns.setdefault(each.entity_path, {}).update(rows)
    return columns


@pytest.mark.extras
def test_bodies_forces_and_curves_are_those_of_the_replay(tmp_path):
    pytest.importorskip("rerun", reason="rerun-sdk is in the extra 'rerun'")
    shown, time = replay(), TIME[::2]
    write_rerun(shown, tmp_path / "replay.rrd")
    written, poses = contents(tmp_path / "replay.rrd"), shown.poses(shown.drawn)
    for i, name in enumerate(shown.mechanism.tree.names):
        body = written[f"/mechanism/bodies/{name}"]
        np.testing.assert_allclose(body["time"], time, atol=1e-9)
        translation = np.reshape(body["Transform3D:translation"], (-1, 3))
        np.testing.assert_allclose(translation, poses[:, i, :3, 3], atol=1e-6)
        turns = Rotation.from_quat(np.reshape(body["Transform3D:quaternion"], (-1, 4))).as_matrix()
        np.testing.assert_allclose(turns, poses[:, i, :3, :3], atol=1e-6)
        assert any(entity.startswith(f"/mechanism/bodies/{name}/shape") for entity in written)
    (place,) = written["/mechanism"]["Transform3D:translation"]
    np.testing.assert_allclose(place[0], shown.mechanism.pose[:3, 3], atol=1e-6)
    force = written["/mechanism/forces/ground"]
    vectors = np.reshape(force["Arrows3D:vectors"], (-1, 3))
    np.testing.assert_allclose(force["time"], time, atol=1e-9)
    directions = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    np.testing.assert_allclose(directions, np.tile(FORCE / np.linalg.norm(FORCE), (len(time), 1)), atol=1e-6)
    for k, entity in enumerate(("/channels/Fz", "/channels/elbow\\ \\/\\ left")):
        for label, values in shown.curves.items():
            curve, there = written[f"{entity}/{label}"], np.isfinite(values[:, k])
            assert there.sum() == (7 if k and label == "predicted" else len(there))
            np.testing.assert_allclose(curve["time"], time[there], atol=1e-9)
            np.testing.assert_array_equal(np.ravel(curve["Scalars:scalars"]), values[there, k])
            assert curve["SeriesLines:names"] == [[label]]


@pytest.mark.extras
@pytest.mark.usefixtures("undrawn")
def test_identify_writes_a_file_for_rerun_and_the_page_links_to_it(tmp_path):
    pytest.importorskip("rerun", reason="rerun-sdk is in the extra 'rerun'")
    assert identify.main(options(tmp_path, "--rerun")) == 0
    entities = contents(tmp_path / "out" / "replay.rrd")
    assert {f"/mechanism/bodies/{body}" for body in ("base", "link1", "link2")} <= entities.keys()
    assert {"/mechanism/forces/contact", "/channels/Mx/measured", "/channels/Mx/predicted"} <= entities.keys()
    assert 'href="replay.rrd"' in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert identify.main(options(tmp_path)) == 0
    assert not (tmp_path / "out" / "replay.rrd").exists()


def test_without_rerun_a_sentence_comes_before_any_work(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rerun", None)
    error = refusal(identify.main, [str(tmp_path / "no.xml"), str(tmp_path / "no.csv"), "--rerun"], capsys)
    assert error.endswith("""the extra 'rerun' brings: pip install -c constraints.txt -e ".[rerun]".\n""")
