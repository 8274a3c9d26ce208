"""Excitations that are designed for friction, rotors and springs as well."""

import csv

import driven_arm
import numpy as np
import pytest
from commands import refusal

from experiments import excite
from experiments.studies import criteria, excitation
from experiments.studies.driven_excitation import SLIP, drive_signals
from ident.mechanism.motion import Motion
from ident.parameters.prior import DRIVE_KNOWN

ALL = ("rotor", "viscous", "coulomb", "stribeck", "spring")


def problem(drive, **stated):
    return excitation.problem(driven_arm.mechanism(**stated), None, sensors="torque", drive=drive)


def random_motion(n=40):
    q, dq, ddq = np.random.default_rng(0).uniform(-1, 1, size=(3, n, 3))
    return Motion(q, 0.3 * dq, ddq)


def test_drives_are_those_that_a_motion_can_separate():
    assert problem(()).drives == ()
    assert set(problem(None).drives) == {
        *(f"{kind}({joint})" for kind in ("Fv", "Fc") for joint in driven_arm.JOINTS),
        "Ia(bend)",
        "K(lift)",
    }


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


def test_what_is_known_of_a_drive_is_half_of_the_model_s_value_or_usual():
    stated, none = problem(None), problem(None, **driven_arm.NONE)
    known, usual = (
        dict(zip(each.names, np.linalg.norm(criteria.known_root(each), axis=0), strict=True)) for each in (stated, none)
    )
    assert known["Fc(lift)"] == pytest.approx(DRIVE_KNOWN * 0.7)
    assert known["K(lift)"] == pytest.approx(DRIVE_KNOWN * 8.0)
    assert 0.1 < usual["Fc(lift)"] < 3 and usual["Fv(lift)"] == pytest.approx(usual["Fc(lift)"])


def test_the_command_lists_the_deviations_of_drives(tmp_path, capsys):
    model = tmp_path / "arm.xml"
    model.write_text(driven_arm.text(), encoding="utf-8")
    command = [str(model), "--sensors", "torque", "--drive", "auto", "--position", "-1", "1", "--starts", "1"]
    command += ["--iterations", "8", "--formats", "png", "--out", str(tmp_path / "out")]
    assert excite.main(command) == 0
    assert "8 drives: Ia(bend), Fv(turn)" in capsys.readouterr().out
    with (tmp_path / "out" / "table_deviations.csv").open(encoding="utf-8") as file:
        rows = {row["parameter"]: row for row in csv.DictReader(file)}
    assert float(rows["Fc(bend)"]["std_after"]) > 0 and "K(lift)" in rows


def test_the_wrench_at_the_base_contains_no_drives(capsys):
    message = refusal(excite.main, ["arm", "--drive", "auto"], capsys)
    assert "contains no drives: --drive needs --sensors torque" in message
