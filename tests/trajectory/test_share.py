"""Long recordings: what a share of them decides, and how often all of them are fitted."""

import driven_arm
import numpy as np
import pytest

import ident
from ident.errors import ExcitationError
from ident.trajectory import stages, trajectory_estimate
from ident.trajectory.fit import iteration


@pytest.fixture
def counted(monkeypatch):
    """Numbers of samples of all fits of parameters, and of all covariances, in order."""
    fits, covariances, fit, with_scatter = [], [], iteration.fit, stages.with_scatter

    def counting(measurement, pieces, begin, **how):
        if len(begin.theta):
            fits.append(sum(len(piece.when) for piece in pieces))
        return fit(measurement, pieces, begin, **how)

    def scattered(measurement, fit, **how):
        covariances.append(sum(len(piece.when) for piece in fit.pieces))
        return with_scatter(measurement, fit, **how)

    monkeypatch.setattr(iteration, "fit", counting)
    monkeypatch.setattr(stages, "with_scatter", scattered)
    return fits, covariances


def identified(**known):
    return ident.identify(driven_arm.mechanism(), driven_arm.log(), **known)


@pytest.mark.parametrize("determined", [True, False])
def test_a_share_decides_and_all_is_fitted_at_the_end(determined, counted, monkeypatch):
    """Of a share that does not determine the parameters, twice as much is taken."""
    first = identified()
    usual, std = first.fit.values, first.fit.std
    fits, covariances = counted
    fits.clear(), covariances.clear()
    monkeypatch.setattr(trajectory_estimate, "ENOUGH", 240 if determined else 180)
    begun = stages.Stages._begun

    def refused(self, steps, share):
        if share == 4:
            raise ExcitationError("The recording does not determine all parameters.")
        return begun(self, steps, share)

    monkeypatch.setattr(stages.Stages, "_begun", refused)
    again = identified()
    whole = len(again.trajectory.fit.pieces[0].time) * len(again.trajectory.fit.pieces)
    assert min(fits) == pytest.approx(whole / (3 if determined else 2), rel=0.1)
    assert fits.count(whole) <= 3 + len(again.trajectory.search.deviations)
    assert covariances.count(whole) == 1
    assert again.trajectory.fit.status == "converged" and not again.trajectory.known
    off = np.abs((again.fit.values - usual) / std)
    assert off[: again.base.rank].max() < 0.5 and off.max() < 1.5
