"""Replays for Rerun's viewer are readable, with the bodies, forces and channels of the replay at its times."""

import sys

import numpy as np
import pytest
from commands import refusal
from pages import options
from scipy.spatial.transform import Rotation

import scenes
from experiments import identify
from experiments.document.replay import Replay, write_rerun
from ident import Motion, Recording
from sim import mechanism

pytestmark = pytest.mark.extras

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


def test_bodies_forces_and_curves_are_those_of_the_replay(tmp_path):
    pytest.importorskip("rerun", reason="rerun-sdk is in the extra 'rerun'")
    shown = replay()
    write_rerun(shown, tmp_path / "replay.rrd")
    written, poses = contents(tmp_path / "replay.rrd"), shown.poses(shown.drawn)
    for i, name in enumerate(shown.mechanism.tree.names):
        body = written[f"/mechanism/bodies/{name}"]
        np.testing.assert_allclose(body["time"], TIME[::2], atol=1e-9)
        translation = np.reshape(body["Transform3D:translation"], (-1, 3))
        np.testing.assert_allclose(translation, poses[:, i, :3, 3], atol=1e-6)
        turns = Rotation.from_quat(np.reshape(body["Transform3D:quaternion"], (-1, 4))).as_matrix()
        np.testing.assert_allclose(turns, poses[:, i, :3, :3], atol=1e-6)
        assert any(entity.startswith(f"/mechanism/bodies/{name}/shape") for entity in written)
    (place,) = written["/mechanism"]["Transform3D:translation"]
    np.testing.assert_allclose(place[0], shown.mechanism.pose[:3, 3], atol=1e-6)
    force = written["/mechanism/forces/ground"]
    vectors = np.reshape(force["Arrows3D:vectors"], (-1, 3))
    np.testing.assert_allclose(force["time"], TIME[::2], atol=1e-9)
    directions = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    np.testing.assert_allclose(directions, np.tile(FORCE / np.linalg.norm(FORCE), (len(vectors), 1)), atol=1e-6)
    for k, entity in enumerate(("/channels/Fz", "/channels/elbow\\ \\/\\ left")):
        for label, values in shown.curves.items():
            curve, there = written[f"{entity}/{label}"], np.isfinite(values[:, k])
            assert there.sum() == (7 if k and label == "predicted" else len(there))
            np.testing.assert_allclose(curve["time"], TIME[::2][there], atol=1e-9)
            np.testing.assert_array_equal(np.ravel(curve["Scalars:scalars"]), values[there, k])
            assert curve["SeriesLines:names"] == [[label]]


@pytest.mark.usefixtures("undrawn")
def test_identify_writes_it_and_the_page_links_to_it(tmp_path):
    pytest.importorskip("rerun", reason="rerun-sdk is in the extra 'rerun'")
    assert identify.main(options(tmp_path, "--rerun")) == 0
    entities = contents(tmp_path / "out" / "replay.rrd")
    assert {f"/mechanism/bodies/{body}" for body in ("base", "link1", "link2")} <= entities.keys()
    assert {"/mechanism/forces/contact", "/channels/Mx/measured", "/channels/Mx/predicted"} <= entities.keys()
    assert 'href="replay.rrd"' in (tmp_path / "out" / "report.html").read_text(encoding="utf-8")
    assert identify.main(options(tmp_path)) == 0
    assert not (tmp_path / "out" / "replay.rrd").exists()


def test_without_the_library_a_sentence_comes_before_any_work(tmp_path, monkeypatch, capsys):
    monkeypatch.setitem(sys.modules, "rerun", None)
    error = refusal(identify.main, [str(tmp_path / "no.xml"), str(tmp_path / "no.csv"), "--rerun"], capsys)
    assert error.endswith("""the extra 'rerun' brings: pip install -c constraints.txt -e ".[rerun]".\n""")
