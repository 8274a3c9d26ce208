"""Estimates: their numbers, fitted drives, bodies, and one answer by commands and in Python."""

import json
from dataclasses import replace
from functools import cache

import driven_arm
import numpy as np
import pytest
from mechanisms import sines
from recorded_faults import PENDULUM, estimated, faulty

import ident
import scenes
import sim
from experiments import identify, stream
from ident import Body, Mechanism, Recording, base_wrench_regressor
from ident.geometry.inertia import parameters_from_com
from ident.mechanism.drives import Actuator, Drive
from ident.mechanism.tree import BASE, Tree
from sim.motion.excitation import DOUBLE_PENDULUM


def test_what_is_open_of_the_setup_adds_to_the_variance_of_every_combination():
    estimate = estimated()
    rank = estimate.base.rank
    noise, both = (x[:rank, :rank] for x in (estimate.fit.covariance, estimate.covariance_setup))
    unit = np.outer(*2 * [np.sqrt(np.diag(both))])
    assert np.linalg.eigvalsh((both - noise) / unit).min() > -1e-9
    assert ((both - noise) / unit).min() < -0.1
    np.testing.assert_allclose(np.sqrt(np.diag(both)), estimate.std_setup)


def test_condition_numbers_are_those_of_the_regressor_as_it_is_and_with_unit_norm():
    ordinary = ident.identify(PENDULUM, faulty(), estimator="ordinary", cutoff=5.0)
    prepared, part = ordinary.logs[0]
    Y = base_wrench_regressor(PENDULUM.tree, *prepared.samples[part].motion.states, gravity=PENDULUM.gravity)
    Y = ordinary.base.reduce(Y).reshape(-1, ordinary.base.rank)
    numbers = ordinary.condition_numbers
    np.testing.assert_allclose(numbers["raw"], np.linalg.cond(Y), rtol=1e-9)
    np.testing.assert_allclose(numbers["unit_norm"], np.linalg.cond(Y / np.linalg.norm(Y, axis=0)), rtol=1e-9)
    assert numbers["weighted"] == ordinary.condition_number


TRUE = {
    "Ia(bend)": 0.05,
    **{f"Fv({joint})": x for joint, x in zip(driven_arm.JOINTS, driven_arm.TRUE["damping"], strict=True)},
    **{f"Fc({joint})": x for joint, x in zip(driven_arm.JOINTS, driven_arm.TRUE["frictionloss"], strict=True)},
    "K(lift)": 8.0,
}
"""Drives that the links do not absorb."""


@cache
def weighted(*, stated=True, **options):
    arm = driven_arm.mechanism(**({} if stated else driven_arm.NONE))
    return ident.identify(arm, driven_arm.log(), estimator="weighted", cutoff=8.0, **options)


def values(estimate):
    return dict(zip(estimate.fit.names, estimate.fit.values, strict=True))


def test_rotors_friction_and_the_model_s_springs_are_fitted_by_default():
    estimate = weighted()
    drives = estimate.fit.names[estimate.base.rank : -3]
    assert set(drives) == set(TRUE) and len(drives) == len(TRUE)
    assert not any(name.startswith("K(") for name in weighted(stated=False).names)
    for name, value in TRUE.items():
        assert values(estimate)[name] == pytest.approx(value, rel=0.06), name


def test_the_trajectory_estimate_s_intervals_hold_the_true_drives():
    estimate = ident.identify(driven_arm.mechanism(), driven_arm.log(8.0, 50.0), setup=driven_arm.EXACT, known=False)
    std = dict(zip(estimate.fit.names, estimate.fit.std, strict=True))
    z = {name: (values(estimate)[name] - value) / std[name] for name, value in TRUE.items()}
    assert max(map(abs, z.values())) < 3.5, z
    assert all(std[name] < 0.1 * value for name, value in TRUE.items())
    model = estimate.fit.equations.from_model
    z = (estimate.psi - model[: estimate.base.rank]) / estimate.std
    assert np.abs(z).max() < 3.5


def test_the_drives_of_an_estimate_are_the_fitted_ones_and_else_the_model_s():
    estimate = weighted()
    drives, stated = estimate.drives, driven_arm.mechanism().drives
    assert drives["turn"].rotor == stated["turn"].rotor == 0.2
    assert drives["bend"].rotor == values(estimate)["Ia(bend)"] != stated["bend"].rotor
    assert drives["lift"].stiffness == values(estimate)["K(lift)"] and drives["lift"].springref == 0.4
    assert all(drive.coulomb == values(estimate)[f"Fc({name})"] for name, drive in drives.items())
    geared = Drive(rotor=0.1, actuators=(Actuator("motor", gear=10.0, rotor=2e-3, viscous=0.01),))
    assert geared.with_value("rotor", 0.5).rotor == pytest.approx(0.3)
    assert geared.with_value("viscous", 0.5).viscous == 0 and geared.with_value("stribeck", 1.0) == geared


