"""A body without a robot: its pose and the wrench of a sensor on it, by Newton's and Euler's equations."""

import json
import os
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from coded import coded
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation
from written_formats import write_csv

import ident
from experiments import payload as command
from ident.mechanism.mechanism import Mechanism
from ident.parameters.consistency import consistent_parameters
from ident.payload.identified_payload import GUESSED
from ident.recordings.log import read_log

MASS, CENTRE, INERTIA = 0.8, np.array([0.02, -0.03, 0.12]), np.diag([6e-3, 5e-3, 2e-3])
TRUTH = np.array([MASS, *CENTRE, 6e-3, 5e-3, 2e-3, 0, 0, 0])
NOISE = {"p": 1e-4, "r": 2e-4, "f": 0.05, "m": 0.002}
COLUMNS = {
    "base": {"position": ["px", "py", "pz"], "quaternion": ["qw", "qx", "qy", "qz"]},
    "wrenches": {"ft": {"body": "tool", "force": ["fx", "fy", "fz"], "torque": ["mx", "my", "mz"]}},
}
COLUMNS["wrenches"]["ft"]["applied_to_link"] = False


@cache
def columns(seed=0, seconds=12.0):
    """Columns of a log at 100 Hz: what the body exerts on the sensor at its origin, in its axes."""
    rng, t = np.random.default_rng(seed), np.arange(round(100 * seconds)) / 100
    angles, p = (
        sum(s * np.sin(w * t[:, None] + rng.uniform(0, 6, 3)) for w in (1.1, 2.3, 4.7, 7.1)) for s in (0.45, 0.03)
    )
    turns = Rotation.from_euler("xyz", angles)
    a = CubicSpline(t, p)(t, 2)
    quaternion = turns.as_quat(canonical=False)
    derivative = CubicSpline(t, quaternion)(t, 1)
    v, s = quaternion[:, :3], quaternion[:, 3:]
    omega = 2 * (s * derivative[:, :3] - derivative[:, 3:] * v - np.cross(v, derivative[:, :3]))
    alpha = CubicSpline(t, omega)(t, 1)
    own = turns.inv().apply(a + np.array([0, 0, 9.81])) + np.cross(alpha, CENTRE)
    force = -MASS * (own + np.cross(omega, np.cross(omega, CENTRE)))
    moment = np.cross(CENTRE, force) - alpha @ INERTIA - np.cross(omega, omega @ INERTIA)
    p = p + NOISE["p"] * rng.normal(size=p.shape)
    q = (turns * Rotation.from_rotvec(NOISE["r"] * rng.normal(size=p.shape))).as_quat(scalar_first=True)
    force, moment = (x + NOISE[k] * rng.normal(size=x.shape) for k, x in (("f", force), ("m", moment)))
    names = [f"{what}{axis}" for what in "pqfm" for axis in ("wxyz" if what == "q" else "xyz")]
    return {"time": t} | dict(zip(names, np.hstack([p, q, force, moment]).T, strict=True))


@cache
def identified(seed):
    tool = Mechanism.lone_body("tool")
    return ident.identify_payload(tool, read_log(columns(seed), tool, COLUMNS), body="tool", sensor="ft")


def test_a_body_is_known_from_its_pose_and_the_wrench_on_its_sensor():
    distances = []
    for seed in range(2):
        payload = identified(seed)
        body = payload.in_frame()
        assert abs(body.values[0] - MASS) < 0.003 and np.abs(body.values[1:4] - CENTRE).max() < 0.002
        np.testing.assert_allclose(body.values[4:7], TRUTH[4:7], rtol=0.1)
        assert body.identifiable.all() and payload.verdict().usable and payload.model is None
        distances.append((body.values - TRUTH) / body.std_setup)
    assert (np.abs(distances) < 1.96).mean() > 0.85


