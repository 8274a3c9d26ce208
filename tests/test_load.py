"""A load without a wrist sensor: the difference of what recordings with and without it show, in one fit."""

import json
from dataclasses import replace
from pathlib import Path

import lifting
import mujoco
import numpy as np
import pytest
from commands import refusal
from mechanisms import by_joint, sines
from scipy import special

import scenes
from docs.tools.noise_recordings import sinusoids
from experiments import payload
from ident import InputError, Recording, identify, joint_torque_regressor, read_log
from ident.geometry.inertia import parameters_from_com
from ident.payload.load import differing, identify_load, joint_fit
from ident.setup import PRIORS
from ident.tolerances import INTERVAL
from sim import mechanism, simulate

MODEL = Path(scenes.__file__).parent / "arm.xml"
MASS, CENTRE, RADIUS = 2.0, np.array([0.06, 0.12, 0.0]), 0.05
INERTIA = 0.4 * MASS * RADIUS**2
TRUE = parameters_from_com(MASS, CENTRE, INERTIA * np.eye(3))
EXACT = dict.fromkeys(PRIORS, 0.0)


ARM = mechanism(MODEL, "base")


@pytest.fixture(scope="module")
def logs():
    """Angles and joint torques of the arm, whose joints rub, without and with a ball at its tool."""
    logs, kept = [], {f"{joint}_{kind}" for joint in ARM.joints for kind in ("position", "torque")}
    for seed, loaded in enumerate((False, True)):
        spec = scenes.load("arm")
        if loaded:
            ball = spec.body("tool").add_body(name="ball", pos=CENTRE)
            ball.mass, ball.ipos, ball.inertia, ball.explicitinertial = MASS, [0, 0, 0], [INERTIA] * 3, True
        log = simulate(spec, sinusoids(np.random.default_rng(seed), 4, 8.0), samples=600, seed=seed)
        own = {name: x for name, x in log.measured.items() if name in kept}
        logs.append(replace(log, measured=own, true={}, noise={}))
    return tuple(logs)


@pytest.fixture(scope="module")
def load(logs):
    return identify_load(ARM, *logs, body="tool")


def codes(load, doubt=False):
    return {finding.code for finding in load.findings if finding.doubt or not doubt}


def with_theta(estimate, theta):
    return replace(estimate, search=replace(estimate.search, fit=replace(estimate.fit, theta=theta)))


def columns_of(load, body):
    """Coefficients of a body's φ in the base parameters (r, 10)."""
    at = 10 * load.robot.bodies.index(body)
    return load.without.base.regroup(np.eye(10 * len(load.robot.bodies))[at : at + 10]).T


def test_a_load_is_weighed_by_torques_alone(load):
    body = load.in_frame()
    assert (np.abs(body.values[:4] - [MASS, *CENTRE]) < 3 * body.std[:4]).all()
    assert (body.std_setup >= body.std).all() and body.std_setup[0] < 0.1
    z = (load.joint.fit.theta[:10] - TRUE) / np.sqrt(np.diag(load.joint.fit.covariance)[:10])
    assert np.abs(z).max() < 3.5
    assert load.verdict().usable and load.verdict().mass == pytest.approx(MASS, abs=0.05)
    assert "The load" in repr(load)


def test_a_load_on_a_body_that_only_turns_about_an_axis_keeps_what_no_torque_shows_open(load):
    columns, size = columns_of(load, ARM.bodies[1]), np.repeat([ARM.mass, 1.0], [1, 9])
    joint = joint_fit(load.without.trajectory, load.estimate.trajectory, columns, size, np.zeros(10))
    hidden = ~columns.any(axis=0)
    assert hidden.any()
    np.testing.assert_allclose(np.sqrt(np.diag(joint.fit.covariance)[:10][hidden]), size[hidden], rtol=1e-6)
    assert not replace(load, body=ARM.bodies[1], joint=joint).in_frame().identifiable[0]


