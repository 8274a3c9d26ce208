"""Guesses for arms on walls and ceilings: the direction of gravity comes before any sign."""

import driven_arm
import numpy as np
import pytest
from written_formats import write_csv

from experiments.guesses.belief import toml_text
from experiments.guesses.guess import believed
from ident.model.regressor import joint_torque_regressor
from ident.recordings.columns.mapping import read_mapping

ARM = driven_arm.mechanism(**driven_arm.NONE)


def guessed(tmp_path, rpy, sign=1):
    """Belief about a log of an arm on a base mounted so, and the mapping that is written."""
    rng, true = np.random.default_rng(1), ARM.mounted(rpy)
    t, *states = driven_arm.motion(rng)
    torques = 1.1 * joint_torque_regressor(ARM.tree, *states, gravity=true.gravity) @ ARM.known
    torques = sign * (torques + 0.3 * np.tanh(states[1] / 0.01)) + rng.normal(scale=0.05, size=torques.shape)
    columns = {"time": t} | {f"{j}_position": x for j, x in zip(ARM.tree.joints, states[0].T, strict=True)}
    columns |= {f"{j}_torque": x for j, x in zip(ARM.tree.joints, torques.T, strict=True)}
    write_csv(tmp_path / "log.csv", columns)
    belief = believed(ARM, [tmp_path / "log.csv"])
    (tmp_path / "columns.toml").write_text(toml_text(belief), encoding="utf-8")
    return belief, read_mapping(tmp_path / "columns.toml", ARM.tree)


@pytest.mark.parametrize("rpy", [(180.0, 0.0, 0.0), (0.0, 90.0, 0.0), (-90.0, 0.0, 0.0)])
def test_a_base_in_another_orientation_is_written_and_no_sign_is_turned(tmp_path, rpy):
    belief, mapping = guessed(tmp_path, rpy)
    assert mapping.base_rpy_deg == rpy
    assert all(x.gain == 1 for x in belief.quantities.values())