def test_intervals_are_those_of_the_data_without_what_no_body_can_have():
    """A prior moves values inside them, and none of a moment of inertia that hardly shows goes below zero."""
    payload, narrow = identified(0), replace(identified(0))
    part, estimate = payload.estimate.prepared.mechanism, payload.estimate
    narrow.__dict__["physical"] = consistent_parameters(
        estimate.psi, estimate.covariance, estimate.base, part.known, bodies=part.bodies, width=0.1
    )
    body, pulled = payload.in_frame(), narrow.in_frame()
    middle = body.intervals.mean(axis=1)
    assert np.abs(pulled.values - body.values).max() > 10 * np.abs(pulled.intervals.mean(axis=1) - middle).max()
    np.testing.assert_allclose(np.diff(body.intervals)[:, 0], 2 * 1.96 * body.std_setup, rtol=1e-4)
    wide = replace(payload)
    noise = [1e4 * each for each in payload._covariances]
    wide.__dict__["physical"] = payload.physical
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(type(payload), "_covariances", noise)
        open_ = wide.in_frame()
    assert (open_.intervals[[0, 4, 5, 6], 0] == 0).all() and not open_.identifiable[4:7].any()
    assert (open_.intervals[:, 0] <= open_.values).all() and (open_.values <= open_.intervals[:, 1]).all()


def test_the_prior_s_share_in_the_smallest_moment_is_what_a_change_of_the_data_does_not_move(monkeypatch):
    payload = replace(identified(0))
    part, estimate, C = payload.estimate.prepared.mechanism, payload.estimate, 1e4 * payload._covariances[0]

    def physical(psi):
        covariance = 1e4 * estimate.covariance
        return consistent_parameters(psi, covariance, estimate.base, part.known, bodies=part.bodies, width=GUESSED)

    payload.__dict__["physical"] = physical(estimate.psi)
    monkeypatch.setattr(type(payload), "_covariances", (C, C))
    axis, std, prior = payload._least_moment()
    centre = payload.in_frame().values[1:4]
    off = centre - axis * (axis @ centre)
    gradient = np.r_[off @ off, -2 * off, axis**2, 2 * axis[[0, 0, 1]] * axis[[1, 2, 2]]]
    change = 1e-2 * C @ gradient / np.sqrt(gradient @ C @ gradient)
    ahead, behind = (physical(estimate.psi + sign * change @ payload._seen).phi for sign in (1, -1))
    assert gradient @ (ahead - behind) / (2 * gradient @ change) == pytest.approx(1 - prior, rel=1e-3)
    assert 0.1 < prior < 0.9
    (finding,) = coded(payload, "payload_axis_rough")
    assert finding.values["std"] == std > 0.1 and not finding.doubt


@pytest.mark.parametrize(("rpy", "sign"), [((0, 40, 0), -1), pytest.param((180, 0, 0), 1, marks=pytest.mark.slow)])
def test_poses_in_axes_that_do_not_stand_upright_are_noticed_and_stated(rpy, sign):
    """Of a laboratory with y or -z up: forces alone, of either sign, tell where down is."""
    tool, x, names = Mechanism.lone_body("tool"), dict(columns()), [f"q{k}" for k in "wxyz"]
    turns = Rotation.from_quat(np.stack([x[name] for name in names], axis=1), scalar_first=True)
    turns = Rotation.from_euler("xyz", rpy, degrees=True).inv() * turns
    x |= dict(zip(names, turns.as_quat(scalar_first=True).T, strict=True))
    position = Rotation.from_euler("xyz", rpy, degrees=True).inv().apply(np.stack([x[f"p{k}"] for k in "xyz"], axis=1))
    x |= dict(zip(("px", "py", "pz"), position.T, strict=True))
    wrong = {name: sign * value if name[0] in "fm" else value for name, value in x.items()}
    with pytest.raises(ident.InputError, match=r"Gravity has another direction .* recorded poses") as refused:
        ident.identify_payload(tool, read_log(wrong, tool, COLUMNS), body="tool", sensor="ft")
    angles = json.loads(str(refused.value).partition("rpy_deg = ")[2].partition("]")[0] + "]")
    assert np.abs(np.subtract(angles, rpy)).max() < 4
    log = read_log(x, tool, COLUMNS | {"base": COLUMNS["base"] | {"rpy_deg": list(rpy)}})
    body = ident.identify_payload(tool, log, body="tool", sensor="ft").in_frame()
    assert np.abs((body.values - TRUTH) / body.std_setup).max() < 4


