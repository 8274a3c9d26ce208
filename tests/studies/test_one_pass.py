"""Findings of `stream` for recordings with known errors."""

import json
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from commands import refusal

import scenes
from experiments import identify, stream
from experiments.studies.one_pass import separated, with_offsets
from experiments.studies.stream_progress import FILE
from ident.estimation.accumulator import accumulate
from ident.estimation.equations import Equations
from ident.estimation.samples import Samples
from ident.mechanism.motion import Motion
from sim.models.mechanism import mechanism
from sim.motion.excitation import DOUBLE_PENDULUM
from sim.simulation.simulate import simulate

pytestmark = pytest.mark.usefixtures("here")


@cache
def recording():
    return simulate(scenes.load("double_pendulum"), DOUBLE_PENDULUM, samples=943)


def arguments(tmp_path, *more, units=None, **channels):
    original = recording()
    units = original.units if units is None else units
    changed = replace(original, measured={**original.measured, **channels}, true={}, noise={}, units=units)
    spec = scenes.load("double_pendulum")
    spec.compile()
    (tmp_path / "model.xml").write_text(spec.to_xml())
    changed.save(tmp_path / "log.npz")
    files = [str(tmp_path / name) for name in ("model.xml", "log.npz")]
    return [*files, "--base", "base", "--piece", "300", "--out", str(tmp_path / "out"), *more]


def judged(tmp_path, *more, **channels):
    assert stream.main(arguments(tmp_path, *more, **channels)) == 0
    estimate = json.loads((tmp_path / "out" / "estimate.json").read_text())
    return estimate, {finding["code"]: finding["values"] for finding in estimate["findings"] if finding["doubt"]}


def test_a_sound_recording_is_usable(tmp_path, capsys):
    estimate, doubts = judged(tmp_path)
    assert doubts == {} and estimate["outcome"] == "usable"
    assert estimate["verdict"] == (
        "Usable to predict wrenches: fitted residuals are at most 0.086 of the signal in all 5 channels. "
        "Not counted: Fx (the model does not change it)."
    )
    wrench = recording().wrench("ground").values
    rms = np.array(estimate["residual_norms"]) / np.sqrt(943)
    np.testing.assert_allclose(
        [each["ratio"] for each in estimate["held_out"].values()], rms / wrench.std(axis=0), rtol=1e-9
    )
    assert f"Verdict: {estimate['verdict']}" in " ".join(capsys.readouterr().out.split())


def test_an_empty_force_a_wrong_sign_and_kilonewtons_are_doubts(tmp_path):
    force, torque = recording()["ground_force"], recording()["ground_torque"]
    estimate, doubts = judged(tmp_path, ground_force=0 * force)
    assert estimate["verdict"] == "Not usable as it is: 2 findings below speak against it. It predicts all 3 channels."
    assert doubts["weight_differs"] == {"measured": 0, "model": pytest.approx(20.99, abs=0.005)}
    assert doubts["constant_channels"] == {"channels": ["Fy", "Fz"]}
    _, doubts = judged(tmp_path, ground_force=-force, ground_torque=-torque)
    sign = doubts["total_wrench_sign"]
    assert sign["error"] == pytest.approx(2, abs=0.005) and sign["error_turned"] < 0.05
    assert doubts["weight_differs"]["measured"] == pytest.approx(-21, abs=0.1)
    _, doubts = judged(tmp_path, ground_force=force / 1000, ground_torque=torque / 1000)
    assert doubts["kilonewtons"] == {"largest": pytest.approx(0.232, abs=0.0005), "weight": pytest.approx(206, abs=0.5)}


