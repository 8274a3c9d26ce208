"""Drives of motors that move several joints together: their columns, and their torques on the tape."""

from dataclasses import replace

import numpy as np
from measurements import random_inputs, random_measurement

from ident import Motion, Samples
from ident.estimation.equations import SLIP, drives_of
from ident.tolerances import DRIVE, STRIBECK


def coupled():
    """Random measurement of torques alone, with the drives of two motors that move its first two joints."""
    rng = np.random.default_rng(0)
    m = random_measurement(rng, 4, ("revolute", "prismatic"), wrench=False, contacts=0, setup=False)
    rows = rng.uniform(5, 30, (2, 2)) * [[1, 1], [1, -1]]
    joints = m.tree.freedoms[:2]
    couplings = {f"wrist {k}": dict(zip(joints, row, strict=True)) for k, row in enumerate(rows.tolist(), start=1)}
    equations = replace(m.equations, couplings=couplings)
    drives = drives_of(equations.axes, tuple(DRIVE), equations.torques)
    m = replace(m, equations=replace(equations, drives=drives))
    return m, rows, *random_inputs(rng, m)


def test_torques_of_coupled_motors_are_those_by_hand():
    m, R, states, wrenches, theta = coupled()
    equations, motion, own = m.equations, Motion(*states), ["(wrist" in name for name in m.names]
    without = np.where(own, 0, theta)
    computed = (m.values(states, wrenches, theta) - m.values(states, wrenches, without)).T
    at = dict(zip(m.names, theta, strict=True))
    turns, speeds_up, gears = motion.dq[:, :2] @ R.T, motion.ddq[:, :2] @ R.T, np.abs(R).max(axis=1)
    Ia, Fv, Fc, Fs = (np.array([at[f"{column}(wrist {k})"] for k in (1, 2)]) for column in ("Ia", "Fv", "Fc", "Fs"))
    low = Fs / (1 + (turns / (STRIBECK * gears)) ** 2)
    expected = (Ia * speeds_up + Fv * turns + (Fc + low) * np.tanh(turns / (SLIP * gears))) @ R
    np.testing.assert_allclose(computed[:, :2], expected, atol=1e-9 * abs(expected).max())
    assert not computed[:, 2:].any()
    # Least squares has the same columns.
    samples, slips = Samples(motion, np.zeros_like(computed)), SLIP * equations.axes.gears
    (rows,) = (each.copy() for each in replace(equations, slips=slips).rows(samples))
    of_drives = np.einsum("dcn,d->nc", rows[: len(theta)], theta - without)
    np.testing.assert_allclose(of_drives, computed, atol=1e-9 * abs(expected).max())


def test_derivatives_of_coupled_drives_are_those_of_differences():
    m, _, states, wrenches, theta = coupled()
    own = np.array([k for k, name in enumerate(m.names) if "(wrist" in name])
    _, by_states, by_theta = m.derivatives(states, wrenches, theta, own)
    for derivative, e in zip(by_theta.swapaxes(0, 1), 1e-3 * np.eye(len(theta))[own], strict=True):
        difference = (m.values(states, wrenches, theta + e) - m.values(states, wrenches, theta)) / 1e-3
        np.testing.assert_allclose(derivative, difference, atol=1e-6 * max(abs(difference).max(), 1))
    step = np.zeros_like(states)
    step[1, :, 0] = 1e-6
    difference = (m.values(states + step, wrenches, theta) - m.values(states - step, wrenches, theta)) / 2e-6
    np.testing.assert_allclose(by_states[:, 1, 0], difference, atol=1e-5 * abs(difference).max())