def test_the_command_takes_a_log_without_a_model(tmp_path, capsys):
    write_csv(tmp_path / "swing.csv", columns(seconds=5.0))
    text = '[base]\nposition = ["px", "py", "pz"]\nquaternion = ["qw", "qx", "qy", "qz"]\n'
    text += '[wrenches.ft]\nbody = "tool"\n'
    text += 'force = ["fx", "fy", "fz"]\ntorque = ["mx", "my", "mz"]\napplied_to_link = false\n'
    (tmp_path / "c.toml").write_text(text)
    options = ["--body", "tool", "--sensor", "ft", "--formats", "svg", "--verbose"]
    options += ["--columns", str(tmp_path / "c.toml")]
    assert command.main([str(tmp_path / "swing.csv"), *options, "--out", str(tmp_path / "out")]) == 0
    folder = tmp_path / "out" / "tool-swing"
    assert not list(folder.glob("model.*"))
    assert json.loads((folder / "payload.json").read_text())["outcome"] == "usable"
    assert '"model": null' in (folder / "provenance.json").read_text()
    assert "Carried: tool, at the recorded poses" in capsys.readouterr().out
    (tmp_path / "c.toml").write_text(text[text.index("[wrenches") :])
    for arguments, message in (
        ([str(tmp_path / "swing.csv")], "No joint moves 'tool': its pose has to be that of the base, 'tool', and the"),
        (["arm.xml"], "payload needs a model and logs, or logs of a body alone; got 'arm.xml', no log."),
    ):
        assert command.main([*arguments, *options]) == 2
        assert message in capsys.readouterr().err


DATA = Path(os.environ.get("MULTICONTACT_DATA", "")) / "tools"


@pytest.mark.skipif(not DATA.is_dir(), reason="MULTICONTACT_DATA has no folder of tools")
@pytest.mark.parametrize("name", ["box_wrench", "pliers"])
def test_workshop_tools_of_others(name):
    """A tool that a robot moves by its sensor, with noise as published: Nadeau et al. 2022, with z down."""
    rng, table = np.random.default_rng(0), np.genfromtxt(DATA / f"{name}.csv", delimiter=",", names=True)
    x = {key: table[key] for key in table.dtype.names}
    x |= {key: x[key] + 1e-4 * rng.normal(size=len(table)) for key in ("x", "y", "z")}
    turned = Rotation.from_quat(np.stack([x[f"q{k}"] for k in "wxyz"], axis=1), scalar_first=True)
    noise = Rotation.from_rotvec(np.radians(0.01) * rng.normal(size=(len(table), 3)))
    x |= dict(zip(("qw", "qx", "qy", "qz"), (turned * noise).as_quat(scalar_first=True).T, strict=True))
    for kind, level in (("f", 0.1), ("m", 0.005)):
        x |= {f"{kind}{k}": x[f"{kind}{k}"] + level * rng.normal(size=len(table)) for k in "xyz"}
    base = {**COLUMNS["base"], "position": ["x", "y", "z"], "rpy_deg": [180, 0, 0]}
    mapping = {"base": base, "wrenches": {"ft": {**COLUMNS["wrenches"]["ft"], "applied_to_link": True}}}
    tool, truth = Mechanism.lone_body("tool"), json.loads((DATA / f"{name}.json").read_text())
    log = read_log(x, tool, mapping)
    body = ident.identify_payload(tool, log, body="tool", sensor="ft", offsets=False).in_frame()
    inertia = np.array(truth["inertia_about_centre"])[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    distance = (body.values - [truth["mass"], *truth["centre"], *inertia]) / body.std_setup
    assert np.abs(distance[:4]).max() < 3 and np.abs(distance[body.identifiable]).max() < 3
    assert abs(body.values[0] / truth["mass"] - 1) < 0.05