def test_a_small_load_keeps_the_mass_that_torques_show(load):
    """Its centre is uncertain by far more than a ball of its mass is wide, so that the ball must not hold it."""
    phi = np.array([0.04, 0, -0.02, 0, 0, 0, 0, 0, 0, 0])
    noise = np.diag(np.array([0.015, 0.01, 0.006, 0.008, *6 * [0.002]]) ** 2)
    small = replace(load, joint=with_theta(load.joint, np.concatenate([phi, load.joint.fit.theta[10:]])))
    small.__dict__["_covariances"] = noise, noise
    values = small.in_frame().values
    assert abs(values[0] - 0.04) < 0.01 and values[2] > -0.35


def test_a_load_whose_mass_alone_is_known_is_usable_for_that(load, monkeypatch):
    body = load.in_frame()
    for unknown, outcome in ((3, "partly"), (4, "usable")):
        seen, own = body._replace(identifiable=np.arange(10) < unknown), replace(load)
        monkeypatch.setattr(type(load), "in_frame", lambda *_, seen=seen: seen)
        assert own.verdict().outcome.value == outcome
        named = [each for each in own.findings if each.code == "payload_mass_unknown"]
        assert [each.values["quantities"] for each in named] == [["centre z"]] * (unknown == 3)
        assert not any(each.doubt for each in named)
        assert ("Use its mass alone, 2.00" in own.verdict().brief) is (unknown == 3)


def test_a_stated_mass_is_doubted_where_the_torques_contradict_it(load):
    for stated, doubted in ((MASS, False), (10 * MASS, True), (0.1 * MASS, True)):
        own = replace(load, weighed=(stated, 1e-4 * stated), unweighed=load.joint)
        assert ("load_weighs_another" in codes(own, doubt=True)) is doubted


def test_what_a_load_does_not_explain_widens_its_intervals(load):
    """A change of what both recordings share, such as a cable's pull, in one of them."""
    full, columns = load.estimate.trajectory, columns_of(load, "tool")
    assert load.differing[0] < special.chdtri(load.differing[1], 1e-3)
    assert "load_recordings_differ" not in codes(load)
    shift = np.where(full.fit.free & (np.arange(len(full.fit.theta)) < len(columns)), 8.0, 0.0)
    shift *= np.sqrt(np.diag(full.fit.covariance)) * (-1.0) ** np.arange(len(shift))
    moved = with_theta(full, full.fit.theta + shift)
    apart = replace(load, differing=differing(load.without.trajectory, moved, columns, load.joint))
    assert apart.differing[1] == load.differing[1]
    factor = np.sqrt(apart.differing[0] / apart.differing[1])
    assert factor > 2
    np.testing.assert_allclose(apart.in_frame().std[0] / factor, np.sqrt(load.joint.fit.covariance[0, 0]), rtol=0.01)
    assert "load_recordings_differ" in codes(apart)


def hinged(*links):
    """Links on hinges about y, one on the other, by name, mass, inertia, place and centre."""
    spec = mujoco.MjSpec()
    body = spec.worldbody
    for name, mass, inertia, z, centre in links:
        body = body.add_body(name=name, pos=[0, 0, z], mass=mass, ipos=[0, 0, centre])
        body.inertia, body.explicitinertial = [inertia, inertia, 1e-3], True
        body.add_joint(name=f"{name}_hinge", type=mujoco.mjtJoint.mjJNT_HINGE, axis=[0, 1, 0])
    return mechanism(spec)


def recorded(arm, rng, time, q, torque):
    noise = 1e-4 * rng.normal(size=q.shape), 0.02 * rng.normal(size=q.shape)
    channels = by_joint(arm.tree.joints, position=q + noise[0], torque=torque + noise[1])
    return Recording(time, channels, setup=EXACT)


