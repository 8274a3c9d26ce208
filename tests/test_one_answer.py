"""One recording with the same options gives one answer, by both commands and in Python."""

import json

import numpy as np
import pytest

import ident
import scenes
import sim
from experiments import identify, stream
from sim.motion.excitation import DOUBLE_PENDULUM

SAMPLES = 600


@pytest.fixture
def files(tmp_path):
    """A model, two recordings of it, and options."""
    spec = scenes.load("double_pendulum")
    for seed, name in enumerate(("run.csv", "other.csv")):
        sim.simulate(spec, DOUBLE_PENDULUM, samples=SAMPLES, seed=seed).save(tmp_path / name)
    (tmp_path / "arm.xml").write_text(spec.to_xml(), encoding="utf-8")
    return [str(tmp_path / "arm.xml"), str(tmp_path / "run.csv"), "--base", "base", "--out", str(tmp_path / "out")]


def written(out):
    return json.loads((out / "estimate.json").read_text(encoding="utf-8"))


def assert_the_same(answers):
    (first, first_std), *others = answers
    for psi, std in others:
        np.testing.assert_allclose(psi, first, rtol=1e-10, atol=1e-12)
        np.testing.assert_allclose(std, first_std, rtol=1e-9)


@pytest.mark.usefixtures("undrawn", "here")
@pytest.mark.parametrize(("offsets", "other"), [(True, False), (False, True)])
def test_commands_and_python_agree(tmp_path, files, offsets, other):
    log, model, held_out = tmp_path / "run.csv", tmp_path / "arm.xml", tmp_path / "other.csv"
    files += ["--offsets" if offsets else "--no-offsets", *(["--held-out", str(held_out)] if other else [])]
    ordinary = ["--estimator", "ordinary", "--holdout", "0", "--name", "whole"]
    assert identify.main([*files, *ordinary]) == stream.main([*files, "--piece", "77"]) == 0
    by_identify, by_stream = written(tmp_path / "out" / "whole"), written(tmp_path / "out")
    arm = sim.mechanism(model, base="base")
    estimate = ident.identify(
        arm,
        ident.read_log(log, arm),
        estimator="ordinary",
        offsets=offsets,
        holdout=0,
        held_out=[ident.read_log(held_out, arm)] if other else [],
    )
    rank = len(estimate.psi)
    answers = [(each["values"][:rank], each["std"][:rank]) for each in (by_identify, by_stream)]
    assert_the_same([*answers, (estimate.psi, estimate.std)])
    ratios, others = (
        {channel: numbers["ratio"] for channel, numbers in each["held_out"].items()}
        for each in (by_identify, by_stream)
    )
    assert others == pytest.approx(ratios, rel=1e-8)
    if offsets:
        values = [[(x["value"], x["std"]) for x in each["offsets"].values()] for each in (by_identify, by_stream)]
        assert by_identify["offsets"].keys() == by_stream["offsets"].keys() != set()
        assert_the_same([np.transpose(each) for each in values])
    else:
        assert by_stream["offsets"] == {}
