"""Joint angles from markers by the command: its files, their use by `identify`, and errors."""

import json

import mujoco
import numpy as np
import pytest
from marked import labels_of, marked_person, trc, trial
from scipy.spatial.transform import Rotation

import ident
import scenes
import sim
from experiments.angles import main
from experiments.identify import main as identify
from ident.recordings.log import read_log
from ident.recordings.recording import Recording
from sim.markers.lengths import grouped, scaled_model
from sim.motion.excitation import DOUBLE_PENDULUM

STD = 0.002


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A person's model and trial, and the double pendulum's with its wrenches."""
    out, rng = tmp_path_factory.mktemp("markers"), np.random.default_rng(0)
    spec = marked_person()
    model = spec.compile()
    (out / "person.xml").write_text(spec.to_xml())
    groups = grouped(model)
    factors = np.random.default_rng(2).uniform(0.9, 1.1, len(groups))
    time, qpos, x = trial(scaled_model(model, groups, factors), 40)
    x += STD * rng.normal(size=x.shape)
    x[10:13, 4] = np.nan
    (out / "walk.trc").write_text(trc(time, [f"Anna:{label}" for label in labels_of(model)], x))
    np.savez(out / "truth.npz", qpos=qpos, factors=factors)
    return out


def test_a_person_is_scaled_and_her_angles_are_found(folder, tmp_path, capsys):
    arguments = [str(folder / "person.xml"), str(folder / "walk.trc"), "--scale", "--mass", "70"]
    assert main([*arguments, "--out", str(tmp_path / "out"), "--formats", "pdf"]) == 0
    output = capsys.readouterr().out
    assert "54 markers in 40 frames; the base is the frame of 'pelvis'." in output
    out = tmp_path / "out"
    with np.load(folder / "truth.npz") as archive:
        truth = dict(archive)
    person = sim.mechanism(out / "model_scaled.xml", base="pelvis")
    assert person.known.reshape(-1, 10)[:, 0].sum() == pytest.approx(70)
    recording = Recording.load(out / "angles.npz")
    knee = person.source.model.joint("left_knee").qposadr[0]
    z = (recording["left_knee_position"] - truth["qpos"][:, knee]) / recording.noise["left_knee_position"]
    assert np.sqrt((z**2).mean()) < 2
    first = int(person.source.model.joint("neck").qposadr[0])
    neck, true = (
        Rotation.from_quat(x, scalar_first=True)
        for x in (read_log(out / "angles.csv", person)["neck_position"], truth["qpos"][:, first : first + 4])
    )
    assert np.sqrt(((neck.inv() * true).as_rotvec() ** 2).mean()) < 2 * recording.noise["neck_position"]
    assert recording.base.shape == (40, 4, 4)
    np.testing.assert_allclose(recording.base[:, :3, 3], truth["qpos"][:, :3], atol=0.006)
    with np.load(out / "covariance.npz") as covariance:
        assert covariance["covariance"].shape == (40, 41, 41) and "left_knee" in covariance["names"]
    assert json.loads((out / "provenance.json").read_text())["options"]["mass"] == 70
    assert "table_lengths" in {path.stem for path in out.iterdir()} and "<h1>" in (out / "report.html").read_text()


@pytest.fixture(scope="module")
def pendulum(tmp_path_factory):
    """The double pendulum with markers: model, markers and wrenches as files, and the recording."""
    out, rng = tmp_path_factory.mktemp("pendulum"), np.random.default_rng(1)
    spec = scenes.load("double_pendulum")
    recorded = sim.simulate(spec, DOUBLE_PENDULUM, samples=200, seed=1)
    names = [body.name for body in spec.bodies[1:] if body.name != "load_cell"]
    for body in names:
        for k in range(4):
            spec.body(body).add_site(name=f"{body}_{k}", pos=rng.normal(scale=0.15, size=3))
    model = spec.compile()
    (out / "arm.xml").write_text(spec.to_xml())
    data, sites = mujoco.MjData(model), [f"{body}_{k}" for body in names for k in range(4)]
    joints = sim.mechanism(spec, base="base").tree.joints
    x = []
    for q in np.stack([recorded.true[f"{joint}_position"] for joint in joints], axis=1):
        data.qpos = q
        mujoco.mj_kinematics(model, data)
        x.append([data.site(site).xpos.copy() for site in sites])
    (out / "run.trc").write_text(trc(recorded.time, sites, np.array(x) + STD * rng.normal(size=(200, len(sites), 3))))
    wrenches = {name: recorded[name] for name in ("ground_force", "ground_torque")}
    Recording(recorded.time, wrenches).save(out / "wrenches.csv")
    return out, recorded, joints


@pytest.mark.usefixtures("undrawn")
def test_identify_reads_the_angles_as_they_are(pendulum, tmp_path, capsys):
    folder, recorded, joints = pendulum
    arguments = [str(folder / "arm.xml"), str(folder / "run.trc"), "--wrenches", str(folder / "wrenches.csv")]
    assert main([*arguments, "--base", "base", "--out", str(tmp_path / "angles"), "--formats", "png"]) == 0
    table = tmp_path / "angles" / "angles.csv"
    assert f"\nThen:\nmulticontact identify {arguments[0]} {table} --base base\n" in capsys.readouterr().out
    named = folder / "plate.csv"
    named.write_text((folder / "wrenches.csv").read_text().replace("ground_", "plate_"))
    assert main([*arguments[:3], str(named), "--base", "base", "--out", str(tmp_path / "n"), "--formats", "none"]) == 0
    output = capsys.readouterr().out
    assert "on which bodies the wrenches act, then:\n" in output and output.endswith("--columns COLUMNS.toml\n")
    arm = sim.mechanism(folder / "arm.xml", base="base")
    log = read_log(tmp_path / "angles" / "angles.csv", arm)
    recording = Recording.load(tmp_path / "angles" / "angles.csv")
    for joint in joints:
        error = log[f"{joint}_position"] - recorded.true[f"{joint}_position"]
        assert np.sqrt((error**2).mean()) == pytest.approx(recording.noise[f"{joint}_position"], rel=0.15)
    log_file = str(tmp_path / "angles" / "angles.npz")
    assert identify([str(folder / "arm.xml"), log_file, "--base", "base", "--out", str(tmp_path), "--name", "e"]) == 0
    estimate = json.loads((tmp_path / "e" / "estimate.json").read_text())
    regrouped = sim.mechanism(scenes.load("double_pendulum"), base="base").known
    truth = ident.find_base_parameters(arm.tree, gravity=arm.gravity).regroup(regrouped)
    z = (np.array(estimate["values"])[: len(truth)] - truth) / np.array(estimate["std"])[: len(truth)]
    assert np.sqrt((z**2).mean()) < 2


def test_places_on_bodies_and_the_upward_axis_come_from_a_file(pendulum, tmp_path, capsys):
    folder, recorded, joints = pendulum
    model = sim.mechanism(folder / "arm.xml").source.model
    places = {model.site(s).name: s for s in range(model.nsite) if model.site(s).name[-2:-1] == "_"}
    entries = "".join(
        f'[markers.{label}]\nbody = "{model.body(model.site_bodyid[s]).name}"\n'
        f"position = {model.site_pos[s].tolist()}\n"
        for label, s in places.items()
    )
    (tmp_path / "places.toml").write_text('up = "y"\n' + entries)
    lines = (folder / "run.trc").read_text().split("\n")
    for k, line in enumerate(lines[6:-1], start=6):
        cells = line.split("\t")
        for c in range(2, len(cells), 3):
            x, y, z = cells[c : c + 3]
            cells[c : c + 3] = x, z, repr(-float(y))
        lines[k] = "\t".join(cells)
    (tmp_path / "up.trc").write_text("\n".join(lines))
    bare = scenes.load("double_pendulum")
    bare.compile()
    (tmp_path / "bare.xml").write_text(bare.to_xml())
    arguments = [str(tmp_path / "bare.xml"), str(tmp_path / "up.trc"), "--places", str(tmp_path / "places.toml")]
    assert main([*arguments, "--base", "base", "--out", str(tmp_path / "out"), "--formats", "png"]) == 0
    recording = Recording.load(tmp_path / "out" / "angles.csv")
    for joint in joints:
        np.testing.assert_allclose(recording[f"{joint}_position"], recorded.true[f"{joint}_position"], atol=0.05)