def test_what_equal_motions_repeat_in_both_recordings_does_not_move_a_load():
    """Two hinges make one motion of three periods; 0.1 N m without a cause repeats with it, with and without 105 g.

    It cancels in the difference: over 16 simulations the mass is off by 0.9 g (root mean square), as without it.
    """
    arm = hinged(("upper", 1.2, 0.01, 1.0, -0.15), ("fore", 0.8, 0.01, -0.3, -0.15))
    rng, time, w = np.random.default_rng(0), np.arange(0, 18, 0.02), 2 * np.pi / 6.0 * np.arange(1, 40)
    size = np.zeros((2, 39))
    size[:, :5] = [0.5, 0.35, 0.2, 0.12, 0.08], [0.6, 0.3, 0.25, 0.1, 0.1]
    states = sines(time, size, w, rng.uniform(0, 2 * np.pi, (2, 39)))
    cause, *_ = sines(time, np.ones((2, 1)) / np.sqrt(np.arange(1, 40)), w, rng.uniform(0, 6, (2, 39)))
    Y, logs = joint_torque_regressor(arm.tree, *states, gravity=arm.gravity), []
    for mass in (0, 0.105):
        load = parameters_from_com(mass, np.array([0, 0, -0.25]), mass * 1e-3 * np.eye(3))
        torque = Y @ (arm.known + np.r_[np.zeros(10), load]) + 0.1 * cause / cause.std(axis=0)
        logs.append(recorded(arm, rng, time, states[0], torque))
    weighed = identify_load(arm, *logs, body="fore").in_frame()
    assert abs(weighed.values[0] - 0.105) < 0.004
    # By the noise alone 2 g: each recording's mass is uncertain by what repeats, the difference of the two is not.
    assert 0.002 < INTERVAL * weighed.std[0] < 0.1


def test_a_load_may_explain_all_that_recordings_share():
    """One hinge without friction shows three parameters, and a load on its link changes all of them."""
    arm, time, rng = hinged(("link", 2, 0.04, 0, -0.25)), np.arange(0, 4, 0.01), np.random.default_rng(0)
    q, _, ddq = sines(time, np.array([[0.8, 0.4]]), 2 * np.pi * np.array([[0.5, 1.3]]), 0.0)
    torques = 0.165 * ddq + 9.81 * 0.5 * np.sin(q), 0.415 * ddq + 9.81 * np.sin(q)
    logs = [recorded(arm, rng, time, q, torque) for torque in torques]
    load = identify_load(arm, *logs, body="link")
    assert load.differing[1] == 0
    assert load.joint.fit.theta[3] == pytest.approx(-0.5, abs=0.01)
    assert np.isfinite(load.in_frame().std_setup).all() and "load_recordings_differ" not in codes(load)


def test_a_box_in_a_hand_is_weighed_by_a_plate(monkeypatch):
    """Bodies of a person that the motion does not determine are a prior, which the hand with the box leaves."""
    monkeypatch.setattr(lifting, "LATE", 0.0)
    person = lifting.lifter(0)
    box = np.zeros((len(person.bodies), 10))
    box[person.bodies.index("hand")] = parameters_from_com(6.0, [0.15, 0, -0.08], 0.06 * np.eye(3))
    carrying = replace(person, prior=person.known + box.ravel())
    empty = lifting.recorded(person, lifting.STOOP, 0.4, 0, seconds=4.0)
    logs = empty, lifting.recorded(carrying, lifting.SQUAT, 0.4, 1, seconds=4.0)
    load = identify_load(lifting.table(), *logs, body="hand")
    body, planar = load.in_frame(), [0, 1, 3]
    assert load.estimate.trajectory.known and load.without.trajectory.known
    assert abs(body.values[0] - 6) < 0.3
    assert (abs(body.values[planar] - [6, 0.15, -0.08]) < 2 * body.std_setup[planar]).all()


