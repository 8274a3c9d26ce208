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
def test_commands_and_python_agree(tmp_path, files, offsets, other, capsys):
    log, model, held_out = tmp_path / "run.csv", tmp_path / "arm.xml", tmp_path / "other.csv"
    files += ["--offsets" if offsets else "--no-offsets", *(["--held-out", str(held_out)] if other else [])]
    ordinary = ["--estimator", "ordinary", "--holdout", "0", "--name", "whole"]
    assert identify.main([*files, *ordinary]) == stream.main([*files, "--name", "former"]) == 0
    assert "`stream` is `identify --estimator ordinary --holdout 0` now" in capsys.readouterr().err
    by_identify, by_former_name = (written(tmp_path / "out" / name) for name in ("whole", "former"))
    assert by_identify == by_former_name
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
    assert_the_same([(by_identify["values"][:rank], by_identify["std"][:rank]), (estimate.psi, estimate.std)])
