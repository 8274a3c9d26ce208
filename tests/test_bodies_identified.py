"""Bodies of identified recordings: what is stated of them binds, and models may state no mass."""

from dataclasses import replace

import numpy as np
import pytest

import ident
from ident.geometry.inertia import parameters_from_com
from ident.mechanism.body import Body
from ident.mechanism.mechanism import Mechanism
from ident.mechanism.tree import BASE, Tree
from ident.recordings.recording import Recording

HINGE = np.array([0.0, 0, 0, 0, 1, 0])
MODEL = parameters_from_com(0.675, [0, 0, -0.434], np.diag([0.003, 0.003, 0.0005]))
ROD = Mechanism(Tree((Body("rod", BASE, np.eye(4), HINGE, "hinge"),)), np.array([0, 0, -9.81]), MODEL)


def log(center=0.15, inertia=0.003, *, hand=False):
    """A rod of the model's mass with another centre, whose motor a hand may relieve of the inertia."""
    rng, t = np.random.default_rng(0), np.arange(0, 12, 0.02)
    waves = [(0.9, 1.7, 0), (0.5, 3.1, 1), (0.3, 4.3, 2), (0.2, 5.9, 3)]
    q, ddq = (sum(a * w**k * np.sin(w * t + p) * (-1) ** (k // 2) for a, w, p in waves) for k in (0, 2))
    total = (inertia + 0.675 * center**2) * (not hand)
    torque = total * ddq + 0.675 * 9.81 * center * np.sin(q)
    noisy = {
        "hinge_position": q + 1e-4 * rng.normal(size=len(t)),
        "hinge_torque": torque + 0.01 * rng.normal(size=len(t)),
    }
    return Recording(t, noisy)


@pytest.mark.parametrize("std", [0.0, 0.01])
def test_a_stated_mass_binds_the_bodies(std):
    """Without it they would have any mass that the first moment and the inertia allow."""
    estimate = ident.identify(replace(ROD, prior_known={"rod": {"mass": std}}), log(), known=True)
    full = estimate.consistent()
    assert full.attainable and full.phi[0] == pytest.approx(0.675, rel=1e-4 + 2 * std)
    assert (
        full.values[0, 3] == pytest.approx(-0.15, abs=0.01)
        and full.intervals[0, 3, 0] < -0.15 < full.intervals[0, 3, 1]
    )
    free = ident.identify(ROD, log()).consistent()
    assert not free.rows[0].determined and free.intervals[0, 0, 0] < 0.675 and free.intervals[0, 0, 1] == np.inf


@pytest.mark.parametrize("known", [None, True])
def test_a_model_without_masses_is_identified(known):
    estimate = ident.identify(replace(ROD, prior=None), log(), known=known)
    psi = dict(zip(estimate.names, estimate.psi.tolist(), strict=True))
    assert psi["m1rz1"] == pytest.approx(-0.675 * 0.15, rel=0.03) and psi["Iyy1"] == pytest.approx(0.0182, rel=0.1)
    full = estimate.consistent()
    assert full.attainable and full.phi[0] > 0 and full.rows[0].model is None and estimate.verdict().usable
    drives = estimate.drives_updated["hinge"]
    assert all(len(repr(x)) < 12 for x in (drives.viscous, drives.coulomb, drives.rotor)) and drives.coulomb < 0.01
