from dataclasses import replace

import numpy as np
import pytest
from measurements import random_measurement

from ident.estimation.setup import across, setup_parameters
from ident.setup import PRIORS


def names(m, contacts=(), **priors):
    return [each.name for each in setup_parameters(m.equations, contacts, priors)]


def test_all_that_a_laboratory_leaves_open():
    m = random_measurement(np.random.default_rng(0), 4, ("revolute",), contacts=0)
    own = setup_parameters(m.equations, ["hand"])
    kinds = [each.kind for each in own]
    hinges, channels = len(m.tree.joints), len(m.equations.channels)
    expected = {
        "delay": 1,
        "lag": 0,
        "clock": 1,
        "origin": 6,
        "rotation": 6,
        "gain": channels + 6,
        "scale": 0,
        "gravity": 2,
    }
    assert {kind: kinds.count(kind) for kind in PRIORS} == expected | {"zero": hinges, "axis": 2 * hinges}
    assert {each.kind: each.std for each in own} == {kind: std for kind, std in PRIORS.items() if kind in kinds}
    assert not {"lag", "scale"} & set(kinds)
    assert len({each.name for each in own}) == len(own)
    some = {"delay(ground)", "origin_x(ground)", "rotation_z(hand)", "gain(Fz)", "gain(hand Mx)", "zero(j1)"}
    assert some <= {each.name for each in own}


def test_where_nothing_holds_the_base_contacts_have_one_delay_and_one_clock():
    m = random_measurement(np.random.default_rng(0), 3, ("revolute",), contacts=0)
    own = {each.name for each in setup_parameters(m.equations, ["right", "left"], held=False)}
    assert {"delay(right + left)", "clock(right + left)", "origin_x(right)", "rotation_z(left)"} <= own
    assert {"gain(right Fx)", "gain(left Mz)"} <= own
    assert not {"gain(Fx)", "delay(ground)"} & own
    torques = random_measurement(np.random.default_rng(0), 3, ("revolute",), wrench=False)
    for held in (True, False):
        kinds = {each.kind for each in setup_parameters(torques.equations, ["right"], held=held)}
        assert not {"delay", "clock"} & kinds and "origin" in kinds


def test_a_kind_is_left_out_or_given_another_prior():
    m = random_measurement(np.random.default_rng(0), 3, ("revolute",))
    kinds = {each.kind: each.std for each in setup_parameters(m.equations, [], {"gain": 0.0, "delay": 0.01})}
    assert kinds == {kind: std for kind, std in PRIORS.items() if kind not in ("gain", "lag", "scale")} | {
        "delay": 0.01
    }


def test_commands_share_a_lag_and_torques_have_scales_as_uncertain_as_stated():
    m = random_measurement(np.random.default_rng(0), 3, ("revolute",), wrench=False, contacts=0, commanded=True)
    first, second, *_ = m.equations.channels
    some = replace(m.equations, scales=(0.2, *[0.0] * (len(m.equations.torques) - 1)))
    own = {each.name: each.std for each in setup_parameters(some, [])}
    assert own["lag"] == PRIORS["lag"]
    assert {name: std for name, std in own.items() if name.startswith(("gain", "scale"))} == {f"scale({first})": 0.2}
    servos = m.equations.servos.copy()
    servos[0, 1] = 0
    own = {each.name: each.std for each in setup_parameters(replace(some, servos=servos), [])}
    assert "lag" not in own and own[f"gain({second})"] == PRIORS["gain"]
    exact = setup_parameters(some, [], {"scale": 0.0})
    assert not any(each.kind == "scale" for each in exact)


def test_what_does_not_turn_has_neither_zero_nor_axis_and_torques_no_frame():
    m = random_measurement(np.random.default_rng(0), 5, ("ball", "prismatic", "free"), wrench=False, contacts=0)
    assert {name.partition("_")[0].partition("(")[0] for name in names(m)} == {"gain", "gravity"}


@pytest.mark.parametrize("seed", range(10))
def test_tilts_are_about_axes_across(seed):
    """The axis nearest to the direction is left out, so that the two tilts turn it by about their size."""
    direction = np.random.default_rng(seed).normal(size=3)
    axes = across(direction)
    assert axes == sorted(set(range(3)) - {int(np.argmax(abs(direction)))})
    turns = np.cross(np.eye(3)[axes], direction / np.linalg.norm(direction))
    assert np.linalg.svd(turns)[1].min() > 0.5
