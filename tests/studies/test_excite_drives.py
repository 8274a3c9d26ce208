"""Excitations that are designed for friction, rotors and springs as well."""

import driven_arm
import numpy as np
import pytest
from commands import refusal

from experiments import excite
from experiments.studies import criteria, excitation_problem
from experiments.studies.excitation_problem import SLIP, drive_signals
from ident.mechanism.motion import Motion

ALL = ("rotor", "viscous", "coulomb", "stribeck", "spring")


def problem(drive, **stated):
    return excitation_problem.problem(driven_arm.mechanism(**stated), None, sensors="torque", drive=drive)


def random_motion(n=40):
    q, dq, ddq = np.random.default_rng(0).uniform(-1, 1, size=(3, n, 3))
    return Motion(q, 0.3 * dq, ddq)


def test_columns_are_the_torques_of_unit_drives():
    design, motion = problem(ALL), random_motion()
    columns = dict(zip(design.drives, drive_signals(design.mechanism, design.drives, motion).T, strict=True))
    q, dq, ddq = motion.q[:, 1], motion.dq[:, 1], motion.ddq[:, 2]
    np.testing.assert_allclose(columns["K(lift)"][1], q - 0.4)
    np.testing.assert_allclose(columns["Fv(lift)"][1], dq)
    np.testing.assert_allclose(columns["Fc(lift)"][1], np.tanh(dq / SLIP))
    np.testing.assert_allclose(columns["Ia(bend)"][2], ddq)
    assert all(np.count_nonzero(column.any(axis=1)) == 1 for column in columns.values())
    Y = design.regressor(*motion.states)
    assert Y.shape == (len(motion), 3, len(design.names))


@pytest.mark.parametrize("criterion", ["deviations", "determinant", "condition"])
def test_derivatives_are_differences(criterion):
    design, motion, step = problem(ALL), random_motion(), 1e-6
    cost = criteria.cost(design, criterion, 1000)
    _, derivatives = cost(*motion.states)
    rng = np.random.default_rng(1)
    for which in range(3):
        direction = rng.normal(size=motion.q.shape)
        moved = [[x + sign * step * direction * (k == which) for k, x in enumerate(motion.states)] for sign in (1, -1)]
        difference = (cost(*moved[0])[0] - cost(*moved[1])[0]) / (2 * step)
        assert (derivatives[which] * direction).sum() == pytest.approx(difference, rel=1e-4)


def test_the_wrench_at_the_base_contains_no_drives(capsys):
    message = refusal(excite.main, ["arm", "--drive", "auto"], capsys)
    assert "contains no drives: --drive needs --sensors torque" in message