def test_what_is_absorbed_survives_a_channel_that_is_flat_in_the_fitted_part():
    recording = driven_arm.log()
    torque = recording["bend_torque"].copy()
    torque[: round(0.7 * len(torque))] = 0.0
    flat = replace(recording, measured={**recording.measured, "bend_torque": torque})
    estimate = ident.identify(driven_arm.mechanism(), flat, estimator="weighted", cutoff=8.0, setup=driven_arm.EXACT)
    assert estimate.channels == ("turn", "lift")
    k = estimate.base.names.index("Izz1")
    assert estimate.fit.equations.from_drives[k] == pytest.approx(0.2, abs=1e-6)
    assert not any("bend" in name for name in estimate.fit.equations.drives)


HINGE = np.array([0.0, 0, 0, 0, 1, 0])
MODEL = parameters_from_com(0.675, [0, 0, -0.434], np.diag([0.003, 0.003, 0.0005]))
ROD = Mechanism(Tree((Body("rod", BASE, np.eye(4), HINGE, "hinge"),)), np.array([0, 0, -9.81]), MODEL)


def log():
    """A rod of the model's mass with another centre, 0.15 m from the hinge."""
    rng, t = np.random.default_rng(0), np.arange(0, 12, 0.02)
    q, _, ddq = sines(t, np.array([0.9, 0.5, 0.3, 0.2]), np.array([1.7, 3.1, 4.3, 5.9]), np.arange(4))
    torque = (0.003 + 0.675 * 0.15**2) * ddq + 0.675 * 9.81 * 0.15 * np.sin(q)
    q = q + 1e-4 * rng.normal(size=len(t))
    return Recording(t, {"hinge_position": q, "hinge_torque": torque + 0.01 * rng.normal(size=len(t))})


def test_a_stated_mass_binds_the_bodies():
    """Without it they would have any mass that the first moment and the inertia allow."""
    full = ident.identify(replace(ROD, prior_known={"rod": {"mass": 0}}), log(), known=True).consistent()
    assert full.attainable and full.phi[0] == pytest.approx(0.675, rel=1e-4)
    assert full.rows[0].words == "0.675 (as stated)" and full.values[0, 3] == pytest.approx(-0.15, abs=0.01)
    assert full.intervals[0, 3, 0] < -0.15 < full.intervals[0, 3, 1] and full.rows[3].determined
    free = ident.identify(ROD, log()).consistent()
    assert not free.rows[0].determined and free.intervals[0, 0, 0] < 0.675 and free.intervals[0, 0, 1] == np.inf


def test_a_model_without_masses_is_identified():
    estimate = ident.identify(replace(ROD, prior=None), log(), known=True)
    psi = dict(zip(estimate.names, estimate.psi.tolist(), strict=True))
    assert psi["m1rz1"] == pytest.approx(-0.675 * 0.15, rel=0.03) and psi["Iyy1"] == pytest.approx(0.0182, rel=0.1)
    full = estimate.consistent()
    assert full.attainable and full.phi[0] > 0 and full.rows[0].model is None and estimate.verdict().usable
    drives = estimate.drives_updated["hinge"]
    assert all(len(repr(x)) < 12 for x in (drives.viscous, drives.coulomb, drives.rotor)) and drives.coulomb < 0.01


@pytest.mark.usefixtures("undrawn", "here")
def test_commands_and_python_agree(tmp_path, capsys):
    model, *logs = (tmp_path / name for name in ("arm.xml", "run.csv", "other.csv"))
    spec = scenes.load("double_pendulum")
    model.write_text(spec.to_xml(), encoding="utf-8")
    for seed, path in enumerate(logs):
        sim.simulate(spec, DOUBLE_PENDULUM, samples=600, seed=seed).save(path)
    log, held_out = logs
    files = [str(model), str(log), "--base", "base", "--out", str(tmp_path / "out")]
    files += ["--no-offsets", "--held-out", str(held_out)]
    ordinary = ["--estimator", "ordinary", "--holdout", "0", "--name", "whole"]
    assert identify.main([*files, *ordinary]) == stream.main([*files, "--name", "former"]) == 0
    assert "`stream` is `identify --estimator ordinary --holdout 0` now" in capsys.readouterr().err
    pages = (tmp_path / "out" / name / "estimate.json" for name in ("whole", "former"))
    whole, former = (json.loads(page.read_text(encoding="utf-8")) for page in pages)
    assert whole == former
    arm = sim.mechanism(model, base="base")
    judge, more = ident.read_log(held_out, arm), {"estimator": "ordinary", "offsets": False, "holdout": 0}
    estimate = ident.identify(arm, ident.read_log(log, arm), held_out=[judge], **more)
    rank = len(estimate.psi)
    np.testing.assert_allclose(estimate.psi, whole["values"][:rank], rtol=1e-10, atol=1e-12)
    np.testing.assert_allclose(estimate.std, whole["std"][:rank], rtol=1e-9)
