"""A body without a robot: its pose and the wrench of a sensor on it, by Newton's and Euler's equations."""

import json
import os
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from coded import coded
from commands import refusal
from scipy.interpolate import CubicSpline
from scipy.spatial.transform import Rotation
from written_formats import write_csv

import ident
from experiments import payload as command
from ident import Mechanism, consistent_parameters, read_log
from ident.payload import GUESSED

MASS, CENTRE, INERTIA = 0.8, np.array([0.02, -0.03, 0.12]), np.diag([6e-3, 5e-3, 2e-3])
TRUTH = np.array([MASS, *CENTRE, 6e-3, 5e-3, 2e-3, 0, 0, 0])
TOOL = Mechanism.lone_body("tool")
QUATERNION = ["qw", "qx", "qy", "qz"]
BASE = {"position": ["px", "py", "pz"], "quaternion": QUATERNION}
FELT = {"body": "tool", "force": ["fx", "fy", "fz"], "torque": ["mx", "my", "mz"], "applied_to_link": False}


def turns_of(x):
    return Rotation.from_quat(np.stack([x[name] for name in QUATERNION], axis=1), scalar_first=True)


def turned(turns):
    return dict(zip(QUATERNION, turns.as_quat(scalar_first=True).T, strict=True))


def noise_of(rng, std, turns):
    return turns * Rotation.from_rotvec(std * rng.normal(size=(len(turns), 3)))


@cache
def columns(seconds=8.0):
    """Columns of a log at 100 Hz: what the body exerts on the sensor at its origin, in its axes."""
    rng, t = np.random.default_rng(0), np.arange(round(100 * seconds)) / 100
    angles, p = (
        sum(s * np.sin(w * t[:, None] + rng.uniform(0, 6, 3)) for w in (1.1, 2.3, 4.7, 7.1)) for s in (0.45, 0.03)
    )
    turns = Rotation.from_euler("xyz", angles)
    a, quaternion = CubicSpline(t, p)(t, 2), turns.as_quat(canonical=False)
    derivative = CubicSpline(t, quaternion)(t, 1)
    v, s = quaternion[:, :3], quaternion[:, 3:]
    omega = 2 * (s * derivative[:, :3] - derivative[:, 3:] * v - np.cross(v, derivative[:, :3]))
    alpha = CubicSpline(t, omega)(t, 1)
    own = turns.inv().apply(a + np.array([0, 0, 9.81])) + np.cross(alpha, CENTRE)
    force = -MASS * (own + np.cross(omega, np.cross(omega, CENTRE)))
    moment = np.cross(CENTRE, force) - alpha @ INERTIA - np.cross(omega, omega @ INERTIA)
    p, force, moment = (x + std * rng.normal(size=x.shape) for x, std in ((p, 1e-4), (force, 0.05), (moment, 0.002)))
    names = [*BASE["position"], *FELT["force"], *FELT["torque"]]
    out = {"time": t} | dict(zip(names, np.hstack([p, force, moment]).T, strict=True))
    return out | turned(noise_of(rng, 2e-4, turns))


def identified(x, base=BASE, felt=FELT, **options):
    log = read_log(x, TOOL, {"base": base, "wrenches": {"ft": felt}})
    return ident.identify_payload(TOOL, log, body="tool", sensor="ft", **options)


@cache
def payload():
    return identified(columns())


def test_a_body_is_known_from_its_pose_and_the_wrench_on_its_sensor():
    body = payload().in_frame()
    assert abs(body.values[0] - MASS) < 0.003 and np.abs(body.values[1:4] - CENTRE).max() < 0.002
    np.testing.assert_allclose(body.values[4:7], TRUTH[4:7], rtol=0.1)
    assert body.identifiable.all() and payload().verdict().usable and payload().model is None
    assert (np.abs(body.values - TRUTH) < 1.96 * body.std_setup).mean() > 0.85


def physical(own, psi, covariance, width):
    part = own.estimate.prepared.mechanism
    return consistent_parameters(psi, covariance, own.estimate.base, part.known, bodies=part.bodies, width=width)


def test_intervals_are_those_of_the_data_without_what_no_body_can_have(monkeypatch):
    """A prior moves values inside them, and none of a moment of inertia that hardly shows goes below zero."""
    usual, narrow, wide = payload(), replace(payload()), replace(payload())
    narrow.__dict__["physical"] = physical(usual, usual.estimate.psi, usual.estimate.covariance, 0.1)
    body, pulled = usual.in_frame(), narrow.in_frame()
    middle = body.intervals.mean(axis=1)
    assert np.abs(pulled.values - body.values).max() > 10 * np.abs(pulled.intervals.mean(axis=1) - middle).max()
    np.testing.assert_allclose(np.diff(body.intervals)[:, 0], 2 * 1.96 * body.std_setup, rtol=1e-4)
    noise = [1e4 * each for each in usual._covariances]
    wide.__dict__["physical"] = usual.physical
    monkeypatch.setattr(type(wide), "_covariances", noise)
    open_ = wide.in_frame()
    assert (open_.intervals[[0, 4, 5, 6], 0] == 0).all() and not open_.identifiable[4:7].any()
    assert (open_.intervals[:, 0] <= open_.values).all() and (open_.values <= open_.intervals[:, 1]).all()


