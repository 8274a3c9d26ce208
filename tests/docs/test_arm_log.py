"""The log of README's example: it is the one that is simulated, and its estimate is usable and right."""

import re
from pathlib import Path

import numpy as np
import pytest

import ident
import scenes
import sim
from docs.tools import drawings
from docs.tools.noise.conditions import drives, truth
from ident.geometry.inertia import parameters_from_com

pytestmark = pytest.mark.slow

SCENES = Path(scenes.__file__).parent


@pytest.fixture(scope="module")
def arm():
    return sim.mechanism(SCENES / "arm.xml", base="base")


@pytest.fixture(scope="module")
def estimate(arm):
    return ident.identify(arm, ident.read_log(SCENES / "arm.csv", arm))


def test_the_log_is_made_anew(tmp_path):
    """To a few units of the last decimal, since simulations of other platforms differ in the last bits."""
    drawings.save_log(tmp_path / "arm.csv")
    shipped = (SCENES / "arm.csv").read_text(encoding="utf-8").splitlines()
    made = (tmp_path / "arm.csv").read_text(encoding="utf-8").splitlines()
    assert shipped[0] == made[0] and len(shipped) == len(made) == 1 + drawings.SAMPLES
    a, b = (np.loadtxt(lines[1:], delimiter=",") for lines in (shipped, made))
    np.testing.assert_allclose(a, b, atol=0.021, rtol=0)
    np.testing.assert_allclose(a[:, 1:5], b[:, 1:5], atol=2.1e-5, rtol=0)
    assert (SCENES / "arm.csv").stat().st_size < 200_000


def test_its_estimate_is_usable_and_its_intervals_cover_the_truth(arm, estimate):
    assert estimate.verdict().usable and not estimate.setup
    loaded = arm.known.copy()
    inertia = 0.4 * drawings.LOAD * drawings.RADIUS**2 * np.eye(3)
    loaded[-10:] += parameters_from_com(drawings.LOAD, np.array(drawings.PLACE), inertia)
    true = truth(estimate.fit.equations, loaded, drives(arm, scenes.load("arm").compile()))
    error = abs(estimate.fit.values[: len(true)] - true)
    assert len(true) > 35 and (error < 1.96 * estimate.fit.std[: len(true)]).mean() > 0.9
    assert (error < 1.96 * np.sqrt(np.diag(estimate.covariance_setup))[: len(true)]).all()


def test_the_load_is_in_the_updated_tool_with_the_interval_of_readme(arm, estimate):
    consistent = estimate.consistent()
    *others, tool = consistent.phi[::10]
    assert tool == pytest.approx(0.8 + drawings.LOAD, abs=0.05)
    assert others == pytest.approx(arm.known[:-10:10], rel=0.05)
    text = (SCENES.parent / "README.md").read_text(encoding="utf-8")
    low, high = re.search(r"the tool has ([\d.]+) to ([\d.]+) kg", text).groups()
    assert (float(low), float(high)) == pytest.approx(tuple(consistent.intervals[-1][0]), abs=0.0051)
