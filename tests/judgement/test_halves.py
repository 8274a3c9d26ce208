"""Parts of the data against each other: one parameter that each part estimates alone, combined by a weighted mean."""

from types import SimpleNamespace

import numpy as np
import pytest

from ident.judgement.agreement import widening
from ident.judgement.fit_findings import halves_findings


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