def test_the_prior_s_share_in_the_smallest_moment_is_what_a_change_of_the_data_does_not_move(monkeypatch):
    own = replace(payload())
    estimate, C = own.estimate, 1e4 * own._covariances[0]

    def moved(by):
        return physical(own, estimate.psi + by, 1e4 * estimate.covariance, GUESSED)

    own.__dict__["physical"] = moved(0)
    monkeypatch.setattr(type(own), "_covariances", (C, C))
    axis, std, prior = own._least_moment()
    centre = own.in_frame().values[1:4]
    off = centre - axis * (axis @ centre)
    gradient = np.r_[off @ off, -2 * off, axis**2, 2 * axis[[0, 0, 1]] * axis[[1, 2, 2]]]
    change = 1e-2 * C @ gradient / np.sqrt(gradient @ C @ gradient)
    ahead, behind = (moved(sign * change @ own._seen).phi for sign in (1, -1))
    assert gradient @ (ahead - behind) / (2 * gradient @ change) == pytest.approx(1 - prior, rel=1e-3)
    assert 0.1 < prior < 0.9
    (finding,) = coded(own, "payload_axis_rough")
    assert finding.values["std"] == std > 0.1 and not finding.doubt


@pytest.mark.parametrize(("rpy", "sign"), [((0, 40, 0), -1), pytest.param((180, 0, 0), 1, marks=pytest.mark.slow)])
def test_poses_in_axes_that_do_not_stand_upright_are_noticed_and_stated(rpy, sign):
    """Of a laboratory with y or -z up: forces alone, of either sign, tell where down is."""
    x, turn = dict(columns(12.0)), Rotation.from_euler("xyz", rpy, degrees=True).inv()
    position = turn.apply(np.stack([x[name] for name in BASE["position"]], axis=1))
    x |= turned(turn * turns_of(x)) | dict(zip(BASE["position"], position.T, strict=True))
    wrong = {name: sign * value if name[0] in "fm" else value for name, value in x.items()}
    with pytest.raises(ident.InputError, match=r"Gravity has another direction .* recorded poses") as refused:
        identified(wrong)
    angles = json.loads(str(refused.value).partition("rpy_deg = ")[2].partition("]")[0] + "]")
    assert np.abs(np.subtract(angles, rpy)).max() < 4
    body = identified(x, BASE | {"rpy_deg": list(rpy)}).in_frame()
    assert np.abs((body.values - TRUTH) / body.std_setup).max() < 4


def test_the_command_takes_a_log_without_a_model(tmp_path, capsys):
    log, stated, out = tmp_path / "swing.csv", tmp_path / "c.toml", tmp_path / "out"
    write_csv(log, columns(4.0))
    # JSON's lists and strings are TOML's.
    tables = (("base", BASE), ("wrenches.ft", FELT))
    base, felt = (f"[{name}]\n" + "".join(f"{k} = {json.dumps(x)}\n" for k, x in own.items()) for name, own in tables)
    stated.write_text(base + felt)
    options = ["--body", "tool", "--sensor", "ft", "--formats", "svg", "--verbose", "--columns", str(stated)]
    assert command.main([str(log), *options, "--out", str(out)]) == 0
    folder = out / "tool-swing"
    assert not list(folder.glob("model.*"))
    assert json.loads((folder / "payload.json").read_text())["outcome"] == "usable"
    assert '"model": null' in (folder / "provenance.json").read_text()
    assert "Carried: tool, at the recorded poses" in capsys.readouterr().out
    stated.write_text(felt)
    message = refusal(command.main, [str(log), *options], capsys)
    assert "No joint moves 'tool': its pose has to be that of the base, 'tool', and the" in message
    message = refusal(command.main, ["arm.xml", *options], capsys)
    assert "payload needs a model and logs, or logs of a body alone; got 'arm.xml', no log." in message


DATA = Path(os.environ.get("MULTICONTACT_DATA", "")) / "tools"


@pytest.mark.skipif(not DATA.is_dir(), reason="MULTICONTACT_DATA has no folder of tools")
@pytest.mark.parametrize("name", ["box_wrench", "pliers"])
def test_workshop_tools_of_others(name):
    """A tool that a robot moves by its sensor, with noise as published: Nadeau et al. 2022, with z down."""
    rng, table = np.random.default_rng(0), np.genfromtxt(DATA / f"{name}.csv", delimiter=",", names=True)
    x = {key: table[key] for key in table.dtype.names}
    x |= turned(noise_of(rng, np.radians(0.01), turns_of(x)))
    for names, level in ((("x", "y", "z"), 1e-4), (FELT["force"], 0.1), (FELT["torque"], 0.005)):
        x |= {key: x[key] + level * rng.normal(size=len(table)) for key in names}
    base, felt = BASE | {"position": ["x", "y", "z"], "rpy_deg": [180, 0, 0]}, FELT | {"applied_to_link": True}
    body, truth = identified(x, base, felt, offsets=False).in_frame(), json.loads((DATA / f"{name}.json").read_text())
    inertia = np.array(truth["inertia_about_centre"])[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    distance = (body.values - [truth["mass"], *truth["centre"], *inertia]) / body.std_setup
    assert np.abs(distance[:4]).max() < 3 and np.abs(distance[body.identifiable]).max() < 3
    assert abs(body.values[0] / truth["mass"] - 1) < 0.05
