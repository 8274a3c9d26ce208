"""Parts of the data against each other: one parameter that each part estimates alone, combined by a weighted mean."""

from types import SimpleNamespace

import numpy as np
import pytest

from ident.judgement.agreement import LEAST_ADDED, disagreements, widening
from ident.judgement.fit_findings import halves_findings


def joint(estimates, precision, *, known=0.0, mean=0.0, counts=None, scatter=None):
    """A trajectory estimate of one parameter, from the estimate of each piece and its precision."""
    estimates, precision = np.array(estimates, float), np.array(precision, float)
    scatter = precision if scatter is None else np.array(scatter, float)
    counts = counts or (len(estimates),)
    theta = (precision @ estimates + known * mean) / (precision.sum() + known)
    starts = np.cumsum([0, *counts])
    each = lambda x: np.array([[x]])  # noqa: E731
    fit = SimpleNamespace(
        theta=np.array([theta]),
        gradient=np.array([precision @ (estimates - theta) + known * (mean - theta)]),
        free=np.array([True]),
        counted=np.array([True]),
        bounded=None,
        noises=[SimpleNamespace(channels=np.ones(1))] * len(counts),
        shares=[(each(P), np.array([P * (x - theta)])) for P, x in zip(precision, estimates, strict=True)],
        scatter_shares=[each(K) for K in scatter],
        prior=SimpleNamespace(precision=each(known), mean=np.array([mean]), weight=1.0),
        precision=each(precision.sum() + known),
        scatter=each(scatter.sum() + known),
        covariance=each((scatter.sum() + known) / (precision.sum() + known) ** 2),
    )
    return SimpleNamespace(
        fit=fit,
        counts=counts,
        measurement=SimpleNamespace(equations=SimpleNamespace(parameters=SimpleNamespace(rank=1))),
        pieces_of=lambda which: slice(starts[which], starts[which + 1]),
    )


def test_what_adds_nothing_does_not_differ_by_rounding():
    """A recording counts as adding at least a hundredth of the variance."""
    estimates, precision = [1.0, 1.1, 0.9], [10.0, 20, 1e-9]
    whole = joint(estimates, precision, counts=(1, 1, 1))
    other = np.average(estimates[:2], weights=precision[:2])
    moved = abs(other - whole.fit.theta[0])
    assert disagreements(whole)[2] == pytest.approx(moved / np.sqrt(LEAST_ADDED / np.sum(precision)))
    assert LEAST_ADDED < 0.02


@pytest.mark.parametrize(("z", "doubts"), [(1.8, []), (2.2, [False]), (3.8, [False]), (4.2, [True])])
def test_recordings_disagree_from_two_deviations_and_it_is_a_doubt_from_four(z, doubts):
    result = SimpleNamespace(disagreement=None, disagreements=(0.5, z, 0.7), in_logs=())
    findings = list(halves_findings(result))
    assert [finding.doubt for finding in findings] == doubts
    assert all(
        each.code == "logs_disagree" and each.values == {"logs": (2,), "rms_z": (z,), "best": ()} for each in findings
    )


def in_log(own, other):
    """Ratios of the estimate and of least squares in two channels of a log."""
    return {"estimate": np.array([own, 0.2]), "least squares": np.array([other, 0.2])}


@pytest.mark.parametrize(("own", "doubt"), [(0.35, False), (0.45, True)])
def test_a_log_that_is_predicted_far_worse_than_others_is_a_doubt_however_bad_candidates_are(own, doubt):
    logs = [in_log(0.2, 0.4), in_log(own, 1.0), in_log(0.2, 0.4), in_log(0.2, 0.4)]
    result = SimpleNamespace(disagreement=None, disagreements=(0.5, 5.0, 0.5, 0.5), in_logs=logs, channels=("Fx", "Fy"))
    (finding,) = halves_findings(result)
    assert finding.doubt is doubt and finding.values["best"] == (() if doubt else (2,))


def test_halves_that_differ_by_two_deviations_are_a_remark():
    (finding,) = halves_findings(SimpleNamespace(disagreement=2.3, disagreements=(), in_logs=()))
    assert not finding.doubt and finding.code == "halves_disagree" and finding.values == {"rms_z": 2.3}
    assert not list(halves_findings(SimpleNamespace(disagreement=1.9, disagreements=(), in_logs=())))


@pytest.mark.parametrize(
    ("excess", "low", "high"), [(1, 0.955, 0.965), (1.5, 0.93, 0.95), (2.5, 0.92, 0.95), (4, 0.92, 0.95)]
)
def test_widened_intervals_hold_where_the_noise_is_more_than_stated(excess, low, high):
    """Errors and 12 differences have `excess` times the stated variance; without widening .95 .89 .78 .67 hold."""
    rng = np.random.default_rng(0)
    errors = np.sqrt(excess) * rng.normal(size=50_000)
    z = np.sqrt(excess * rng.chisquare(12, size=50_000) / 12)
    covered = np.mean(np.abs(errors) < 1.96 * np.array([widening(each) for each in z]))
    assert low < covered < high