def test_offsets_that_a_motion_hides_are_left_out():
    """At constant acceleration in one posture, effects of first moments and products of inertia are constant, too."""
    arm = mechanism(scenes.load("double_pendulum"), "base")
    equations = with_offsets(Equations.of_wrench(arm))
    assert [equations.channels[k] for k in equations.offsets] == ["Fx", "Fy", "Mz"]
    still, measured = np.zeros((300, 2)), np.random.default_rng(1).normal(size=(300, 6))
    samples = Samples(Motion(still, still, still + np.array([1, 0])), measured)
    part, fewer = separated(accumulate(equations, samples), equations)
    expected = accumulate(fewer, samples)
    assert [fewer.channels[k] for k in fewer.offsets] == ["Fx"]
    assert fewer.names == part.names == expected.names
    for k in range(6):
        grams = [a.factor.T @ a.grams[k] @ a.factor for a in (part, expected)]
        np.testing.assert_allclose(grams[0], grams[1], rtol=0, atol=1e-10 * abs(grams[1]).max())


def test_what_cannot_be_fitted_is_refused(tmp_path, capsys):
    original = recording()
    nothing = {name: 0 * original[name] for name in ("ground_force", "ground_torque")}
    assert "Every channel of the total wrench is constant" in refusal(
        stream.main, arguments(tmp_path, **nothing), capsys
    )
    turned = {name: 3 * np.rad2deg(original[name]) for name in ("joint1_position", "joint2_position")}
    message = refusal(stream.main, arguments(tmp_path, units={}, **turned), capsys)
    assert "channel 'joint1_position' ranges over" in message and "looks like degrees" in message
    for name, what in (("joint1_velocity", "channel 'joint1_velocity'"), ("ground_force", "the total wrench")):
        message = refusal(stream.main, arguments(tmp_path, **{name: 1e300 * original[name]}), capsys)
        assert f"{what} needs numbers below 1e+08, got " in message
    force = np.where(np.arange(943)[:, None] == 712, 1e30, original["ground_force"])
    message = refusal(stream.main, [*arguments(tmp_path, ground_force=force), "--piece", "100"], capsys)
    assert "the total wrench needs numbers below 1e+08, got 1e+30 in sample 712 (counted from 0), at 7.12 s." in message
    message = refusal(stream.main, arguments(tmp_path, units={"ground_force": "kN"}), capsys)
    assert "channel 'ground_force' is in kN, but a recording needs N." in message
    message = refusal(stream.main, arguments(tmp_path, units={"joint1_position": "furlong"}), capsys)
    assert "channel 'joint1_position' is in furlong, but a recording needs rad." in message
    message = refusal(stream.main, arguments(tmp_path, joint1_velocity=np.ones((943, 3))), capsys)
    assert "channel 'joint1_velocity' needs one number a sample, got shape (300, 3)." in message


def test_a_base_on_which_nothing_moves_is_named(tmp_path, capsys):
    given = [*arguments(tmp_path), "--base", "link2"]
    assert "Nothing moves on this base: link2 without joints; see --base." in refusal(stream.main, given, capsys)
    assert "Nothing moves on this base: name another one (--base)" in refusal(
        identify.main,
        [*given[:2], "--base", "link2", "--estimator", "weighted", "--cutoff", "auto", "--out", str(tmp_path / "out")],
        capsys,
    )
    ball = '<body name="a"><joint name="neck" type="ball"/><geom size="1"/></body>'
    (tmp_path / "model.xml").write_text(f"<mujoco><worldbody>{ball}</worldbody></mujoco>")
    assert "but not the ball joint 'neck'" in refusal(stream.main, given[:2], capsys)


def test_a_recording_is_never_written_over(tmp_path, capsys):
    model, log, *given = arguments(tmp_path)
    result = tmp_path / "out" / FILE
    result.parent.mkdir()
    result.write_bytes((tmp_path / "log.npz").read_bytes())
    links = tmp_path / "symbolic.npz", tmp_path / "hard.npz"
    links[0].symlink_to(result)
    links[1].hardlink_to(result)
    for path in (result, *links):
        message = refusal(stream.main, [model, str(path), *given], capsys)
        assert f"The results would replace '{result}', which is the input '{path}'; choose another --out." in message
    assert result.read_bytes() == (tmp_path / "log.npz").read_bytes()
    assert stream.main([model, log, *given]) == 0
