"""Models that are simulated with recorded commands, and the report on how well they follow."""

from functools import cache

import driven_arm
import mujoco
import numpy as np
import pytest

import ident
import sim
from experiments.reports.identify_report import following_lines, following_table
from experiments.studies.user_files import Following, following
from ident.errors import InputError
from ident.recordings.faults import with_servos
from sim.simulation.commanded import rolled_out


@cache
def mechanism(**drives):
    return sim.mechanism(mujoco.MjSpec.from_string(driven_arm.text(more=driven_arm.ACTUATORS, **drives)))


@cache
def recording(lag=0, noise=1.0):
    time, channels = driven_arm.commanded(lag=lag, noise=noise)
    return with_servos(ident.Recording(time, channels), {}, mechanism(), [])


def error(q, log):
    """RMS error of simulated coordinates (n,)."""
    return np.sqrt(((q - log.of_joints(driven_arm.JOINTS, "position")) ** 2).mean(axis=0))


def test_the_true_model_follows_what_its_servos_did():
    log = recording(noise=0.0)
    assert (error(rolled_out(mechanism(), log), log) < 2e-3).all()
    weak = mechanism(armature=(0.6, 0.5, 0.2), damping=(3.0, 3.0, 1.0))
    assert (error(rolled_out(weak, log), log) > 1e-2).all()


def test_commands_act_later_by_the_lag():
    log = recording(lag=2)
    now, later = (error(rolled_out(mechanism(), log, lag=lag), log) for lag in (0.0, 0.02))
    assert (later < 0.5 * now).all()


def test_every_joint_of_the_model_needs_a_command():
    log = recording()
    without = ident.Recording(log.time, log.measured, servos={"turn": log.servos["turn"]})
    with pytest.raises(InputError, match="needs a command of every joint; lift, bend have none"):
        rolled_out(mechanism(), without)
    text = driven_arm.text().replace(
        "<worldbody>", '<worldbody><body name="crate"><freejoint name="loose"/><geom size="1"/></body>'
    )
    arm = sim.mechanism(mujoco.MjSpec.from_string(text), "column")
    with pytest.raises(InputError, match=r"of every joint of the model; .*loose"):
        rolled_out(arm, log)


def test_the_updated_model_follows_as_well_as_the_true_one():
    """Of the estimate from the first part of a recording, on the rest of it."""
    result = ident.identify(mechanism(), recording())
    followed = following(result)
    # Here the model as it came is the true one.
    assert (followed.after < 1.2 * followed.before).all() and followed.seconds == pytest.approx(4.8, abs=0.1)
    assert followed.units == ("rad",) * 3


def test_the_report_says_how_well_models_follow():
    made = Following(("a", "b"), ("rad", "m"), np.array([0.02, 0.03]), np.array([0.01, 0.033]), 9.4)
    assert made.better == 1
    (line,) = following_lines(made)
    assert "follows 1 of 2 joints better than the model as it came" in line and "0.80 of the other's" in line
    table = following_table(made)
    assert table.rows[0][0] == "a" and table.rows[1][3] == pytest.approx(1.1)
    came = Following(("a",), ("rad",), np.array([np.nan]), np.array([0.01]), 9.4)
    assert came.better == 1 and "and the model as it came diverges." in following_lines(came)[0]
    assert following_table(came).rows[0][1] is None
    assert "diverges" in following_lines(Following(("a",), ("rad",), np.array([0.1]), np.array([np.nan]), 1.0))[0]
