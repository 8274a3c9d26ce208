"""One recording and the same options give one answer, from both commands and from Python."""

import json
import tracemalloc

import numpy as np
import pytest

import ident
import scenes
import sim
from experiments import identify, stream
from ident.estimation.least_squares import huber_white
from sim.motion.excitation import DOUBLE_PENDULUM

SAMPLES = 600


@pytest.mark.usefixtures("undrawn", "here")
def test_commands_and_python_agree(tmp_path):
    log, model = tmp_path / "run.csv", tmp_path / "arm.xml"
    spec = scenes.load("double_pendulum")
    sim.simulate(spec, DOUBLE_PENDULUM, samples=SAMPLES).save(log)
    model.write_text(spec.to_xml(), encoding="utf-8")
    given = [str(model), str(log), "--base", "base", "--out", str(tmp_path / "out")]
    ordinary = ["--ordinary", "--no-offsets", "--holdout", "0", "--no-axes", "--name", "whole"]
    assert identify.main([*given, *ordinary]) == stream.main([*given, "--piece", "77"]) == 0
    by_identify = json.loads((tmp_path / "out" / "whole" / "estimate.json").read_text(encoding="utf-8"))
    by_stream = json.loads((tmp_path / "out" / "estimate.json").read_text(encoding="utf-8"))
    arm = sim.mechanism(model, base="base")
    recording = ident.read_log(log, arm)
    estimate = ident.identify(arm, recording, weighted=False, offsets=False, holdout=0, axes=False)
    pieces = ident.Recording.chunks(log, samples=50)
    first = ident.least_squares(ident.Equations.of_wrench(arm), pieces)
    fit = huber_white(first, ident.Recording.chunks(log, samples=130), steady=True)
    answers = [(by_identify["values"], by_identify["std"]), (by_stream["psi"], by_stream["std"])]
    answers += [(estimate.psi, estimate.std), (fit.psi, fit.std)]
    for psi, std in answers[1:]:
        np.testing.assert_allclose(psi, answers[0][0], rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(std, answers[0][1], rtol=1e-9)


def test_memory_is_that_of_the_channels():
    """A robust fit of a long recording holds some copies of its 29 numbers a sample, but no regressor of 78."""
    spec = scenes.load("double_pendulum")
    arm, short = sim.mechanism(spec, base="base"), sim.simulate(spec, DOUBLE_PENDULUM, samples=500)
    peaks = []
    for copies in (20, 60):
        channels = {name: np.concatenate([x] * copies) for name, x in short.measured.items()}
        recording = ident.Recording(np.arange(500 * copies) / 100, channels)
        tracemalloc.start()
        ident.identify(arm, recording, axes=False)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert (peaks[1] - peaks[0]) / (500 * 40) < 8 * 150