@pytest.fixture(scope="module")
def files(logs, tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    for name, log in zip(("empty", "full"), logs, strict=True):
        log.save(folder / f"{name}.npz")
    empty, full = (str(folder / f"{name}.npz") for name in ("empty", "full"))
    return folder, [str(MODEL), empty, "--loaded", full, "--base", "base", "--out", str(folder)]


def test_the_command_weighs_a_load(files, load, logs, capsys, monkeypatch):

    def identified(robot, without, loaded, *, body, mass, **_):
        assert (robot.bodies, body, mass) == (ARM.bodies, "tool", None)
        for (read,), log in ((without, logs[0]), (loaded, logs[1])):
            np.testing.assert_array_equal(read["turn_torque"], log["turn_torque"])
        return load

    monkeypatch.setattr("ident.payload.load.identify_load", identified)
    folder, arguments = files
    assert payload.main([*arguments, "--body", "tool", "--name", "out", "--formats", "svg", "--verbose"]) == 0
    printed = capsys.readouterr().out
    assert "The load, in the frame of 'tool'" in printed and "Verdict: Usable" in printed
    written = json.loads((folder / "out" / "payload.json").read_text(encoding="utf-8"))
    assert abs(written["frames"]["tool"]["values"][0] - MASS) < 0.1


def test_bad_input_is_one_sentence(logs):
    for given, message in (
        ({"body": "nose"}, "A load needs a body with mass that carries it, got 'nose'"),
        ({"mass": -1.0}, "mass needs a number above 0"),
        ({"mass_std": 0.1}, "mass_std is the standard deviation of mass, which is not given; got 0.1"),
        ({"loaded": []}, "A load needs recordings without it and with it"),
        ({"loaded": logs[0]}, "one of them is given twice"),
    ):
        with pytest.raises(InputError, match=message):
            identify_load(ARM, logs[0], **{"loaded": logs[1], "body": "tool", **given})


def test_what_is_wrong_with_recordings_of_one_kind_names_the_kind(logs):
    first, last = logs
    short = replace(last, time=last.time[:12], measured={name: 1.001 * x[:12] for name, x in last.measured.items()})
    joints = {name: x for name, x in last.measured.items() if name.endswith("position")}
    few = "12 samples, 0 left out at either end and 40 % held out, are too few"
    for without, loaded, message in (
        (first, replace(last, measured=joints), "A recording with the load has neither a wrench nor a joint torque"),
        (short, last, f"Recordings without the load: {few}"),
    ):
        with pytest.raises(InputError, match=f"^{message}"):
            identify_load(ARM, without, loaded, body="tool")


def test_a_columns_file_states_the_body_with_the_load(files, logs, monkeypatch, capsys):
    """In Python each log has its own file; the command shares one among logs with and without the load."""
    (folder, arguments), shared = files, []
    (folder / "columns.toml").write_text('[load]\nbody = "tool"\n', encoding="utf-8")
    full = read_log(folder / "full.npz", ARM, folder / "columns.toml")
    full.save(folder / "again.npz")
    assert full.loaded == Recording.load(folder / "again.npz").loaded == "tool"
    with pytest.raises(InputError, match="A log states a load on 'tool'"):
        identify(ARM, full)
    with pytest.raises(InputError, match="recordings state one on lift and tool"):
        identify_load(ARM, [logs[0], full, replace(full, loaded="lift")])
    with pytest.raises(InputError, match=r"load\.body needs one of .*got nose"):
        read_log(folder / "full.npz", ARM, {"load": {"body": "nose"}})
    monkeypatch.setattr("ident.payload.load.identified", lambda ready, **_: shared.append(len(ready)) or 1 / 0)
    another = replace(logs[0], measured={name: 1.01 * x for name, x in logs[0].measured.items()})
    with pytest.raises(ZeroDivisionError):
        identify_load(ARM, [logs[0], full, another])
    monkeypatch.setattr("ident.payload.load.identify_load", lambda *_, body, **__: shared.append(body) or 1 / 0)
    with pytest.raises(ZeroDivisionError):
        payload.main([*arguments, "--columns", str(folder / "columns.toml")])
    assert shared == [2, "tool"]
    assert "payload needs --body NAME, or [load]" in refusal(payload.main, arguments, capsys)
