"""Joint angles from markers by the command: its files, their use by `identify`, and errors."""

import numpy as np
import pytest
from commands import entries_of
from marked import labels_of, marked_person, trc, trial
from pages import PENDULUM
from scipy.spatial.transform import Rotation

import ident
import scenes
import sim
from experiments.angles import main
from ident.recordings.log import read_log
from ident.recordings.recording import Recording
from sim.markers.lengths import grouped, scaled_model
from sim.motion.excitation import DOUBLE_PENDULUM

STD = 0.002


def error_over_noise(recording, name, error):
    """Root mean square of errors of a channel over its stated noise."""
    return np.sqrt(np.mean(error**2)) / recording.noise[name]


def test_a_person_is_scaled_and_her_angles_are_found(tmp_path, capsys):
    spec, rng, out = marked_person(), np.random.default_rng(0), tmp_path / "out"
    model = spec.compile()
    (tmp_path / "person.xml").write_text(spec.to_xml())
    groups = grouped(model)
    time, qpos, x = trial(scaled_model(model, groups, rng.uniform(0.9, 1.1, len(groups))), 40)
    x += STD * rng.normal(size=x.shape)
    x[10:13, 4] = np.nan
    (tmp_path / "walk.trc").write_text(trc(time, [f"Anna:{label}" for label in labels_of(model)], x))
    given = [str(tmp_path / "person.xml"), str(tmp_path / "walk.trc"), "--scale", "--mass", "70"]
    assert main([*given, "--out", str(out), "--formats", "pdf"]) == 0
    assert "54 markers in 40 frames; the base is the frame of 'pelvis'." in capsys.readouterr().out
    person = sim.mechanism(out / "model_scaled.xml", base="pelvis")
    assert person.known[::10].sum() == pytest.approx(70)
    recording = Recording.load(out / "angles.npz")
    knee, neck = (person.source.model.joint(name).qposadr[0] for name in ("left_knee", "neck"))
    error = recording["left_knee_position"] - qpos[:, knee]
    assert error_over_noise(recording, "left_knee_position", error) < 2
    read = read_log(out / "angles.csv", person)["neck_position"]
    own, true = (Rotation.from_quat(x, scalar_first=True) for x in (read, qpos[:, neck : neck + 4]))
    assert error_over_noise(recording, "neck_position", (own.inv() * true).as_rotvec()) < 2
    assert recording.base.shape == (40, 4, 4)
    np.testing.assert_allclose(recording.base[:, :3, 3], qpos[:, :3], atol=0.006)
    with np.load(out / "covariance.npz") as covariance:
        assert covariance["covariance"].shape == (40, 41, 41) and "left_knee" in covariance["names"]
    assert entries_of(out / "provenance.json")["options"]["mass"] == 70


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory):
    """The double pendulum with markers: model, markers and wrenches as files, and the recording."""
    out, rng, spec = tmp_path_factory.mktemp("pendulum"), np.random.default_rng(1), scenes.load("double_pendulum")
    recorded = sim.simulate(spec, DOUBLE_PENDULUM, samples=200, seed=1)
    arm = sim.mechanism(spec, base="base")
    q = np.stack([recorded.true[f"{joint}_position"] for joint in arm.tree.joints], axis=1)
    markers = {}
    for body, T in zip(arm.tree.names, np.moveaxis(arm.pose @ arm.tree.poses(q), 1, 0), strict=True):
        for k, place in enumerate(rng.normal(scale=0.15, size=(4, 3))):
            spec.body(body).add_site(name=f"{body}_{k}", pos=place)
            markers[f"{body}_{k}"] = T[:, :3, :3] @ place + T[:, :3, 3]
    spec.compile()
    (out / "arm.xml").write_text(spec.to_xml())
    x = np.stack([*markers.values()], axis=1) + STD * rng.normal(size=(200, len(markers), 3))
    (out / "run.trc").write_text(trc(recorded.time, markers, x))
    (out / "upward_y.trc").write_text(trc(recorded.time, markers, x[:, :, [0, 2, 1]] * [1, 1, -1]))
    wrenches = {name: recorded[name] for name in ("ground_force", "ground_torque")}
    Recording(recorded.time, wrenches).save(out / "wrenches.csv")
    return out, recorded, arm.tree.joints


def test_angles_are_read_as_they_are_and_identify(pendulum, tmp_path, capsys):
    folder, recorded, joints = pendulum
    model, markers, wrenches, plate = (str(folder / x) for x in ("arm.xml", "run.trc", "wrenches.csv", "plate.csv"))
    (folder / "plate.csv").write_text((folder / "wrenches.csv").read_text().replace("ground_", "plate_"))
    given = [model, markers, "--base", "base", "--out", str(tmp_path), "--formats", "none", "--wrenches"]
    assert main([*given, plate]) == 0
    output = capsys.readouterr().out
    assert "on which bodies the wrenches act, then:\n" in output and output.endswith("--columns COLUMNS.toml\n")
    assert main([*given, wrenches]) == 0
    command = f"multicontact identify {model} {tmp_path / 'angles.csv'} --base base"
    assert f"\nThen:\n{command}\n" in capsys.readouterr().out
    arm, recording = sim.mechanism(folder / "arm.xml", base="base"), Recording.load(tmp_path / "angles.csv")
    log = read_log(tmp_path / "angles.csv", arm)
    for name in (f"{joint}_position" for joint in joints):
        assert error_over_noise(recording, name, log[name] - recorded.true[name]) == pytest.approx(1, rel=0.15)
    estimate = ident.identify(arm, read_log(tmp_path / "angles.npz", arm))
    truth = estimate.base.regroup(sim.mechanism(PENDULUM, base="base").known)
    assert np.sqrt(np.mean(((estimate.psi - truth) / estimate.std) ** 2)) < 2


def test_places_on_bodies_and_the_upward_axis_come_from_a_file(pendulum, tmp_path):
    folder, recorded, joints = pendulum
    model = sim.mechanism(folder / "arm.xml").source.model
    entries = ['up = "y"']
    for site in (model.site(s) for s in range(model.nsite) if model.site(s).name[-2:-1] == "_"):
        body = model.body(site.bodyid[0]).name
        entries.append(f'[markers.{site.name}]\nbody = "{body}"\nposition = {site.pos.tolist()}')
    (tmp_path / "places.toml").write_text("\n".join(entries))
    given = [PENDULUM, folder / "upward_y.trc", "--places", tmp_path / "places.toml", "--out", tmp_path / "out"]
    assert main([*map(str, given), "--base", "base", "--formats", "none"]) == 0
    recording = Recording.load(tmp_path / "out" / "angles.csv")
    for joint in joints:
        np.testing.assert_allclose(recording[f"{joint}_position"], recorded.true[f"{joint}_position"], atol=0.05)
