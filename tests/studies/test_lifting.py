"""A person lifts a box in the sagittal plane: a delayed plate, moving skin, and a table of segments as the rival."""

import lifting
import numpy as np
import pytest

from ident.estimation.preparation import prepared
from ident.identification import identified
from ident.model.regressor import base_wrench_regressor

pytestmark = pytest.mark.slow

BETWEEN = (lifting.SQUAT + lifting.STOOP) / 2
LIFTS = ((lifting.SQUAT, 0.35), (lifting.STOOP, 0.4))


@pytest.fixture(scope="module")
def lifts():
    """A person, and her estimate from a squat and a stoop, judged by a lift between them."""
    who, known = lifting.lifter(0), lifting.table()
    logs = [prepared(known, lifting.recorded(who, *lift, k)) for k, lift in enumerate(LIFTS)]
    judge = prepared(known, lifting.recorded(who, BETWEEN, 0.45, 5))
    return who, identified(logs, judges=[judge], known=True)


def test_the_plate_is_found_to_be_late(lifts):
    (late,) = lifts[1].setup
    assert late.name == "delay(ground)"
    assert abs(late.value - lifting.LATE) < 3 * late.std and late.std < 0.002


def test_unseen_lifts_are_foretold_better_than_by_the_table(lifts):
    """By parameters at an exact motion, and by the recordings, where the delay adds to the table's errors."""
    who, estimate = lifts
    time = np.arange(300) / lifting.RATE
    motion = lifting.motion(time, BETWEEN, 0.45, 99)
    Y = base_wrench_regressor(who.tree, *motion.states, gravity=who.gravity)[:, [0, 2, 4]]
    Y = Y[..., list(estimate.base.kept)]
    true, table = (estimate.base.regroup(each.known) for each in (who, lifting.table()))
    ours, theirs = (np.sqrt(((Y @ (psi - true)) ** 2).mean(axis=0)) for psi in (estimate.psi, table))
    assert (ours < theirs).all() and (ours < theirs / 2).sum() >= 2
    assert (estimate.held_out.ratio < 0.5 * estimate.rivals["model"]).all()
    assert estimate.verdict().usable


def test_her_segments_are_a_persons(lifts):
    _, estimate = lifts
    ratio = estimate.consistent().phi[::10] / lifting.table().known[::10]
    assert ((ratio > 1 / 1.5) & (ratio < 1.5)).all()
    assert ratio[lifting.table().bodies.index("box")] == pytest.approx(1, abs=0.05)
