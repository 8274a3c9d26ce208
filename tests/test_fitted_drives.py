"""Drives that are fitted by default: rotors, friction and springs, with the model's values where data do not tell."""

from dataclasses import replace
from functools import cache

import driven_arm
import numpy as np
import pytest

import ident
from ident.mechanism.drives import Actuator, Drive
from ident.setup import PRIORS

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
    exact = dict.fromkeys(PRIORS, 0.0)
    estimate = ident.identify(driven_arm.mechanism(), driven_arm.log(8.0, 50.0), setup=exact, known=False)
    std = dict(zip(estimate.fit.names, estimate.fit.std, strict=True))
    z = {name: (values(estimate)[name] - value) / std[name] for name, value in TRUE.items()}
    assert max(map(abs, z.values())) < 3.5, z
    assert all(std[name] < 0.1 * value for name, value in TRUE.items())
    model = estimate.fit.equations.from_model
    z = (estimate.psi - model[: estimate.base.rank]) / estimate.std
    assert np.abs(z).max() < 3.5


def test_the_model_with_its_drives_predicts_as_well_as_the_estimate_of_the_same_bodies():
    estimate = weighted()
    np.testing.assert_allclose(estimate.rivals["model"], estimate.held_out.ratio, rtol=0.1)
    assert (weighted(stated=False).rivals["model"] > 5 * estimate.rivals["model"]).all()


def test_the_drives_of_an_estimate_are_the_fitted_ones_and_else_the_model_s():
    estimate = weighted()
    drives, stated = estimate.drives, driven_arm.mechanism().drives
    assert drives["turn"].rotor == stated["turn"].rotor == 0.2
    assert drives["bend"].rotor == values(estimate)["Ia(bend)"] != stated["bend"].rotor
    assert drives["lift"].stiffness == values(estimate)["K(lift)"] and drives["lift"].springref == 0.4
    assert {name: drive.coulomb for name, drive in drives.items()} == {
        name: values(estimate)[f"Fc({name})"] for name in driven_arm.JOINTS
    }
    geared = Drive(rotor=0.1, actuators=(Actuator("motor", gear=10.0, rotor=2e-3, viscous=0.01),))
    assert geared.with_value("rotor", 0.5).rotor == pytest.approx(0.3)
    assert geared.with_value("viscous", 0.5).viscous == 0 and geared.with_value("stribeck", 1.0) == geared


def test_what_is_absorbed_survives_a_channel_that_is_flat_in_the_fitted_part():
    recording = driven_arm.log()
    torque = recording["bend_torque"].copy()
    torque[: round(0.7 * len(torque))] = 0.0
    flat = replace(recording, measured={**recording.measured, "bend_torque": torque})
    exact = dict.fromkeys(PRIORS, 0.0)
    estimate = ident.identify(driven_arm.mechanism(), flat, estimator="weighted", cutoff=8.0, setup=exact)
    assert estimate.channels == ("turn", "lift")
    k = estimate.base.names.index("Izz1")
    assert estimate.fit.equations.from_drives[k] == pytest.approx(0.2, abs=1e-6)
    assert not any("bend" in name for name in estimate.fit.equations.drives)
