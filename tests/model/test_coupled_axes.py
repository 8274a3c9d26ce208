"""Drives of motors that move several joints together: their columns, and their torques on the tape."""

from dataclasses import replace

import numpy as np
import pytest
from measurements import random_inputs, random_measurement

from ident.estimation.loads import SLIP, drives_of
from ident.estimation.samples import Samples
from ident.mechanism.motion import Motion
from ident.tolerances import DRIVE, STRIBECK

KINDS = ("revolute", "prismatic")


def coupled(seed, rows=None):
    """Random measurement of torques alone, with the drives of two motors that move its first two joints."""
    rng = np.random.default_rng(seed)
    m = random_measurement(rng, 4, KINDS, wrench=False, contacts=0, setup=False)
    rows = rng.uniform(5, 30, (2, 2)) * [[1, 1], [1, -1]] if rows is None else rows
    joints = m.tree.freedoms[:2]
    couplings = {f"wrist {k}": dict(zip(joints, row, strict=True)) for k, row in enumerate(rows.tolist(), start=1)}
    equations = replace(m.equations, couplings=couplings)
    drives = drives_of(equations.axes, tuple(DRIVE), equations.torques)
    return replace(m, equations=replace(equations, drives=drives)), rows, rng


def by_hand(R, motion, values, names):
    """Torques of the first two joints, from the drives of their motors (N, 2)."""
    at = dict(zip(names, values, strict=True))
    turns, speeds_up, gears = motion.dq[:, :2] @ R.T, motion.ddq[:, :2] @ R.T, np.abs(R).max(axis=1)
    Ia, Fv, Fc, Fs = (np.array([at[f"{column}(wrist {k})"] for k in (1, 2)]) for column in ("Ia", "Fv", "Fc", "Fs"))
    low = Fs / (1 + (turns / (STRIBECK * gears)) ** 2)
    return (Ia * speeds_up + Fv * turns + (Fc + low) * np.tanh(turns / (SLIP * gears))) @ R


@pytest.mark.parametrize("seed", range(6))
def test_torques_of_coupled_motors_are_those_by_hand(seed):
    m, R, rng = coupled(seed)
    equations, (states, wrenches, theta) = m.equations, random_inputs(rng, m)
    motion = Motion(*states)
    rank, d = equations.parameters.rank, len(equations.drives)
    without = theta.copy()
    without[[k for k, name in enumerate(m.names) if "(wrist" in name]] = 0
    own = (m.values(states, wrenches, theta) - m.values(states, wrenches, without)).T
    expected = by_hand(R, motion, theta[rank : rank + d], equations.drives)
    np.testing.assert_allclose(own[:, :2], expected, atol=1e-9 * abs(expected).max())
    assert not own[:, 2:].any()
    # Least squares has the same columns.
    samples = Samples(motion, np.zeros((len(motion), len(equations.channels))))
    slips = SLIP * equations.axes.gears
    (rows,) = (each.copy() for each in replace(equations, slips=slips).rows(samples))
    of_drives = np.einsum("dcn,d->nc", rows[rank : rank + d], (theta - without)[rank : rank + d])
    np.testing.assert_allclose(of_drives, own, atol=1e-9 * abs(expected).max())


def test_derivatives_of_coupled_drives_are_those_of_differences():
    m, _, rng = coupled(0)
    states, wrenches, theta = random_inputs(rng, m)
    own = [k for k, name in enumerate(m.names) if "(wrist" in name]
    _, by_states, by_theta = m.derivatives(states, wrenches, theta, np.array(own))
    for column, k in enumerate(own):
        more = theta.copy()
        more[k] += 1e-3
        difference = (m.values(states, wrenches, more) - m.values(states, wrenches, theta)) / 1e-3
        np.testing.assert_allclose(by_theta[:, column], difference, atol=1e-6 * max(abs(difference).max(), 1))
    step = np.zeros_like(states)
    step[1, :, 0] = 1e-6
    difference = (m.values(states + step, wrenches, theta) - m.values(states - step, wrenches, theta)) / 2e-6
    np.testing.assert_allclose(by_states[:, 1, 0], difference, atol=1e-5 * abs(difference).max())


@pytest.mark.parametrize("seed", range(3))
def test_motors_of_one_joint_each_are_the_joints_but_for_their_gears(seed):
    gears = np.array([1.0, 20.0])
    m, _, rng = coupled(seed, np.diag(gears))
    alone = replace(m.equations, couplings={}, drives=())
    alone = replace(m, equations=alone.with_drives(drives_of(alone.axes, tuple(DRIVE), alone.torques)))
    states, wrenches, theta = random_inputs(rng, m)
    at = dict(zip(m.names, theta, strict=True))
    powers = {"Ia": 2, "Fv": 2, "Fc": 1, "Fs": 1}
    for k, gear in enumerate(gears):
        joint = m.tree.freedoms[k]
        for column, power in powers.items():
            at[f"{column}({joint})"] = at[f"{column}(wrist {k + 1})"] * gear**power
    same = np.array([at[name] for name in alone.names])
    expected = alone.values(states, wrenches, same)
    np.testing.assert_allclose(m.values(states, wrenches, theta), expected, atol=1e-12 * abs(expected).max())
